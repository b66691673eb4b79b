// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The time line of a replay: where it stands, how fast it plays, and the alarms on it.

import {clock, make, shape} from './symbols.js';

const SPEEDS = [1, 4, 16];
const $ = id => document.getElementById(id);
let now = null, held = false, marks = '';

async function steer(change) {
  const answer = await fetch('/time', {method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(change)});
  if (!answer.ok) $('time-text').textContent = await answer.text();
}

export function showClock(value) {
  $('clock').hidden = !value;
  if (!value) return;
  now = value;
  $('play').textContent = value.playing ? 'Pause' : 'Play';
  $('speed').textContent = `${value.speed} x`;
  $('time').max = value.length;
  if (!held) $('time').value = value.time;
  $('time').setAttribute('aria-valuetext', clock(value.start + value.time));
  $('time-text').textContent = `${clock(value.start + value.time)}, ${value.time.toFixed(0)} of ${value.length.toFixed(0)} s`;
  const text = JSON.stringify(value.marks);
  if (text === marks) return;
  marks = text;
  $('marks').replaceChildren(...value.marks.map(mark => {
    const words = `${clock(value.start + mark.time)}: ${mark.text}`;
    const item = make('button', {type: 'button', title: words, 'aria-label': `Go to the alarm of ${words}`, onclick: () => steer({time: mark.time})}, shape('critical', 'currentColor'));
    item.style.left = `${100 * mark.time / Math.max(value.length, 0.1)}%`;
    return item;
  }));
}

$('play').onclick = () => steer({playing: !now.playing});
$('speed').onclick = () => steer({speed: SPEEDS[(SPEEDS.indexOf(now.speed) + 1) % SPEEDS.length]});
$('time').oninput = () => { held = true; };
$('time').onchange = () => {
  held = false;
  steer({time: Number($('time').value)});
};
