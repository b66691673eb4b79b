// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The page of the ground station: what comes in goes to the picture, the tables and the alarms.
// State, alarms and tables need no picture: they are there before it, and where it cannot be drawn.

import {Alarms, showState} from './alarms.js';
import {showClock} from './clock.js';
import {Rows} from './rows.js';
import {chip, clock, make, metres, shape, shapeSvg} from './symbols.js';
import {Tables} from './tables.js';

const FROZEN = 3000;
const $ = id => document.getElementById(id);
const asked = new URLSearchParams(location.search).get('vehicle');
const known = JSON.parse($('known').textContent); // vehicles when the page was opened
let me = {vehicle: asked ?? '', acknowledges: false};
let state = null, heard = 0;
let ahead = 0; // of the monitor's clock, by which all times are told, over that of this device [s]
const newest = {}; // versions of the parts

const scene = {now: null}; // the picture, once it is there
const draw = (name, ...given) => scene.now?.[name](...given);
const tables = new Tables(place => draw('goTo', place), () => me);
const alarms = new Alarms(item => tables.chooseHazard(item.hazard) || draw('goTo', item.place), () => me);
let blocks = []; // points that came before the picture; null where none can be drawn
const rows = {
  hazards: new Rows(items => { draw('showHazards', items); tables.showHazards(items); }),
  spans: new Rows(items => {
    draw('showSpans', items);
    tables.showSpans(items);
    if (whole && scene.now?.view === 'overview') draw('setView', 'overview');
  }),
  supports: new Rows(items => draw('showSupports', items)),
};
let track = [], life = null, whole = false;
let express = false; // connections of their own for alarms
const link = new Worker('/link.js'), receivers = [];
link.onmessage = ({data: {id, data}}) => {
  const taken = data.length ?? data.byteLength;
  try {
    receivers[id](data);
  } finally {
    link.postMessage({id, taken});
  }
};

const parts = {
  me(value) {
    me = value;
    if (life !== null && life !== value.life) {
      draw('clearPoints');
      for (const name of Object.keys(newest)) delete newest[name];
    }
    life = value.life;
    $('view-only').hidden = me.acknowledges;
    for (const item of document.querySelectorAll('.acknowledges')) item.hidden = !me.acknowledges;
    alarms.redraw();
    // TCP sends a lost packet again only after a second of a slow link; two are seldom lost at once.
    if (express) return;
    express = true;
    const query = `vehicle=${encodeURIComponent(me.vehicle)}`;
    link.postMessage({id: 0, pin: query}); // another vehicle may be the first by then
    for (const _ of [1, 2]) connect(`${query}&alarms=1`, take);
  },
  state(value) {
    state = value;
    ahead = value.wall - Date.now() / 1000;
    alarms.count(value.counts);
    showState(value.tone, value.text, alarms);
    $('refused').textContent = value.refused && `(${value.refused})`;
    showInstruments(value);
    draw('showVehicle', value.vehicle, value.heading, value.height, value.near);
    goOn(value.vehicle);
    tables.showAges(value);
    document.body.classList.toggle('old', value.link !== 'live' || value.old.data && value.tone !== 'ok');
  },
  alarms(value) {
    alarms.show(value);
    if (state) showState(state.tone, state.text, alarms);
  },
  past: value => tables.showLog(value),
  track(value) {
    track = value;
    draw('showTrack', track);
  },
  health: value => tables.showHealth(value),
  events: value => tables.showEvents(value),
  fleet: value => showFleet(value),
  clock(value) {
    alarms.silent = true;
    $('now').hidden = true; // the time of the flight is beside its line
    showClock(value);
    whole = !value;
    if (whole) draw('setView', 'overview'); // results without a flight
  },
};

for (const [name, table] of Object.entries(rows)) {
  parts[name] = value => table.take(value.rows);
  parts[`${name}-keys`] = value => table.order(value.keys);
}

// The way that was flown comes from time to time; what was flown since is added here.
function goOn(place) {
  const last = track.at(-1);
  if (!place || !last || place.every((value, k) => Math.abs(value - last[k]) < 1)) return;
  track.push(place);
  draw('showTrack', track);
}

async function startPicture() {
  try {
    const {Scene} = await import('./scene.js');
    scene.now = new Scene($('canvas'), id => tables.chooseHazard(id, false));
  } catch (error) {
    blocks = null;
    $('no-picture').hidden = false;
    $('no-picture').textContent = `No 3D picture on this device (${error.message}). State, alarms and tables are not affected.`;
    return;
  }
  scene.now.setTheme(document.documentElement.dataset.theme);
  for (const table of Object.values(rows)) table.show();
  draw('showTrack', track);
  if (state) draw('showVehicle', state.vehicle, state.heading, state.height, state.near);
  for (const data of blocks.splice(0)) draw('takeBlock', data);
  if (whole) draw('setView', 'overview');
}

function showInstruments({near, height, heading, old}) {
  const wire = near.find(item => item.thing === 'conductor');
  const others = near.filter(item => item.thing !== 'conductor' && item.tone === 'critical');
  const words = {clear: '', unknown: 'not all seen', warning: 'near', critical: 'TOO NEAR'};
  const word = item => item.level === 'critical' && item.limit !== null && item.distance > item.limit ? 'was TOO NEAR' : words[item.level];
  const show = item => chip(item.tone, `${item.thing === 'conductor' ? '' : item.thing + ' '}${metres(item.distance)} ${word(item)}`.trim());
  $('nearest').replaceChildren(...(wire && wire.distance !== null ? [show(wire)] : wire ? [chip(wire.tone, wire.level === 'clear' ? 'none near' : 'unknown')] : ['-']));
  $('others').hidden = !others.length;
  $('other').replaceChildren(...others.map(show));
  $('height').textContent = height === null ? '-' : `about ${metres(height)}`;
  $('heading').textContent = heading === null ? '-' : `${(Math.round(90 - heading * 180 / Math.PI) % 360 + 360) % 360}°`;
  $('instruments').classList.toggle('aged', old.vehicle || old.near && near.length > 0);
}

// One button for each vehicle, where there are several; the alarms of others are heard here too.
function showFleet(rows) {
  $('fleet').hidden = rows.length < 2 && rows[0]?.name === me.vehicle;
  const others = rows.filter(row => row.name !== me.vehicle);
  alarms.elsewhere = others.reduce((sum, row) => sum + row.unseen, 0);
  alarms.rings = others.some(row => row.new); // as here, one that cleared unseen stays in sight, without a sound
  alarms.ring();
  const text = JSON.stringify([rows, me.vehicle]);
  if (text === showFleet.drawn) return;
  showFleet.drawn = text;
  // a button that is pressed while its text changes must stay, or the click is lost
  const known = new Map([...$('fleet').children].map(item => [item.dataset.vehicle, item]));
  const buttons = rows.map(row => known.get(row.name) ?? make('button', {type: 'button', 'data-vehicle': row.name,
    onclick: () => location.assign(`?vehicle=${encodeURIComponent(row.name)}`)}));
  rows.forEach((row, place) => {
    const worst = row.critical || row.unseen ? 'critical' : row.tone;
    const words = [row.text, ...(row.critical ? [`${row.critical} critical`] : []), ...(row.unseen ? [`${row.unseen} not acknowledged`] : [])];
    buttons[place].setAttribute('aria-pressed', String(row.name === me.vehicle));
    buttons[place].replaceChildren(shape(worst, 'currentColor'), ` ${row.name}: ${words.join(', ')}`);
  });
  if (buttons.length !== known.size || buttons.some((item, place) => item !== $('fleet').children[place])) {
    const focused = document.activeElement?.dataset?.vehicle;
    $('fleet').replaceChildren(...buttons);
    if (focused) $('fleet').querySelector(`[data-vehicle="${focused}"]`)?.focus();
  }
}

// What comes over both connections is taken once, and nothing old after what is new.
function take(data) {
  const {part, version, value} = JSON.parse(data);
  if (version && version <= (newest[part] ?? 0)) return;
  if (version) newest[part] = version;
  parts[part]?.(value);
}

function takeAll(data) {
  heard = performance.now();
  if (typeof data === 'string') take(data);
  else if (scene.now) scene.now.takeBlock(data);
  else blocks?.push(data);
}

// Open a connection; the worker opens it again whenever it ends.
function connect(query, receive) {
  receivers.push(receive);
  link.postMessage({query});
}

// Where nothing replaces what is shown, it says so by itself.
setInterval(() => {
  $('now').textContent = clock(Date.now() / 1000 + ahead);
  const silence = performance.now() - heard;
  if (heard && silence < FROZEN) return;
  document.body.classList.add('old');
  $('instruments').classList.add('aged');
  showState('critical', heard ? `FROZEN for ${Math.round(silence / 1000)} s: the monitor no longer updates this page, all of it is old`
    : asked && !known.includes(asked) ? `no vehicle ${asked} is known: ${known.join(', ') || 'none'} when this page was opened`
      : 'connecting to the monitor', alarms);
}, 500);

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  $('theme').textContent = theme === 'light' ? 'Dark' : 'Light';
  localStorage.setItem('theme', theme);
  draw('setTheme', theme);
}

function setSize(size) {
  document.documentElement.dataset.size = size;
  alarms.fit();
  localStorage.setItem('size', size);
}

$('theme').onclick = () => setTheme(document.documentElement.dataset.theme === 'light' ? 'dark' : 'light');
$('size').onclick = () => setSize(Number(document.documentElement.dataset.size ?? 1) % 3 + 1);
$('help-button').onclick = () => $('help').showModal();
$('help-close').onclick = () => $('help').close();
for (const button of document.querySelectorAll('[data-view]')) button.onclick = () => draw('setView', button.dataset.view);
const prefers = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
setTheme(localStorage.getItem('theme') ?? prefers);
setSize(localStorage.getItem('size') ?? 1);
for (const item of document.querySelectorAll('#legend .shape')) item.append(shapeSvg(item.dataset.tone, 'currentColor'));

const keys = {
  f: () => draw('setView', 'follow'), o: () => draw('setView', 'overview'),
  t: () => draw('setView', 'top'), s: () => draw('setView', 'side'),
  1: () => tables.open('hazards'), 2: () => tables.open('spans'),
  3: () => tables.open('log'), 4: () => tables.open('health'),
  a: () => alarms.acknowledge(alarms.unseen()), m: () => alarms.mute(!alarms.muted),
  g: () => alarms.open.length && alarms.list.querySelector('.what')?.click(),
  l: () => $('theme').click(), '?': () => $('help').showModal(),
};
addEventListener('keydown', event => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.matches('input:not([type=range])') || document.querySelector('dialog[open]')) return;
  const act = keys[event.key.toLowerCase()];
  if (!act) return;
  event.preventDefault(); // or the letter would go into the field that opens
  act();
});

globalThis.station = {get scene() { return scene.now; }, get waiting() { return blocks?.length; }, tables, alarms};
connect(asked ? `vehicle=${encodeURIComponent(asked)}` : '', takeAll);
startPicture();
