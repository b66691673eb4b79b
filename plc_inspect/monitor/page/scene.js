// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The 3D picture: corridor, catenaries, structures, hazards, the vehicle, and where one looks from.

import * as THREE from 'three';
import {OrbitControls} from 'three/controls/OrbitControls.js';
import {LineMaterial} from 'three/lines/LineMaterial.js';
import {LineSegments2} from 'three/lines/LineSegments2.js';
import {LineSegmentsGeometry} from 'three/lines/LineSegmentsGeometry.js';

import {drawAround} from './around.js';
import {Points} from './points.js';
import {corners, order, table} from './symbols.js';

// A curve has so many pieces that none is farther from it than this [px]; all curves at most so many.
const STRAY = 1, MOST_PIECES = 4000;
// Overviews fill so much of the picture, from its middle to its edge.
const FITS = 4, FILLED = 0.9;
// The flown way is drawn without places nearer than this [m] to the straight line between others.
const WAY_STRAY = 0.3;
// Ground below the line is drawn so near to the camera [m].
const GROUND_REACH = 800;
const SIGN = 0.05; // of the height of the picture
const REBUILD = 300; // curves are drawn anew for a camera that moved no more often [ms]
const REST = 400; // the picture is at rest after so long [ms]
const BEHIND = [-30, 22], NEAR = [-13, 9];
const VEHICLE = 0x3f8fe0, TOWER = 0x9999a6, GROUND = 0x8a6d5a;
const SKY = {dark: 0x18202a, light: 0xdfe7ee};
// Conductors have dark edges, or light colours are not seen before a light sky: a share of their width.
const EDGE = 0.34, EDGED = `#include <color_fragment>
  if (abs(vUv.x) > ${1 - EDGE}) diffuseColor.rgb = vec3(0.02);`;

export class Scene {
  constructor(canvas, chooseHazard) {
    this.canvas = canvas;
    this.chooseHazard = chooseHazard;
    this.origin = null;
    this.view = 'follow';
    this.vehicle = this.heading = null;
    this.hazards = [];
    this.spans = this.supports = [];
    this.parts = {};
    this.curves = new WeakMap();
    this.spent = {turned: [], still: []};
    this.turning = false; // by a pointer
    this.turned = -Infinity;
    this.pace = 'still';
    const soft = drawsInSoftware();
    // Without alpha the browser need not blend the picture with what is behind it.
    const context = canvas.getContext('webgl2', {alpha: false, antialias: !soft, stencil: false});
    if (!context) throw new Error('WebGL 2 is missing');
    this.renderer = new THREE.WebGLRenderer({canvas, context});
    this.scene = new THREE.Scene();
    this.points = new Points(this.scene, place => this.local(place), soft);
    this.scene.add(new THREE.AmbientLight(0xffffff, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 1.5);
    sun.position.set(1, -2, 4);
    this.scene.add(sun);
    this.camera = new THREE.PerspectiveCamera(55, 1, 0.5, 6000);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(-35, -35, 30);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener('start', () => { this.turning = true; });
    this.controls.addEventListener('end', () => { this.turning = false; });
    this.controls.addEventListener('start', () => { if (this.view !== 'follow') this.setView('free'); });
    this.controls.addEventListener('change', () => {
      this.dirty = true;
      if (this.turning) this.turned = performance.now();
    });
    this.materials = {};
    for (const [name, look] of Object.entries(table)) this.materials[name] = makeSign(look);
    this.labels = document.getElementById('labels');
    canvas.addEventListener('pointerdown', event => { this.pressed = [event.clientX, event.clientY]; });
    canvas.addEventListener('pointerup', event => this.pick(event));
    canvas.addEventListener('keydown', event => this.turn(event));
    canvas.addEventListener('webglcontextlost', event => event.preventDefault());
    const sizes = new ResizeObserver(() => { this.resize(); });
    sizes.observe(canvas.parentElement);
    sizes.observe(document.getElementById('instruments'));
    this.resize();
    requestAnimationFrame(time => this.loop(time));
  }

  setTheme(theme) {
    this.scene.background = new THREE.Color(SKY[theme]);
    this.dirty = true;
  }

  resize() {
    const box = this.canvas.parentElement;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, this.points.finest));
    this.renderer.setSize(box.clientWidth, box.clientHeight, false);
    this.camera.aspect = box.clientWidth / Math.max(box.clientHeight, 1);
    // Where the numbers reach over the middle, the middle of the picture is below them.
    const numbers = document.getElementById('instruments');
    const covered = numbers.offsetWidth > 0.5 * box.clientWidth ? numbers.offsetTop + numbers.offsetHeight : 0;
    this.camera.setViewOffset(box.clientWidth, Math.max(box.clientHeight, 1), 0, -covered / 2, box.clientWidth, Math.max(box.clientHeight, 1));
    for (const look of Object.values(this.materials)) look.size = SIGN * box.clientHeight;
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
    for (const data of this.waiting ?? []) this.points.take(data);
    this.waiting = null;
    this.showSupports(this.supports);
    if (this.spans.length) this.showSpans(this.spans);
    if (this.hazards.length) this.showHazards(this.hazards);
  }

  takeBlock(data) {
    if (this.origin) this.points.take(data);
    else (this.waiting ??= []).push(data);
    this.dirty = true;
  }

  clearPoints() {
    this.points.clear();
    this.waiting = null;
    this.dirty = true;
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

  lines(places, colors, width, {dashed = false, depth = true, edged = false} = {}) {
    if (!places.length) return null;
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(places);
    if (Array.isArray(colors)) geometry.setColors(colors);
    const material = new LineMaterial({linewidth: width, vertexColors: Array.isArray(colors), dashed, dashSize: 1, gapSize: 0.7,
      ...(Array.isArray(colors) ? {} : {color: colors})});
    if (edged) {
      material.customProgramCacheKey = () => 'edged';
      material.onBeforeCompile = shader => { shader.fragmentShader = shader.fragmentShader.replace('#include <color_fragment>', EDGED); };
    }
    const box = this.canvas.parentElement;
    material.resolution.set(box.clientWidth, box.clientHeight);
    const result = new LineSegments2(geometry, material);
    // Conductors are seen through what grows before them.
    material.depthTest = depth;
    if (dashed) result.computeLineDistances();
    result.frustumCulled = false;
    return result;
  }

  showSpans(items) {
    this.spans = items;
    if (!this.origin && items.length) this.find(items[0].curve[0]);
    if (!this.origin) return;
    this.drawSpans();
  }

  // Metres of a pixel at a distance from the camera [m].
  perPixel(apart) {
    return 2 * apart * Math.tan(this.camera.fov / 2 * Math.PI / 180) / Math.max(this.canvas.clientHeight, 1);
  }

  // Flat curves, and those far away, are drawn with fewer pieces: n of them stray by sag / n^2 from a parabola.
  drawSpans() {
    this.spansSeen = this.camera.position.clone();
    this.spansDrawn = performance.now();
    const curves = this.spans.map(item => this.local3(item));
    const apart = curves.map(({places}) => Math.max(1, Math.min(...places.map(place => place.distanceTo(this.camera.position)))));
    const wanted = curves.map(({places, sag}, k) => Math.min(places.length - 1, Math.ceil(Math.sqrt(sag / (STRAY * this.perPixel(apart[k]))))));
    const share = Math.min(1, MOST_PIECES / Math.max(1, wanted.reduce((sum, count) => sum + count, 0)));
    const places = [], colors = [], ground = [];
    curves.forEach((curve, k) => {
      const last = curve.places.length - 1, count = Math.min(last, Math.max(1, Math.round(wanted[k] * share)));
      for (let piece = 0; piece < count; piece++) {
        const [a, b] = [piece, piece + 1].map(step => curve.places[Math.round(step * last / count)]);
        places.push(a.x, a.y, a.z, b.x, b.y, b.z);
        colors.push(...curve.color, ...curve.color);
      }
      if (apart[k] > GROUND_REACH) return;
      for (let at = 1; at < curve.ground.length; at++) ground.push(...curve.ground[at - 1].toArray(), ...curve.ground[at].toArray());
    });
    this.put('spans', this.lines(places, colors, 6, {depth: false, edged: true}));
    this.put('ground', this.lines(ground, GROUND, 3));
  }

  // A span in the picture's own coordinates; those that did not change are kept.
  local3(item) {
    const known = this.curves.get(item);
    if (known?.origin === this.origin) return known;
    const places = item.curve.map(place => this.local(place));
    const found = {
      origin: this.origin, places, sag: Math.max(item.sag, 0),
      ground: item.ground_line.map(place => this.local(place)), color: new THREE.Color(table[item.severity].color).toArray(),
    };
    this.curves.set(item, found);
    return found;
  }

  showSupports(items) {
    this.supports = items;
    if (!this.origin) return;
    const places = items.map(item => {
      const foot = this.local(item.position);
      return [...foot.toArray(), foot.x, foot.y, foot.z + Math.max(item.height, 0.5)];
    }).flat();
    this.put('supports', this.lines(places, TOWER, 7));
  }

  showHazards(items) {
    this.hazards = items;
    if (!this.origin && items.length) this.find(items[0].position);
    if (!this.origin) return;
    const group = new THREE.Group();
    for (const severity of Object.keys(this.materials)) {
      const places = items.filter(item => item.severity === severity).map(item => this.local(item.position));
      if (!places.length) continue;
      const signs = new THREE.Points(new THREE.BufferGeometry().setFromPoints(places), this.materials[severity]);
      signs.frustumCulled = false;
      signs.renderOrder = 2 + order(severity);
      group.add(signs);
    }
    this.put('hazards', items.length ? group : null);
  }

  showTrack(places) {
    if (!this.origin) return;
    const own = straighten(places.map(place => this.local(place))).map(place => place.toArray());
    this.put('track', own.length > 1 ? this.lines(own.slice(1).flatMap((place, k) => [...own[k], ...place]), VEHICLE, 2) : null);
  }

  showVehicle(place, heading, height, near) {
    this.find(place);
    if (!place && this.vehicle) { // of another run of the node nobody knows it yet
      this.vehicle = this.vehicleText = this.wire = this.body = null;
      this.put('vehicle', null);
    }
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
      const stem = this.lines([at.x, at.y, at.z, at.x, at.y, at.z - height], VEHICLE, 2, {dashed: true});
      group.add(stem);
    }
    const wire = near.find(item => item.thing === 'conductor' && item.place);
    if (wire) {
      const end = this.local(wire.place);
      group.add(this.lines([...at.toArray(), ...end.toArray()], new THREE.Color(table[wire.tone].color), 5, {dashed: true, depth: false, edged: true}));
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
    if (view === 'overview') this.camera.position.addScaledVector(across, -0.5 * far).addScaledVector(along, -0.23 * far).add(new THREE.Vector3(0, 0, 0.34 * far));
    this.fit();
    this.dirty = true;
  }

  // Move the camera to where the ends of all spans are just in the picture.
  fit() {
    const places = this.spans.flatMap(span => [span.curve[0], span.curve.at(-1)]);
    if (this.vehicle) places.push(this.vehicle);
    for (let k = 0; places.length && k < FITS; k++) {
      this.camera.lookAt(this.controls.target);
      this.aim();
      const most = Math.max(...places.map(place => {
        const at = this.local(place).project(this.camera);
        return Math.max(Math.abs(at.x), Math.abs(at.y));
      }));
      this.camera.position.sub(this.controls.target).multiplyScalar(Math.max(most, 0.1) / FILLED).add(this.controls.target);
    }
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
    this.turned = performance.now();
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

  loop(time) {
    requestAnimationFrame(next => this.loop(next));
    this.controls.update();
    const pace = performance.now() - this.turned < REST ? 'turned' : 'still';
    if (!this.dirty && pace === this.pace && time - (this.drawn ?? 0) < 500) return;
    this.dirty = false;
    this.pace = pace;
    this.aim();
    this.points.choose(this.camera, pace);
    const began = performance.now();
    this.renderer.render(this.scene, this.camera);
    if (this.points.total) this.adapt(began, time);
    this.drawn = time;
    if (!this.origin) return;
    drawAround(this);
    if (!performance.getEntriesByName('picture').length) performance.mark('picture');
  }

  // Make all fit the camera: how far it sees, how fine curves are, how large the vehicle is.
  aim() {
    const apart = this.camera.position.distanceTo(this.controls.target);
    this.camera.near = Math.min(0.5, apart / 10);
    this.camera.far = Math.max(6000, 4 * apart);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
    this.body?.scale.setScalar(Math.max(1, this.body.position.distanceTo(this.camera.position) * 0.018));
    const moved = this.spansSeen?.distanceTo(this.camera.position) > 0.2 * apart;
    if (moved && performance.now() - this.spansDrawn > REBUILD) this.drawSpans();
  }

  adapt(began, time) {
    // Reading one pixel waits until the frame is drawn, also in software.
    const context = this.renderer.getContext();
    context.readPixels(0, 0, 1, 1, context.RGBA, context.UNSIGNED_BYTE, new Uint8Array(4));
    // Between two frames that follow each other at once the browser itself draws too.
    const interval = this.before === this.drawn && this.pace === 'turned' ? time - this.drawn : 0;
    this.before = time;
    const spent = this.spent[this.pace];
    spent.push(Math.max(performance.now() - began, interval < 250 ? interval : 0));
    if (spent.length > 3) spent.shift();
    const middle = [...spent].sort((a, b) => a - b)[spent.length >> 1];
    if (this.points.adapt(middle, this.pace, devicePixelRatio)) this.resize();
  }
}

// A way without the places that lie on the straight line between others (Ramer, Douglas and Peucker).
export function straighten(places) {
  if (places.length < 3) return places;
  const kept = new Set([0, places.length - 1]), open = [[0, places.length - 1]], near = new THREE.Vector3();
  while (open.length) {
    const [first, last] = open.pop(), line = new THREE.Line3(places[first], places[last]);
    let [far, stray] = [0, WAY_STRAY];
    for (let k = first + 1; k < last; k++) {
      const own = line.closestPointToPoint(places[k], true, near).distanceTo(places[k]);
      if (own > stray) [far, stray] = [k, own];
    }
    if (!far) continue;
    kept.add(far);
    open.push([first, far], [far, last]);
  }
  return places.filter((_, k) => kept.has(k));
}

// Whether a processor draws the picture.
function drawsInSoftware() {
  const context = document.createElement('canvas').getContext('webgl2');
  const about = context?.getExtension('WEBGL_debug_renderer_info');
  const name = about ? context.getParameter(about.UNMASKED_RENDERER_WEBGL) : '';
  context?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

// The sign of a severity as a picture: shape, colour and mark of the table; as large wherever it is.
function makeSign(look) {
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
  return new THREE.PointsMaterial({map: texture, depthTest: false, transparent: true, sizeAttenuation: false, size: 32});
}
