// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// Tables, tabs, the log and the profile of the chosen span.

import {chip, clock, make, makeSvg, metres, shape, table} from './symbols.js';

const TABS = ['hazards', 'spans', 'log', 'health'];
const PROFILE_PERIOD = 3000;
const $ = id => document.getElementById(id);

export class Tables {
  constructor(goTo, getMe) {
    this.goTo = goTo;
    this.getMe = getMe;
    this.hazards = [];
    this.spans = [];
    this.hazard = this.span = null;
    this.held = ''; // why hazards are held back
    this.none = '';
    for (const name of TABS) {
      $(`tab-${name}`).onclick = () => this.open(name);
      $(`tab-${name}`).onkeydown = event => {
        const step = {ArrowRight: 1, ArrowLeft: -1}[event.key];
        if (!step) return;
        event.stopPropagation();
        const next = TABS[(TABS.indexOf(name) + step + TABS.length) % TABS.length];
        this.open(next);
        $(`tab-${next}`).focus();
      };
    }
    setInterval(() => this.fetchProfile(), PROFILE_PERIOD);
  }

  open(name) {
    for (const other of TABS) {
      const chosen = other === name;
      $(`tab-${other}`).setAttribute('aria-selected', String(chosen));
      $(`tab-${other}`).tabIndex = chosen ? 0 : -1;
      $(`panel-${other}`).hidden = !chosen;
    }
  }

  showHazards(items) {
    this.hazards = items;
    this.replace($('hazards'), items.map(item => make('tr',
      {class: 'row', 'data-hazard': item.id, 'aria-current': item.id === this.hazard ? 'true' : null,
        onclick: () => this.chooseHazard(item.id)},
      make('td', {}, shape(item.severity, 'currentColor'), ' ', make('button',
        {type: 'button', class: 'pick', 'data-focus': `hazard ${item.id}`}, `${table[item.severity].word} ${item.kind} ${item.id}`)),
      make('td', {}, `${item.stretch}, ${item.conductor}`),
      make('td', {}, item.clearance === null ? '-' : item.clearance.toFixed(2)),
      make('td', {}, item.required === null ? '-' : item.required.toFixed(2)))));
    this.showHazard();
  }

  // Rows are drawn anew; what had the focus has it again.
  replace(body, rows) {
    const name = document.activeElement?.dataset?.focus;
    body.replaceChildren(...rows);
    if (name && body.contains(document.activeElement) === false) body.querySelector(`[data-focus="${name}"]`)?.focus();
  }

  // Return whether there is such a hazard: an alarm may be there before its row.
  chooseHazard(id, fly = true) {
    const item = this.hazards.find(hazard => hazard.id === id);
    if (!item) return false;
    this.hazard = id;
    this.showHazards(this.hazards);
    this.open('hazards');
    this.span = item.span;
    if (fly) this.goTo(item.position);
    return true;
  }

  showHazard() {
    const item = this.hazards.find(hazard => hazard.id === this.hazard);
    $('hazard').replaceChildren(...(item ? [
      make('h2', {'data-hazard': item.id}, chip(item.severity, table[item.severity].word), ` ${item.kind} ${item.id}`),
      make('p', {}, `${item.stretch}, ${item.conductor} `,
        make('button', {type: 'button', 'data-focus': 'profile', onclick: () => { this.open('spans'); this.chooseSpan(item.span, false); }}, 'Profile'), ' ',
        make('button', {type: 'button', 'data-focus': 'copy', onclick: event => copy(item.position.join(' '), event.target)}, 'Copy position')),
      make('table', {class: 'pairs'}, make('tbody', {}, ...pairs(item.rows))),
    ] : [make('p', {}, this.hazards.length ? 'Choose a hazard in the table or in the picture.' : this.held || this.none)]));
  }

  showSpans(items) {
    this.spans = items;
    this.replace($('spans'), items.map(item => make('tr',
      {class: 'row', 'data-span': item.key, 'aria-current': item.key === this.span ? 'true' : null,
        onclick: () => this.chooseSpan(item.key)},
      make('td', {}, shape(item.severity, 'currentColor'), ' ', make('button',
        {type: 'button', class: 'pick', 'data-focus': `span ${item.key}`}, `${item.stretch}, ${item.conductor}${item.open ? ' …' : ''}`)),
      make('td', {}, item.length.toFixed(1)), make('td', {}, item.sag.toFixed(2)),
      make('td', {}, item.ground === null ? '-' : item.ground.toFixed(1)),
      make('td', {}, `${Math.round(100 * item.coverage)} %`))));
  }

  chooseSpan(key, fly = true) {
    this.span = key;
    const item = this.spans.find(span => span.key === key);
    this.showSpans(this.spans);
    this.drawn = null;
    this.fetchProfile();
    if (item && fly) this.goTo(item.curve[Math.floor(item.curve.length / 2)]);
  }

  async fetchProfile() {
    if (!this.span || $('panel-spans').hidden) return;
    const wanted = this.span;
    try {
      const answer = await fetch(`/profile?vehicle=${encodeURIComponent(this.getMe().vehicle)}&span=${wanted}`);
      if (!answer.ok) return $('profile').replaceChildren(make('p', {}, 'This span is no more.'));
      const text = await answer.text();
      if (text === this.drawn || wanted !== this.span) return;
      this.drawn = text;
      drawProfile(JSON.parse(text), wanted);
    } catch {
      // the page says by itself that it is frozen
    }
  }

  showLog(alarms) {
    const rows = alarms.map(item => make('li', {}, `${clock(item.raised)} `,
      item.place ? make('button', {type: 'button', class: 'pick', 'data-focus': `past ${item.number}`, onclick: () => this.goTo(item.place)}, item.text) : item.text,
      `; cleared ${clock(item.cleared)} (${item.reason}); ${item.who ? `seen by ${item.who} ${clock(item.acknowledged)}` : 'seen by nobody'}`));
    this.replace($('past'), rows.length ? rows : [make('li', {}, 'None is over yet. Those that stand, and those that nobody has seen, are in the bar at the top.')]);
  }

  showEvents(items) {
    $('events').replaceChildren(...items.map(item => make('li', {},
      `${clock(item.time)} `, ...(item.level ? [chip(['notice', 'warning', 'critical'][item.level], ['', 'warning', 'alarm'][item.level]), ' '] : []), item.text)));
  }

  showHealth(value) {
    $('health').replaceChildren(...pairs(value.rows));
    $('notes').replaceChildren(...value.notes.map(text => make('li', {}, chip('warning', 'note'), ' ', text)));
  }

  showAges(state) {
    const none = state.ages.data === null ? 'No result yet: nobody knows whether there are hazards.' : 'No hazard so far.';
    if (this.held !== state.held_back || this.none !== none) {
      this.held = state.held_back;
      this.none = none;
      this.showHazard();
    }
    for (const [id, kind, what] of [['hazards', 'data', count(this.hazards, 'hazard')], ['spans', 'data', count(this.spans, 'span')], ['health', 'health', 'health']]) {
      const line = $(`${id}-age`), old = state.old[kind];
      line.textContent = `${what}, ${state.age_texts[kind]}${old ? ': OLD' : ''}` +
        (id === 'hazards' && this.held ? `; HELD BACK, as told last: ${this.held}` : '');
      line.classList.toggle('stale', old);
      $(`panel-${id}`).querySelector('table').classList.toggle('aged', old);
    }
  }
}

// Browsers let only pages of this machine or of HTTPS copy.
async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
    button.textContent = 'Copied';
  } catch {
    button.textContent = text;
  }
}

function count(items, word) {
  return `${items.length} ${word}${items.length === 1 ? '' : 's'}`;
}

function pairs(rows) {
  return rows.map(([name, value]) => make('tr', {}, make('th', {scope: 'row'}, name), make('td', {}, value)));
}

function drawProfile({frame, profile, title, text}, key) {
  const svg = makeSvg('svg', {viewBox: `0 0 ${frame.width} ${frame.height}`, role: 'img', 'aria-label': `side view of ${title}`, 'font-size': 10});
  for (const tick of profile.heights) {
    svg.append(makeSvg('path', {d: `M${frame.left} ${tick.place}H${frame.right}`, stroke: '#8888'}),
      makeSvg('text', {x: frame.left - 3, y: tick.place + 3, 'text-anchor': 'end', fill: '#10151c'}, String(tick.value)));
  }
  for (const tick of profile.lengths) svg.append(makeSvg('text', {x: tick.place, y: frame.bottom + 13, 'text-anchor': 'middle', fill: '#10151c'}, String(tick.value)));
  for (const layer of profile.layers) svg.append(makeSvg('path', {d: layer.places.map(([x, y]) => `M${x} ${y}h1`).join(''), stroke: layer.color, 'stroke-width': 3}));
  svg.append(makeSvg('polyline', {points: profile.curve.map(p => p.join()).join(' '), fill: 'none', stroke: '#10151c', 'stroke-width': 2}));
  for (const mark of profile.marks) {
    svg.append(makeSvg('circle', {cx: mark.x, cy: mark.y, r: 5, fill: table[mark.severity].color, stroke: '#10151c', 'stroke-width': 1.5}),
      makeSvg('text', {x: mark.x + 7, y: mark.y - 4, fill: '#10151c', 'font-weight': 700}, metres(mark.clearance, 2)));
  }
  $('profile').replaceChildren(make('h2', {'data-span': key}, title), make('p', {}, text), svg,
    make('p', {}, 'Height over distance, in metres; heights are drawn larger on long spans.'));
}
