// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The rows of a table, which come some at a time, and the order in which they stand.

const SETTLE = 100; // what comes within so long is shown together [ms]

export class Rows {
  constructor(show) {
    this.values = new Map();
    this.keys = [];
    this.shown = show;
    this.due = null;
  }

  take(rows) {
    for (const [key, value] of rows) this.values.set(key, value);
    this.soon();
  }

  order(keys) {
    this.keys = keys;
    const there = new Set(keys);
    for (const key of this.values.keys()) if (!there.has(key)) this.values.delete(key);
    this.soon();
  }

  soon() {
    this.due ??= setTimeout(() => this.show(), SETTLE);
  }

  show() {
    clearTimeout(this.due);
    this.due = null;
    this.shown(this.keys.map(key => this.values.get(key)).filter(value => value !== undefined));
  }
}
