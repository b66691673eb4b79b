// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// The points of the corridor: as many are drawn as frames can be drawn in time.

import * as THREE from 'three';

import {Batch} from './batch.js';

// Resolution of coordinates [m], of wide cells so many steps of their edge.
const UNIT = 0.01, STEPS = 50;
const HEAD = 52; // bytes before the points of a message
// A frame may take so long [ms], else fewer points are drawn; below quick more are. While the picture is
// turned: 20 frames in a second, and a little to spare. At rest: four in a second, and the processor half idle.
const FRAMES = {turned: {slow: 44, aim: 36, quick: 30}, still: {slow: 130, aim: 100, quick: 80}};
const LEAST = 3000, MOST = 600000, FIRST_SOFT = {turned: 15000, still: 40000};
// Where fewer points do not help the picture gets coarser, down to so many pixels for each of the screen.
const COARSEST = 0.6, FINEST = 1.5;
// Points so far from the camera [m] are drawn half as densely as those beside it.
const REACH = 80;
// Where few of a block are drawn they are drawn larger, at most so much, so that surfaces stay closed.
const MOST_LARGER = 3;
// Blocks of which no more points than this are drawn are drawn together.
const FEW = 256;
// Colours come as on the screen, and the renderer counts in light.
const LIGHT = Uint8Array.from({length: 256}, (_, k) => Math.round(255 * new THREE.Color().setRGB(k / 255, 0, 0, THREE.SRGBColorSpace).r));

export class Points {
  // scene: where they are put; local: from the map to the picture's own coordinates.
  constructor(scene, local, soft) {
    this.scene = scene;
    this.local = local;
    this.blocks = new Map();
    this.coming = new Map(); // newer versions of blocks, not yet as dense as what is drawn
    this.materials = new Map();
    this.batches = new Map(); // by material
    this.budgets = soft ? {...FIRST_SOFT} : {turned: MOST / 2, still: MOST / 2};
    this.finest = soft ? 1 : FINEST;
    this.total = this.shown = 0;
    this.frustum = new THREE.Frustum();
    this.view = new THREE.Matrix4();
  }

  // Take a message: a share of a block, its first ones or what follows.
  take(data) {
    const view = new DataView(data);
    const key = `${view.getInt32(0, true)}/${view.getInt32(4, true)}`;
    const [version, total, first, count] = [36, 40, 44, 48].map(at => view.getUint32(at, true));
    const old = this.blocks.get(key);
    if (!total) return this.drop(key);
    let block = this.coming.get(key) ?? old;
    if (!first) {
      block = this.begin(view, version, total);
      this.coming.set(key, block);
    } else if (block?.userData.version !== version || block.userData.count !== first) {
      return; // the rest of what was replaced
    }
    const {position, color} = block.geometry.attributes;
    position.array.set(new Int16Array(data, HEAD, 3 * count), 3 * first);
    const own = new Uint8Array(data, HEAD + 6 * count, 3 * count);
    for (let k = 0, at = 3 * first; k < own.length; k++, at++) color.array[at] = LIGHT[own[k]];
    for (const attribute of [position, color]) {
      attribute.addUpdateRange(3 * first, 3 * count);
      attribute.needsUpdate = true;
    }
    const before = block.userData.count;
    block.userData.count = first + count;
    if (block === old) this.total += count;
    else if (!old || before + count >= Math.min(total, old.userData.drawn)) this.swap(key, block);
  }

  begin(view, version, total) {
    const middle = [8, 16, 24].map(at => view.getFloat64(at, true)), edge = view.getFloat32(32, true);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Int16Array(3 * total), 3, false));
    geometry.setAttribute('color', new THREE.BufferAttribute(new Uint8Array(3 * total), 3, true));
    const block = new THREE.Points(geometry, this.material(edge, 0));
    block.scale.setScalar(Math.max(UNIT, edge / STEPS));
    block.position.copy(this.local(middle));
    block.updateMatrixWorld();
    block.matrixAutoUpdate = false;
    block.userData = {version, edge, count: 0, drawn: 0, sphere: null};
    return block;
  }

  swap(key, block) {
    this.drop(key);
    const {position} = block.geometry.attributes, box = new THREE.Box3(), place = new THREE.Vector3();
    for (let k = 0; k < block.userData.count; k++) box.expandByPoint(place.fromBufferAttribute(position, k));
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    block.geometry.boundingSphere = sphere;
    block.userData.sphere = sphere.clone().applyMatrix4(block.matrixWorld);
    block.frustumCulled = false; // by choose
    this.total += block.userData.count;
    this.blocks.set(key, block);
    this.scene.add(block);
  }

  drop(key) {
    this.coming.delete(key);
    const old = this.blocks.get(key);
    if (!old) return;
    this.scene.remove(old);
    old.geometry.dispose();
    this.total -= old.userData.count;
    this.blocks.delete(key);
  }

  clear() {
    for (const key of [...this.blocks.keys()]) this.drop(key);
    this.coming.clear();
  }

  // Points of cells of an edge [m], in steps of half an octave of size.
  material(edge, step) {
    const key = `${edge} ${step}`;
    if (!this.materials.has(key)) {
      this.materials.set(key, new THREE.PointsMaterial({size: edge * 0.8 * 2 ** (step / 2), vertexColors: true}));
    }
    return this.materials.get(key);
  }

  batch(material) {
    if (!this.batches.has(material)) this.batches.set(material, new Batch(this.scene, material));
    return this.batches.get(material);
  }

  // Each block in sight shows its share of the budget, near ones more than far ones.
  choose(camera, pace) {
    this.frustum.setFromProjectionMatrix(this.view.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    let seen = [];
    for (const block of this.blocks.values()) {
      const {sphere, count} = block.userData;
      block.visible = this.frustum.intersectsSphere(sphere);
      block.userData.drawn = 0;
      if (block.visible) seen.push([block, count / (1 + (sphere.center.distanceTo(camera.position) / REACH) ** 2), count]);
    }
    // What near blocks do not have goes to the others.
    let left = this.budgets[pace];
    for (let round = 0; round < 3 && seen.length && left > 1; round++) {
      const sum = seen.reduce((all, [, weight]) => all + weight, 0), room = left;
      for (const [block, weight, count] of seen) {
        const more = Math.min(count - block.userData.drawn, Math.floor(room * weight / sum));
        block.userData.drawn += more;
        left -= more;
      }
      seen = seen.filter(([block, , count]) => block.userData.drawn < count);
    }
    this.shown = 0;
    for (const batch of this.batches.values()) batch.begin();
    for (const block of this.blocks.values()) {
      const {drawn, count, edge} = block.userData;
      block.visible = drawn > FEW;
      if (!drawn) continue;
      this.shown += drawn;
      const material = this.material(edge, Math.round(2 * Math.log2(Math.min(MOST_LARGER, Math.sqrt(count / drawn)))));
      if (drawn > FEW) {
        block.geometry.setDrawRange(0, drawn);
        block.material = material;
      } else this.batch(material).add(block, drawn);
    }
    for (const batch of this.batches.values()) batch.show();
  }

  // Draw fewer or more after a frame that took so long [ms]; return whether the picture got coarser or finer.
  adapt(spent, pace, ratio) {
    const {slow, aim, quick} = FRAMES[pace], budget = this.budgets[pace];
    const all = this.shown < budget * 0.9; // everything in sight is drawn
    if (spent > slow && budget > LEAST) {
      this.budgets[pace] = Math.max(LEAST, Math.round(Math.min(budget, this.shown * 1.1) * Math.max(0.5, aim / spent)));
    } else if (spent < quick && !all) this.budgets[pace] = Math.min(MOST, Math.round(budget * 1.1));
    if (pace !== 'turned') return false;
    if (spent > slow && budget <= LEAST && this.finest > COARSEST) return this.refine(Math.max(COARSEST, Math.min(this.finest, ratio) * 0.85));
    const most = Math.min(FINEST, ratio);
    if (spent < quick && this.finest < most && (all || budget > 4 * LEAST)) return this.refine(Math.min(most, this.finest * 1.1));
    return false;
  }

  refine(finest) {
    this.finest = finest;
    return true;
  }
}
