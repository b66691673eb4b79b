// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// Severities are drawn from one table, which the server writes into the page.

export const table = JSON.parse(document.getElementById('table').textContent);
const SPACE = 'http://www.w3.org/2000/svg';

// The worse, the greater; 0 of what is no severity of hazards.
export function order(name) {
  return {critical: 3, warning: 2, notice: 1}[name] ?? 0;
}

// Return an element with attributes and children; texts become text nodes.
export function make(tag, attributes = {}, ...children) {
  const item = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) item.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined) item.setAttribute(name, value);
  }
  item.append(...children);
  return item;
}

export function makeSvg(tag, attributes = {}, ...children) {
  const item = document.createElementNS(SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) item.setAttribute(name, value);
  item.append(...children);
  return item;
}

// Corners of a shape about 0, 0 with a radius; a circle has none.
export function corners(count, radius) {
  const turn = count === 8 ? Math.PI / 8 : 0;
  return Array.from({length: count}, (_, k) => {
    const angle = turn + 2 * Math.PI * k / count - Math.PI / 2;
    return [radius * Math.cos(angle), radius * Math.sin(angle)];
  });
}

export function shapeSvg(name, outline = '#000') {
  const look = table[name];
  const given = {fill: look.color, stroke: outline, 'stroke-width': 1.6};
  const body = look.corners
    ? makeSvg('polygon', {points: corners(look.corners, 9).map(p => p.map(v => v.toFixed(1)).join()).join(' '), ...given})
    : makeSvg('circle', {r: 8, ...given});
  const sign = {critical: '!', warning: '!', notice: 'i', ok: ''}[name];
  const text = makeSvg('text', {'text-anchor': 'middle', y: 4.5, 'font-size': 13, 'font-weight': 800, fill: look.ink}, sign);
  return makeSvg('svg', {viewBox: '-10 -10 20 20', 'aria-hidden': 'true', focusable: 'false'}, body, text);
}

export function shape(name, outline) {
  return make('span', {class: 'shape', 'aria-hidden': 'true'}, shapeSvg(name, outline));
}

export function chip(name, text) {
  return make('span', {class: 'chip', 'data-tone': name}, text);
}

export function iconOf(name) {
  const svg = shapeSvg(name, '#fff');
  svg.setAttribute('xmlns', SPACE);
  return 'data:image/svg+xml,' + encodeURIComponent(new XMLSerializer().serializeToString(svg));
}

export function clock(seconds) {
  return new Date(seconds * 1000).toLocaleTimeString('en-GB');
}

export function metres(value, digits = 1) {
  return value === null || value === undefined ? '-' : `${value.toFixed(digits)} m`;
}
