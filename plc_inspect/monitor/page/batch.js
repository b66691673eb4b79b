// Copyright 2026 plc_inspect contributors
// SPDX-License-Identifier: Apache-2.0

// Points of many blocks in one call: in software, a call costs as much as a hundred points.

import * as THREE from 'three';

export class Batch {
  // scene: where it is put; material: of all its points.
  constructor(scene, material) {
    this.scene = scene;
    this.material = material;
    this.count = 0;
    this.reserve(4096);
  }

  reserve(most) {
    const old = this.object;
    this.most = most;
    const geometry = new THREE.BufferGeometry();
    this.places = new THREE.BufferAttribute(new Float32Array(3 * most), 3);
    this.colors = new THREE.BufferAttribute(new Uint8Array(3 * most), 3, true);
    if (old) {
      this.places.array.set(old.geometry.attributes.position.array);
      this.colors.array.set(old.geometry.attributes.color.array);
      this.scene.remove(old);
      old.geometry.dispose();
    }
    for (const attribute of [this.places, this.colors]) attribute.setUsage(THREE.DynamicDrawUsage);
    geometry.setAttribute('position', this.places);
    geometry.setAttribute('color', this.colors);
    this.object = new THREE.Points(geometry, this.material);
    this.object.frustumCulled = false; // its blocks were chosen one by one
    this.scene.add(this.object);
  }

  begin() {
    this.count = 0;
  }

  // Add the first points of a block.
  add(block, count) {
    while (this.count + count > this.most) this.reserve(2 * this.most);
    const {position, color} = block.geometry.attributes, scale = block.scale.x, {x, y, z} = block.position;
    const from = position.array, to = this.places.array;
    for (let k = 0, at = 3 * this.count; k < 3 * count; k += 3, at += 3) {
      to[at] = x + scale * from[k];
      to[at + 1] = y + scale * from[k + 1];
      to[at + 2] = z + scale * from[k + 2];
    }
    this.colors.array.set(color.array.subarray(0, 3 * count), 3 * this.count);
    this.count += count;
  }

  show() {
    this.object.visible = this.count > 0;
    if (!this.count) return;
    this.object.geometry.setDrawRange(0, this.count);
    for (const attribute of [this.places, this.colors]) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 3 * this.count);
      attribute.needsUpdate = true;
    }
  }
}
