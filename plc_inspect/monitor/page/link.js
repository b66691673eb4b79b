// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The connections to the monitor, in a worker: what comes in is answered at once, however long the page
// draws, so that the monitor tells a busy page from a full link. Asked for by {query}; {id, taken} says
// that the page has a message of so many bytes, {id, pin} what to ask for when it opens again.

const MOST_AHEAD = 1 << 20; // bytes that may wait for the page before answers wait too
const LONGEST_WAIT = 5000;
// The monitor tells its time several times a second: where the page has heard nothing for so long, its
// connections are dead, also where no end of them came through (a long gap of the link, a sleep) [ms].
const SILENCE = 10000;
const PACED = /^\{"part":"[^"]*","value"/; // rows of tables; all else but points comes at once

const links = [];

class Link {
  constructor(id, query) {
    this.id = id;
    this.query = query;
    this.ahead = this.owed = 0;
    this.open(500);
  }

  open(wait) {
    const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
    this.owed = 0;
    this.socket = new WebSocket(`${scheme}://${location.host}/live?${this.query}`);
    this.socket.binaryType = 'arraybuffer';
    this.heard = performance.now();
    this.socket.onopen = () => { wait = 250; };
    this.socket.onmessage = ({data}) => this.pass(data);
    this.socket.onclose = () => setTimeout(() => this.open(Math.min(2 * wait, LONGEST_WAIT)), wait);
  }

  // Leave a connection without waiting for its other end.
  renew() {
    const {socket} = this;
    if (socket.readyState !== WebSocket.OPEN) return; // it opens again by itself
    socket.onmessage = socket.onclose = null;
    socket.close();
    this.open(500);
  }

  pass(data) {
    this.heard = performance.now();
    const isText = typeof data === 'string';
    this.ahead += isText ? data.length : data.byteLength;
    if (!isText || PACED.test(data)) this.owed += 1;
    postMessage({id: this.id, data}, isText ? [] : [data]);
    this.answer();
  }

  answer() {
    if (this.ahead > MOST_AHEAD || this.socket.readyState !== WebSocket.OPEN) return;
    for (; this.owed; this.owed--) this.socket.send('.');
  }
}

// The first connection has the state; the others are silent while there is no news of alarms.
setInterval(() => {
  if (links.length && performance.now() - links[0].heard > SILENCE) for (const link of links) link.renew();
}, 1000);

onmessage = ({data}) => {
  if ('query' in data) return links.push(new Link(links.length, data.query));
  if ('pin' in data) return links[data.id].query = data.pin;
  links[data.id].ahead -= data.taken;
  links[data.id].answer();
};
