'use strict';
// Sorting of tables and the three-dimensional view; the page works without either.

function sortTables() {
  for (const table of document.querySelectorAll('table.sort')) {
    table.querySelectorAll('th').forEach((head, column) => {
      head.tabIndex = 0;
      const sort = () => {
        const up = head.getAttribute('aria-sort') !== 'ascending';
        for (const other of table.querySelectorAll('th')) other.removeAttribute('aria-sort');
        head.setAttribute('aria-sort', up ? 'ascending' : 'descending');
        const key = (row) => {
          const cell = row.cells[column];
          const text = cell.dataset.v ?? cell.textContent.trim();
          const number = parseFloat(text.replace(/,/g, '').replace('\u2212', '-'));
          return Number.isNaN(number) ? text : number;
        };
        const body = table.tBodies[0];
        const rows = [...body.rows].map((row, place) => [key(row), place, row]);
        rows.sort(([a, i], [b, j]) => {
          const mixed = typeof a !== typeof b ? (typeof a === 'number' ? -1 : 1) : 0;
          const order = mixed || (a < b ? -1 : a > b ? 1 : 0);
          return (up ? order : mixed || -order) || i - j;
        });
        body.append(...rows.map((item) => item[2]));
      };
      head.addEventListener('click', sort);
      head.addEventListener('keydown', (event) => { if (event.key === 'Enter') sort(); });
    });
  }
}

const VERTEX = `
attribute vec3 place; attribute vec3 color; varying vec3 tint;
uniform mat4 view; uniform vec3 low, size; uniform float dot_size;
void main() {
  gl_Position = view * vec4(low + place * size, 1.0);
  gl_PointSize = clamp(dot_size / gl_Position.w, 1.0, 9.0);
  tint = color;
}`;
const FRAGMENT = `
precision mediump float; varying vec3 tint;
void main() { gl_FragColor = vec4(tint, 1.0); }`;

function decode(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes.buffer;
}

function toColor(text) { return [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16)); }

class View {
  constructor(box, data) {
    this.box = box;
    this.data = data;
    this.canvas = box.querySelector('canvas');
    this.gl = this.canvas.getContext('webgl', { antialias: true, preserveDrawingBuffer: true });
    if (!this.gl) throw new Error('no WebGL');
    this.build();
    this.home();
    this.listen();
    new ResizeObserver(() => this.ask()).observe(this.canvas);
  }

  build() {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    gl.useProgram(program);
    this.at = Object.fromEntries(['place', 'color'].map((n) => [n, gl.getAttribLocation(program, n)]));
    this.set = Object.fromEntries(['view', 'low', 'size', 'dot_size'].map(
      (n) => [n, gl.getUniformLocation(program, n)]));
    const d = this.data;
    const palette = d.palette.map(toColor);
    const index = new Uint8Array(decode(d.colors));
    const colors = new Uint8Array(index.length * 3);
    for (let i = 0; i < index.length; i++) colors.set(palette[index[i]], 3 * i);
    this.cloud = this.upload(new Uint16Array(decode(d.points)), colors, gl.POINTS, d.low, d.size,
      gl.UNSIGNED_SHORT, index.length);
    const ends = [];
    const tints = [];
    for (const line of d.lines) {
      const tint = toColor(line.color);
      for (let i = 0; i + 5 < line.xyz.length; i += 3) {
        ends.push(...line.xyz.slice(i, i + 6));
        tints.push(...tint, ...tint);
      }
    }
    this.wires = this.upload(new Float32Array(ends), new Uint8Array(tints), gl.LINES, [0, 0, 0],
      [1, 1, 1], gl.FLOAT, ends.length / 3);
    this.labels = d.hazards.map((item) => {
      const label = document.createElement('button');
      label.className = 'pin';
      label.textContent = item.id;
      label.title = item.title;
      label.style.setProperty('--c', item.color);
      label.addEventListener('click', () => this.show(item.id));
      this.box.append(label);
      return label;
    });
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.93, 0.95, 0.97, 1);
  }

  upload(places, colors, mode, low, size, type, count) {
    const gl = this.gl;
    const buffer = (data) => {
      const made = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      return made;
    };
    return { places: buffer(places), colors: buffer(colors), mode, low, size, type, count };
  }

  home() {
    const d = this.data;
    this.target = d.center.slice();
    this.azimuth = d.azimuth;
    this.elevation = 0.45;
    const shape = this.canvas.clientWidth / Math.max(this.canvas.clientHeight, 1);
    this.distance = Math.max(0.75, 1.5 / shape) * d.extent + 20 * d.metre;
    this.ask();
  }

  show(id) {
    const item = this.data.hazards.find((other) => other.id === id);
    if (!item) return;
    this.target = item.xyz.slice();
    this.distance = 35 * this.data.metre;
    this.elevation = 0.25;
    this.ask();
  }

  eye() {
    const c = Math.cos(this.elevation);
    return [c * Math.cos(this.azimuth), c * Math.sin(this.azimuth), Math.sin(this.elevation)];
  }

  matrix() {
    const back = this.eye();
    const right = [-Math.sin(this.azimuth), Math.cos(this.azimuth), 0];
    const up = [
      back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2],
      back[0] * right[1] - back[1] * right[0],
    ];
    this.axes = { right, up };
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const camera = this.target.map((value, i) => value + this.distance * back[i]);
    const near = Math.max(this.distance / 200, 0.05 * this.data.metre);
    const far = this.distance + 2 * this.data.extent + 500 * this.data.metre;
    const f = 1 / Math.tan(0.4);
    const g = f / (this.canvas.width / this.canvas.height);
    const depth = (far + near) / (near - far);
    const shift = 2 * far * near / (near - far);
    const x = right.concat(-dot(right, camera));
    const y = up.concat(-dot(up, camera));
    const z = back.concat(-dot(back, camera));
    const result = [];
    for (let i = 0; i < 4; i++) {
      result.push(g * x[i], f * y[i], depth * z[i] + (i === 3 ? shift : 0), -z[i]);
    }
    return result;
  }

  ask() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  draw() {
    const gl = this.gl;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.canvas.width = Math.max(this.canvas.clientWidth * ratio, 2);
    this.canvas.height = Math.max(this.canvas.clientHeight * ratio, 2);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const view = this.matrix();
    gl.uniformMatrix4fv(this.set.view, false, new Float32Array(view));
    gl.uniform1f(this.set.dot_size, 0.12 * this.data.metre * this.canvas.height);
    for (const part of [this.cloud, this.wires]) {
      gl.uniform3fv(this.set.low, part.low);
      gl.uniform3fv(this.set.size, part.size);
      for (const [name, type, normal] of [['place', part.type, part.type !== gl.FLOAT],
        ['color', gl.UNSIGNED_BYTE, true]]) {
        gl.bindBuffer(gl.ARRAY_BUFFER, name === 'place' ? part.places : part.colors);
        gl.enableVertexAttribArray(this.at[name]);
        gl.vertexAttribPointer(this.at[name], 3, type, normal, 0, 0);
      }
      if (part.count) gl.drawArrays(part.mode, 0, part.count);
    }
    this.pin(view);
    if (!document.body.dataset.firstView) {
      gl.finish();
      document.body.dataset.firstView = Math.round(performance.now());
    }
  }

  pin(view) {
    this.data.hazards.forEach((item, i) => {
      const [x, y, z] = item.xyz;
      const [a, b, , w] = [0, 1, 2, 3].map(
        (k) => view[k] * x + view[4 + k] * y + view[8 + k] * z + view[12 + k]);
      const label = this.labels[i];
      label.hidden = w <= 0 || Math.abs(a / w) > 1 || Math.abs(b / w) > 1;
      label.style.left = `${50 + 50 * a / w}%`;
      label.style.top = `${50 - 50 * b / w}%`;
    });
  }

  listen() {
    const held = new Map();
    const canvas = this.canvas;
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
    });
    for (const name of ['pointerup', 'pointercancel']) {
      canvas.addEventListener(name, (event) => held.delete(event.pointerId));
    }
    canvas.addEventListener('pointermove', (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before[0];
      const dy = event.clientY - before[1];
      const spread = () => {
        const [a, b] = [...held.values()];
        return Math.hypot(a[0] - b[0], a[1] - b[1]);
      };
      const apart = held.size === 2 ? spread() : 0;
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size === 2) {
        this.distance *= apart / Math.max(spread(), 1);
      } else if (event.buttons & 2 || event.shiftKey) {
        const step = 0.85 * this.distance / canvas.clientHeight;
        this.target = this.target.map(
          (value, i) => value + step * (dy * this.axes.up[i] - dx * this.axes.right[i]));
      } else {
        this.azimuth -= dx * 0.006;
        this.elevation = Math.min(Math.max(this.elevation + dy * 0.006, -0.2), 1.55);
      }
      this.ask();
    });
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.distance *= Math.exp(event.deltaY * 0.0012);
      this.ask();
    }, { passive: false });
    this.box.querySelector('.home').addEventListener('click', () => this.home());
    for (const link of document.querySelectorAll('[data-show]')) {
      link.addEventListener('click', () => {
        this.show(Number(link.dataset.show));
        this.box.scrollIntoView({ block: 'center' });
      });
    }
  }
}

sortTables();
const box = document.getElementById('scene');
if (box) {
  try {
    window.view = new View(box, JSON.parse(document.getElementById('scene-data').textContent));
  } catch (error) {
    box.classList.add('failed');
    document.body.dataset.firstView = 'none';
  }
}
