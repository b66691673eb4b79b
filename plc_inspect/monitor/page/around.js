// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// What is written over the picture: names, the scale bar and north.

import {make, metres, order} from './symbols.js';

const MOST_LABELS = 8, MOST_NAMES = 40;
const ABOVE = 20; // a label is so much above its place [px]
const SCALE = 90; // greatest length of the scale bar [px]

export function drawAround(scene) {
  const box = scene.canvas.getBoundingClientRect();
  drawLabels(scene, box);
  drawScale(scene);
}

function drawLabels(scene, box) {
  const labels = [];
  const worst = [...scene.hazards].sort((a, b) => order(b.severity) - order(a.severity)).slice(0, MOST_LABELS);
  for (const item of worst) {
    const at = scene.project(item.position, box);
    if (at) labels.push([at, `${item.kind} ${metres(item.clearance, 2)}`]);
  }
  if (scene.vehicle && scene.wire) {
    const at = scene.project(scene.vehicle.map((value, k) => (value + scene.wire.place[k]) / 2), box);
    if (at) labels.push([at, metres(scene.wire.distance)]);
  }
  let names = 0;
  for (const item of scene.supports) {
    const [x, y, z] = item.position, at = scene.project([x, y, z + item.height], box);
    if (at && names++ < MOST_NAMES) labels.push([at, `structure ${item.id}`]);
  }
  // Nothing covers the vehicle; a label stands above its place, and all of it in the picture.
  const vehicle = scene.vehicle && scene.project(scene.vehicle, box);
  const placed = vehicle ? [[[vehicle[0], vehicle[1] + ABOVE], 30]] : [];
  const free = labels.filter(([at, text]) => {
    const wide = 8 * text.length + 10;
    at[0] = Math.min(Math.max(at[0], wide / 2), box.width - wide / 2);
    if (placed.some(([other, width]) => Math.abs(other[0] - at[0]) < (wide + width) / 2 && Math.abs(other[1] - at[1]) < 26)) return false;
    return placed.push([at, wide]);
  });
  // Elements are kept: frames come often, and new ones are costly.
  while (scene.labels.children.length > free.length) scene.labels.lastChild.remove();
  while (scene.labels.children.length < free.length) scene.labels.append(make('span'));
  free.forEach(([[x, y], text], k) => {
    const item = scene.labels.children[k];
    if (item.textContent !== text) item.textContent = text;
    item.style.transform = `translate(${x.toFixed(0)}px, ${y.toFixed(0)}px) translate(-50%, -130%)`;
  });
}

function drawScale(scene) {
  const {camera, controls} = scene;
  const apart = camera.position.distanceTo(controls.target);
  const perPixel = scene.perPixel(apart);
  const raw = SCALE * perPixel, unit = 10 ** Math.floor(Math.log10(raw));
  const length = [5, 2, 1].map(k => k * unit).find(value => value <= raw) ?? unit;
  document.getElementById('scale-bar').style.width = `${(length / perPixel).toFixed(0)}px`;
  const text = length >= 1000 ? `${length / 1000} km` : `${length >= 1 ? length : length.toFixed(1)} m`;
  const shown = document.getElementById('scale-text');
  if (shown.textContent !== text) shown.textContent = text;
  const offset = controls.target.clone().sub(camera.position);
  const steep = Math.hypot(offset.x, offset.y) <= 0.01 * apart;
  const turned = steep ? 0 : -Math.atan2(offset.x, offset.y) * 180 / Math.PI;
  document.getElementById('needle').setAttribute('transform', `rotate(${turned.toFixed(1)})`);
}
