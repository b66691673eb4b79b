// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The bar of alarms: it stands until all are cleared and acknowledged; its sound can be muted.

import {clock, iconOf, make, shape} from './symbols.js';

const MOST_ROWS = 200;
const BEEP_PERIOD = 2000;

export class Alarms {
  constructor(goTo, getMe) {
    this.goTo = goTo;
    this.getMe = getMe;
    this.open = [];
    this.counts = {critical: 0, warning: 0};
    this.elsewhere = 0;
    this.rings = false; // another vehicle has an alarm that stands and nobody has seen
    this.ringing = false;
    this.silent = false; // a replay rings no bell
    this.audio = null;
    this.bar = document.getElementById('alarms');
    this.list = document.getElementById('alarm-list');
    this.rows = new Map(); // by number: what is clicked must not be drawn anew meanwhile
    this.more = document.getElementById('alarm-more');
    this.more.onclick = () => this.unfold(this.bar.dataset.whole !== 'yes');
    addEventListener('resize', () => this.fit());
    this.dialog = document.getElementById('who');
    this.muted = localStorage.getItem('muted') === 'yes';
    document.getElementById('acknowledge-all').onclick = () => this.acknowledge(this.unseen());
    document.getElementById('sound').onclick = () => this.mute(!this.muted);
    document.getElementById('who-cancel').onclick = () => this.dialog.close('');
    document.getElementById('as-other').onclick = () => this.keepName('');
    this.keepName(localStorage.getItem('name'));
    this.dialog.addEventListener('close', () => this.dialog.returnValue === 'ok' && this.named());
    // Browsers play nothing before the first press of anything, and may stop later, as after a call or a sleep.
    for (const kind of ['pointerdown', 'keydown']) addEventListener(kind, () => this.plays() || this.wake());
    setInterval(() => this.beep(), BEEP_PERIOD);
    this.showSound();
  }

  unseen() {
    return this.open.filter(item => item.state !== 'acknowledged').map(item => item.number);
  }

  show(open) {
    this.open = open;
    this.ring();
    this.redraw();
  }

  redraw() {
    const text = JSON.stringify([this.open, this.counts, this.getMe().acknowledges]);
    if (text !== this.drawn) {
      this.drawn = text;
      this.draw();
    }
  }

  count(counts) {
    this.counts = counts;
    this.redraw();
  }

  draw() {
    const unseen = this.unseen(), may = this.getMe().acknowledges;
    const unsure = this.open.filter(item => item.state === 'unsure').length;
    this.bar.hidden = !this.open.length;
    this.bar.dataset.unseen = unseen.length;
    const {critical, warning} = this.counts;
    document.getElementById('alarm-sum').textContent = [
      `${critical} critical`, ...(unsure ? [`${unsure} may still be there`] : []), `${warning} warning${warning === 1 ? '' : 's'}`,
      unseen.length ? `${unseen.length} not acknowledged` : 'all acknowledged'].join(', ');
    document.getElementById('acknowledge-all').hidden = !unseen.length || !may;
    const shown = this.open.slice(0, MOST_ROWS), numbers = new Set(shown.map(item => item.number));
    for (const number of this.rows.keys()) if (!numbers.has(number)) this.rows.delete(number);
    const rows = shown.map(item => this.drawOne(item, may));
    if (rows.length !== this.list.children.length || rows.some((row, k) => row !== this.list.children[k])) this.list.replaceChildren(...rows);
    this.fit();
  }

  // Rows that the bar has no room for are counted, never cut off silently.
  fit() {
    const rows = [...this.list.children], whole = this.bar.dataset.whole === 'yes';
    for (const row of rows) row.hidden = false;
    let shown = rows.length;
    const tell = () => {
      this.more.hidden = !whole && shown === this.open.length;
      this.more.textContent = whole ? 'Fewer' : `+ ${this.open.length - shown} more`;
    };
    tell();
    while (!whole && shown > 1 && this.bar.scrollHeight > this.bar.clientHeight + 1) {
      rows[--shown].hidden = true;
      tell();
    }
    this.more.setAttribute('aria-expanded', String(whole));
  }

  unfold(whole) {
    this.bar.dataset.whole = whole ? 'yes' : 'no';
    this.fit();
  }

  drawOne(item, may) {
    const marks = {acknowledged: `seen by ${item.who} ${clock(item.acknowledged)}`, new: `NEW ${clock(item.raised)}`,
      cleared: `cleared ${clock(item.cleared)}, nobody saw it`, unsure: item.who ? `MAY STILL BE THERE, seen by ${item.who} before` : 'MAY STILL BE THERE'};
    const since = [item.state === 'new' ? '' : `since ${clock(item.raised)}`, item.times > 1 ? `${item.times} times` : '', item.stands ? '' : item.reason];
    const row = this.rows.get(item.number) ?? this.makeRow(item.number);
    row.item = item;
    row.dataset.state = item.state;
    for (const [name, text] of [['mark', marks[item.state]], ['what', item.text], ['since', since.filter(Boolean).join(', ')]]) {
      const part = row.querySelector(`.${name}`);
      if (part.textContent !== text) part.textContent = text;
    }
    const button = row.querySelector('.seen');
    button.hidden = item.state === 'acknowledged' || !may;
    button.setAttribute('aria-label', `Acknowledge ${item.text}`);
    return row;
  }

  makeRow(number) {
    const row = make('li', {'data-alarm': number}, shape('critical', '#fff'), make('span', {class: 'mark'}),
      make('button', {type: 'button', class: 'what', onclick: () => this.goTo(row.item)}), make('span', {class: 'since'}),
      make('button', {type: 'button', class: 'seen', onclick: () => this.acknowledge([number])}, 'Acknowledge'));
    this.rows.set(number, row);
    return row;
  }

  acknowledge(numbers) {
    if (!numbers.length || !this.getMe().acknowledges) return;
    this.wanted = {numbers, life: this.getMe().life}; // of another run of the monitor they are of other things
    const name = localStorage.getItem('name');
    if (name) return this.send(name);
    this.dialog.returnValue = '';
    const asked = this.open.filter(item => numbers.includes(item.number));
    document.getElementById('who-what').textContent = asked.length === 1 ? asked[0].text : `${asked.length} alarms: ${asked[0].text}; …`;
    this.dialog.showModal();
  }

  named() {
    const name = document.getElementById('name').value.trim();
    if (!name) return;
    this.keepName(name);
    this.send(name);
  }

  // Who acknowledges on this device, until it is somebody else.
  keepName(name) {
    if (name) localStorage.setItem('name', name);
    else localStorage.removeItem('name');
    document.getElementById('as').hidden = !name;
    document.getElementById('as-name').textContent = `Alarms are acknowledged as ${name}.`;
  }

  async send(who) {
    let problem = '';
    try {
      const answer = await fetch('/acknowledge', {
        method: 'POST', headers: {'Content-Type': 'application/json'},
        body: JSON.stringify({vehicle: this.getMe().vehicle, ...this.wanted, who}),
      });
      if (answer.ok) return;
      problem = await answer.text();
      if (answer.status === 400) this.keepName('');
    } catch {
      problem = 'the monitor does not answer';
    }
    document.getElementById('alarm-sum').textContent = `NOT acknowledged: ${problem}`;
  }

  mute(muted) {
    this.muted = muted;
    localStorage.setItem('muted', muted ? 'yes' : 'no');
    this.wake();
    this.showSound();
  }

  wake() {
    if (!this.audio) {
      this.audio = new AudioContext();
      this.audio.onstatechange = () => this.showSound();
    }
    this.audio.resume().then(() => this.showSound());
  }

  plays() {
    return this.audio?.state === 'running';
  }

  showSound() {
    const button = document.getElementById('sound');
    button.setAttribute('aria-pressed', String(!this.muted));
    button.textContent = this.muted ? 'Sound off' : this.plays() ? 'Sound on' : 'Sound: press once';
  }

  // The first tone comes with the alarm: browsers slow the timers of hidden pages down, to one call a minute.
  ring() {
    const before = this.ringing;
    this.ringing = this.rings || this.open.some(item => item.state === 'new');
    if (this.ringing && !before) this.beep();
  }

  beep() {
    if (this.muted || this.silent || !this.audio || !this.ringing) return;
    if (!this.plays()) return this.wake();
    const now = this.audio.currentTime;
    [880, 660].forEach((pitch, k) => {
      const tone = this.audio.createOscillator(), gain = this.audio.createGain();
      tone.frequency.value = pitch;
      gain.gain.setValueAtTime(0.25, now + 0.25 * k);
      gain.gain.exponentialRampToValueAtTime(0.001, now + 0.25 * k + 0.22);
      tone.connect(gain).connect(this.audio.destination);
      tone.start(now + 0.25 * k);
      tone.stop(now + 0.25 * k + 0.24);
    });
  }
}

// The line at the top, the tab's title and its icon.
export function showState(tone, text, alarms) {
  const line = document.getElementById('state'), words = document.getElementById('state-text');
  if (line.dataset.tone !== tone || !line.querySelector('svg')) {
    line.dataset.tone = tone;
    line.querySelector('.shape').replaceChildren(shape(tone, 'currentColor').firstChild);
  }
  if (words.textContent !== text) words.textContent = text;
  const unseen = alarms.unseen().length, standing = alarms.counts.critical;
  const worst = unseen || standing || alarms.elsewhere ? 'critical' : tone;
  const head = unseen ? `(${unseen}) ALARM` : standing ? `${standing} critical` : text.split(':')[0];
  const others = alarms.elsewhere ? ` (+${alarms.elsewhere} elsewhere)` : '';
  document.title = `${head}${others} – power line inspection`;
  const icon = document.getElementById('icon');
  if (icon.dataset.tone !== worst) {
    icon.dataset.tone = worst;
    icon.href = iconOf(worst);
  }
}
