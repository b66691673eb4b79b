// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The 3D picture: corridor, catenaries, structures, hazards, the vehicle, and where one looks from.

import * as THREE from 'three';
import {OrbitControls} from 'three/controls/OrbitControls.js';
import {LineMaterial} from 'three/lines/LineMaterial.js';
import {LineSegments2} from 'three/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/lines/LineSegmentsGeometry.js';

import {corners, make, metres, table} from './symbols.js';

const UNIT = 0.01;
// Points drawn: fewer where frames take longer than 50 ms, more where they take less than 25 ms.
const LEAST_POINTS = 20000, MOST_POINTS = 600000, SLOW = 50, QUICK = 25;
// Where fewer points do not help the picture gets coarser, down to so many pixels for each of the screen.
const COARSEST = 0.6, FINEST = 1.5;
const MOST_LABELS = 8;
const BEHIND = [-30, 22], NEAR = [-13, 9];
const VEHICLE = 0x3f8fe0, TOWER = 0x9999a6, GROUND = 0x8a6d5a;
// Colours come as on the screen, and the renderer counts in light.
const LIGHT = Uint8Array.from({length: 256}, (_, k) => Math.round(255 * new THREE.Color().setRGB(k / 255, 0, 0, THREE.SRGBColorSpace).r));
const ORDER = {critical: 3, warning: 2, notice: 1};
const SKY = {dark: 0x18202a, light: 0xdfe7ee};

export class Scene {
  constructor(canvas, chooseHazard) {
    this.canvas = canvas;
    this.chooseHazard = chooseHazard;
    this.origin = null;
    this.view = 'follow';
    this.vehicle = this.heading = null;
    this.blocks = new Map();
    this.hazards = [];
    this.spans = this.supports = [];
    this.parts = {};
    this.budget = 150000;
    this.total = 0;
    this.finest = FINEST;
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: true});
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 1.5);
    sun.position.set(1, -2, 4);
    this.scene.add(sun);
    this.camera = new THREE.PerspectiveCamera(55, 1, 0.5, 6000);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(-35, -35, 30);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('start', () => { if (this.view !== 'follow') this.setView('free'); });
    this.controls.addEventListener('change', () => { this.dirty = true; });
    this.materials = {};
    for (const [name, look] of Object.entries(table)) this.materials[name] = makeSprite(look);
    this.labels = document.getElementById('labels');
    canvas.addEventListener('pointerdown', event => { this.pressed = [event.clientX, event.clientY]; });
    canvas.addEventListener('pointerup', event => this.pick(event));
    canvas.addEventListener('keydown', event => this.turn(event));
    canvas.addEventListener('webglcontextlost', event => event.preventDefault());
    new ResizeObserver(() => { this.resize(); }).observe(canvas.parentElement);
    this.resize();
    this.frames = [];
    requestAnimationFrame(time => this.loop(time));
  }

  setTheme(theme) {
    this.scene.background = new THREE.Color(SKY[theme]);
    this.dirty = true;
  }

  resize() {
    const box = this.canvas.parentElement;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, this.finest));
    this.renderer.setSize(box.clientWidth, box.clientHeight, false);
    this.camera.aspect = box.clientWidth / Math.max(box.clientHeight, 1);
    this.camera.updateProjectionMatrix();
    for (const part of Object.values(this.parts)) part?.material?.resolution?.set(box.clientWidth, box.clientHeight);
    this.dirty = true;
  }

  local(place) {
    return new THREE.Vector3(place[0] - this.origin[0], place[1] - this.origin[1], place[2] - this.origin[2]);
  }

  // The first place that is known becomes the middle of the picture's own coordinates.
  find(place) {
    if (this.origin || !place) return;
    this.origin = place.map(value => Math.round(value / 10) * 10);
    this.controls.target.copy(this.local(place));
    this.look(place, BEHIND);
    for (const [key, data] of this.waiting ?? []) this.takeBlock(data, key);
    this.waiting = null;
    this.showSupports(this.supports);
    if (this.spans.length) this.showSpans(this.spans);
    if (this.hazards.length) this.showHazards(this.hazards);
  }

  takeBlock(data) {
    const view = new DataView(data);
    const key = `${view.getInt32(0, true)}/${view.getInt32(4, true)}`;
    if (!this.origin) {
      (this.waiting ??= new Map()).set(key, data);
      return;
    }
    const middle = [8, 16, 24].map(at => view.getFloat64(at, true));
    const edge = view.getFloat32(32, true), count = view.getUint32(36, true);
    const old = this.blocks.get(key);
    if (old) {
      this.scene.remove(old);
      old.geometry.dispose();
      this.total -= old.userData.count;
      this.blocks.delete(key);
    }
    this.dirty = true;
    if (!count) return;
    const places = new Int16Array(data.slice(40, 40 + 6 * count));
    const colors = new Uint8Array(data, 40 + 6 * count, 3 * count);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(places, 3, false));
    geometry.setAttribute('color', new THREE.BufferAttribute(colors.map(value => LIGHT[value]), 3, true));
    geometry.computeBoundingSphere();
    this.pointMaterials ??= new Map();
    if (!this.pointMaterials.has(edge)) {
      this.pointMaterials.set(edge, new THREE.PointsMaterial({size: edge * 0.8, vertexColors: true}));
    }
    const points = new THREE.Points(geometry, this.pointMaterials.get(edge));
    points.scale.setScalar(UNIT);
    points.position.copy(this.local(middle));
    points.updateMatrixWorld();
    points.matrixAutoUpdate = false;
    points.userData.count = count;
    this.total += count;
    this.blocks.set(key, points);
    this.scene.add(points);
  }

  clearBlocks() {
    for (const points of this.blocks.values()) {
      this.scene.remove(points);
      points.geometry.dispose();
    }
    this.blocks.clear();
    this.waiting = null;
    this.total = 0;
    this.origin = null;
    this.view = 'follow';
  }

  put(name, part) {
    const old = this.parts[name];
    if (old) {
      this.scene.remove(old);
      old.traverse(item => { item.geometry?.dispose(); });
    }
    this.parts[name] = part;
    if (part) this.scene.add(part);
    this.dirty = true;
  }

  lines(places, colors, width, dashed = false) {
    if (!places.length) return null;
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(places.flat());
    if (Array.isArray(colors)) geometry.setColors(colors.flat());
    const material = new LineMaterial({linewidth: width, vertexColors: Array.isArray(colors), dashed, dashSize: 1, gapSize: 0.7,
      ...(Array.isArray(colors) ? {} : {color: colors})});
    const box = this.canvas.parentElement;
    material.resolution.set(box.clientWidth, box.clientHeight);
    const result = new LineSegments2(geometry, material);
    if (dashed) result.computeLineDistances();
    result.frustumCulled = false;
    return result;
  }

  showSpans(items) {
    this.spans = items;
    if (!this.origin && items.length) this.find(items[0].curve[0]);
    if (!this.origin) return;
    const places = [], colors = [];
    for (const item of items) {
      const own = new THREE.Color(table[item.severity].color).toArray();
      for (let k = 1; k < item.curve.length; k++) {
        places.push([...this.local(item.curve[k - 1]).toArray(), ...this.local(item.curve[k]).toArray()]);
        colors.push([...own, ...own]);
      }
    }
    this.put('spans', this.lines(places, colors, 4));
    const ground = [];
    for (const {ground_line: line} of items) {
      for (let k = 1; k < line.length; k++) ground.push([...this.local(line[k - 1]).toArray(), ...this.local(line[k]).toArray()]);
    }
    this.put('ground', this.lines(ground, GROUND, 3));
  }

  showSupports(items) {
    this.supports = items;
    if (!this.origin) return;
    const places = items.map(item => {
      const foot = this.local(item.position);
      return [...foot.toArray(), foot.x, foot.y, foot.z + Math.max(item.height, 0.5)];
    });
    this.put('supports', this.lines(places, TOWER, 7));
  }

  showHazards(items) {
    this.hazards = items;
    if (!this.origin && items.length) this.find(items[0].position);
    if (!this.origin) return;
    const group = new THREE.Group();
    for (const item of items) {
      const sprite = new THREE.Sprite(this.materials[item.severity]);
      sprite.position.copy(this.local(item.position));
      sprite.userData.hazard = item.id;
      sprite.renderOrder = 2 + ORDER[item.severity];
      group.add(sprite);
    }
    this.put('hazards', items.length ? group : null);
  }

  showTrack(places) {
    if (!this.origin) return;
    const own = places.map(place => this.local(place).toArray());
    this.put('track', own.length > 1 ? this.lines(own.slice(1).map((place, k) => [...own[k], ...place]), VEHICLE, 2) : null);
  }

  showVehicle(place, heading, height, near) {
    this.find(place);
    if (!this.origin || !place) return;
    const moved = !this.vehicle || place.some((value, k) => Math.abs(value - this.vehicle[k]) > 0.02);
    const before = this.vehicle;
    this.vehicle = place;
    const text = JSON.stringify([place, heading, height, near]);
    if (text === this.vehicleText) return;
    this.vehicleText = text;
    const at = this.local(place), group = new THREE.Group();
    const body = new THREE.Mesh(new THREE.ConeGeometry(0.9, 2.6, 16), new THREE.MeshLambertMaterial({color: VEHICLE}));
    body.geometry.rotateZ(-Math.PI / 2);
    body.rotation.z = heading ?? 0;
    body.position.copy(at);
    this.body = body;
    group.add(body);
    if (height !== null) {
      const stem = this.lines([[at.x, at.y, at.z, at.x, at.y, at.z - height]], VEHICLE, 2, true);
      group.add(stem);
    }
    const wire = near.find(item => item.thing === 'conductor' && item.place);
    if (wire) {
      const end = this.local(wire.place);
      group.add(this.lines([[...at.toArray(), ...end.toArray()]], new THREE.Color(table[wire.tone].color), 3, true));
    }
    this.wire = wire;
    this.put('vehicle', group);
    if (this.view === 'follow' && moved) {
      const shift = before ? at.clone().sub(this.local(before)) : at.clone().sub(this.controls.target);
      this.controls.target.copy(at);
      this.camera.position.add(shift);
    }
  }

  look(place, [back, up]) {
    const target = this.local(place);
    this.controls.target.copy(target);
    this.camera.position.set(target.x + back, target.y + back, target.z + up);
    this.dirty = true;
  }

  goTo(place) {
    if (!place || !this.origin) return;
    this.setView('free');
    this.look(place, NEAR);
  }

  // All that is known, as a sphere.
  extent() {
    const box = new THREE.Box3();
    for (const span of this.spans) for (const place of span.curve) box.expandByPoint(this.local(place));
    for (const item of this.supports) box.expandByPoint(this.local(item.position));
    if (this.vehicle) box.expandByPoint(this.local(this.vehicle));
    return box.isEmpty() ? new THREE.Sphere(this.controls.target.clone(), 30) : box.getBoundingSphere(new THREE.Sphere());
  }

  // Along the line in plan: from the longest span, or the way from the first to the last place.
  direction() {
    const longest = [...this.spans].sort((a, b) => b.length - a.length)[0];
    if (!longest) return new THREE.Vector3(1, 0, 0);
    const ends = [longest.curve[0], longest.curve.at(-1)].map(place => this.local(place));
    return ends[1].sub(ends[0]).setZ(0).normalize();
  }

  setView(view) {
    this.view = view;
    for (const button of document.querySelectorAll('[data-view]')) {
      button.setAttribute('aria-pressed', String(button.dataset.view === view));
    }
    if (view === 'free' || !this.origin) return;
    if (view === 'follow') {
      if (this.vehicle) this.look(this.vehicle, BEHIND);
      return;
    }
    const {center, radius} = this.extent();
    const narrow = Math.min(1, this.camera.aspect);
    const far = 1.2 * Math.max(radius, 15) / Math.sin(this.camera.fov / 2 * Math.PI / 180) / narrow;
    const along = this.direction(), across = new THREE.Vector3(-along.y, along.x, 0);
    this.controls.target.copy(center);
    this.camera.position.copy(center);
    if (view === 'top') this.camera.position.add(new THREE.Vector3(0, -0.001 * far, 0.9 * far));
    if (view === 'side') this.camera.position.addScaledVector(across, -0.8 * far).add(new THREE.Vector3(0, 0, 0.02 * far));
    if (view === 'overview') this.camera.position.addScaledVector(across, -0.65 * far).addScaledVector(along, -0.3 * far).add(new THREE.Vector3(0, 0, 0.45 * far));
    this.dirty = true;
  }

  turn(event) {
    const offset = this.camera.position.clone().sub(this.controls.target);
    const ball = new THREE.Spherical().setFromVector3(new THREE.Vector3(offset.x, offset.z, -offset.y));
    const step = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]}[event.key];
    const zoom = {'+': 0.85, '=': 0.85, '-': 1.18}[event.key];
    if (!step && !zoom) return;
    event.preventDefault();
    if (step) {
      ball.theta += step[0];
      ball.phi = Math.min(Math.max(ball.phi + step[1], 0.01), Math.PI - 0.01);
    }
    ball.radius *= zoom ?? 1;
    const turned = new THREE.Vector3().setFromSpherical(ball);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(turned.x, -turned.z, turned.y));
    if (this.view !== 'follow') this.setView('free');
    this.dirty = true;
  }

  pick(event) {
    if (!this.pressed || Math.hypot(event.clientX - this.pressed[0], event.clientY - this.pressed[1]) > 6) return;
    const box = this.canvas.getBoundingClientRect();
    let best = [26, null];
    for (const item of this.hazards) {
      const at = this.project(item.position, box);
      const apart = at && Math.hypot(at[0] - (event.clientX - box.left), at[1] - (event.clientY - box.top));
      if (at && apart < best[0]) best = [apart, item.id];
    }
    if (best[1] !== null) this.chooseHazard(best[1]);
  }

  project(place, box) {
    const at = this.local(place).project(this.camera);
    if (at.z > 1 || Math.abs(at.x) > 1.05 || Math.abs(at.y) > 1.05) return null;
    return [(at.x + 1) / 2 * box.width, (1 - at.y) / 2 * box.height];
  }

  // Each block shows its share of the budget, near ones more than far ones.
  thin() {
    const weights = [];
    let sum = 0;
    for (const points of this.blocks.values()) {
      const apart = points.position.distanceTo(this.camera.position);
      const weight = points.userData.count / (1 + (apart / 80) ** 2);
      weights.push([points, weight]);
      sum += weight;
    }
    for (const [points, weight] of weights) {
      const {count} = points.userData;
      points.geometry.setDrawRange(0, this.total <= this.budget ? count : Math.ceil(Math.min(count, this.budget * weight / sum)));
    }
  }

  loop(time) {
    requestAnimationFrame(next => this.loop(next));
    this.controls.update();
    if (!this.dirty && time - (this.drawn ?? 0) < 500) return;
    this.dirty = false;
    this.thin();
    this.sizeSprites();
    const began = performance.now();
    this.renderer.render(this.scene, this.camera);
    if (this.blocks.size && this.total > LEAST_POINTS) this.adapt(began);
    this.drawn = time;
    if (this.origin) this.drawAround();
  }

  adapt(began) {
    // Reading one pixel waits until the frame is drawn, also in software.
    const context = this.renderer.getContext();
    context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));
    const spent = performance.now() - began;
    this.spent = spent;
    const drawn = Math.min(this.budget, this.total);
    if (spent > SLOW && this.budget <= LEAST_POINTS && this.finest > COARSEST) {
      this.finest = Math.max(COARSEST, Math.min(this.finest, devicePixelRatio) * 0.85);
      this.resize();
    } else if (spent > SLOW) this.budget = Math.max(LEAST_POINTS, Math.round(drawn * 0.8));
    else if (spent < QUICK && this.budget < this.total) this.budget = Math.min(MOST_POINTS, Math.round(this.budget * 1.1));
  }

  // Signs of hazards, and the vehicle where it is far, are as large on the screen wherever they are.
  sizeSprites() {
    for (const sprite of this.parts.hazards?.children ?? []) {
      sprite.scale.setScalar(sprite.position.distanceTo(this.camera.position) * 0.055);
    }
    this.body?.scale.setScalar(Math.max(1, this.body.position.distanceTo(this.camera.position) * 0.018));
  }

  drawAround() {
    const box = this.canvas.getBoundingClientRect();
    const labels = [];
    for (const item of [...this.hazards].sort((a, b) => ORDER[b.severity] - ORDER[a.severity]).slice(0, MOST_LABELS)) {
      const at = this.project(item.position, box);
      if (at) labels.push([at, `${item.kind} ${metres(item.clearance, 2)}`]);
    }
    if (this.vehicle && this.wire) {
      const middle = this.vehicle.map((value, k) => (value + this.wire.place[k]) / 2);
      const at = this.project(middle, box);
      if (at) labels.push([at, metres(this.wire.distance)]);
    }
    const ids = this.supports.slice(0, 40).map(item => [this.project([item.position[0], item.position[1], item.position[2] + item.height], box), `structure ${item.id}`]);
    labels.push(...ids.filter(([at]) => at));
    const free = [];
    this.labels.replaceChildren(...labels.filter(([at, text]) => {
      const wide = 8 * text.length + 10;
      if (free.some(([other, width]) => Math.abs(other[0] - at[0]) < (wide + width) / 2 && Math.abs(other[1] - at[1]) < 26)) return false;
      free.push([at, wide]);
      return true;
    }).map(([at, text]) => {
      const item = make('span', {}, text);
      item.style.left = `${at[0]}px`;
      item.style.top = `${at[1]}px`;
      return item;
    }));
    const apart = this.camera.position.distanceTo(this.controls.target);
    const perPixel = 2 * apart * Math.tan(this.camera.fov / 2 * Math.PI / 180) / Math.max(box.height, 1);
    const raw = 90 * perPixel, unit = 10 ** Math.floor(Math.log10(raw));
    const length = [5, 2, 1].map(k => k * unit).find(value => value <= raw) ?? unit;
    document.getElementById('scale-bar').style.width = `${length / perPixel}px`;
    document.getElementById('scale-text').textContent = `${length >= 1 ? length : length.toFixed(1)} m`;
    const offset = this.controls.target.clone().sub(this.camera.position);
    const up = Math.hypot(offset.x, offset.y) > 0.01 * apart ? offset : new THREE.Vector3(0, 1, 0);
    document.getElementById('needle').setAttribute('transform', `rotate(${-Math.atan2(up.x, up.y) * 180 / Math.PI})`);
  }
}

// The sign of a severity as a picture: shape, colour and mark of the table.
function makeSprite(look) {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 96;
  const paint = canvas.getContext('2d');
  paint.translate(48, look.corners === 3 ? 54 : 48);
  paint.beginPath();
  if (look.corners) corners(look.corners, 42).forEach(([x, y], k) => (k ? paint.lineTo(x, y) : paint.moveTo(x, y)));
  else paint.arc(0, 0, 38, 0, 2 * Math.PI);
  paint.closePath();
  paint.fillStyle = look.color;
  paint.fill();
  paint.lineWidth = 6;
  paint.strokeStyle = '#fff';
  paint.stroke();
  paint.lineWidth = 2;
  paint.strokeStyle = '#000';
  paint.stroke();
  paint.fillStyle = look.ink;
  paint.font = '800 50px sans-serif';
  paint.textAlign = 'center';
  paint.textBaseline = 'middle';
  paint.fillText({critical: '!', warning: '!', notice: 'i', ok: ''}[look.name], 0, 4);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  return new THREE.SpriteMaterial({map: texture, depthTest: false});
}
