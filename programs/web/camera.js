// SPDX-License-Identifier: Apache-2.0
// A camera that orbits around a target. x_cam = R x + t: x right, y down, z forward, as include/gsh/camera/pinhole.hpp.
"use strict";

gsh.OrbitCamera = class {
  /** box: {centre, half} of what is shown, in metres. */
  constructor(box) {
    this.box = box;
    this.fieldOfView = 30 * Math.PI / 180; // vertical
    this.up = 1; // -1: the scene's y points down; the camera is then turned with it, by half a turn about x
    this.reset(1);
  }

  /** In front of the scene, as near as possible while all of it is seen. aspect: width / height. */
  reset(aspect) {
    const { centre, half } = this.box, tangent = Math.tan(this.fieldOfView / 2) * 0.92;
    this.target = centre.slice();
    this.yaw = 0, this.pitch = 0.06;
    const wide = Math.max(half[0], half[2]);
    this.distance = Math.max(half[1] / tangent, wide / (tangent * aspect)) + half[2];
    this.least = 0.02 * this.distance, this.most = 20 * this.distance;
  }

  /** Rows of R: right, down, forward. */
  axes() {
    const c = Math.cos(this.pitch), s = Math.sin(this.pitch);
    const forward = [-Math.sin(this.yaw) * c, -s * this.up, -Math.cos(this.yaw) * c * this.up];
    const right = gsh.math.normalize(gsh.math.cross(forward, [0, this.up, 0]));
    return [right, gsh.math.cross(forward, right), forward];
  }

  turn(dx, dy) { // in radians
    this.yaw = Math.atan2(Math.sin(this.yaw - dx), Math.cos(this.yaw - dx));
    this.pitch = Math.min(Math.max(this.pitch + dy, -1.5), 1.5);
  }
  pan(dx, dy) { // in shares of the picture's height
    const [right, down] = this.axes(), size = 2 * this.distance * Math.tan(this.fieldOfView / 2);
    this.target = this.target.map((x, k) => x - (right[k] * dx + down[k] * dy) * size);
  }
  zoom(factor) { this.distance = Math.min(Math.max(this.distance * factor, this.least), this.most); }

  /** The camera of a picture of the given size, as requests have it, moved by a shift. */
  view(width, height, shift = [0, 0, 0]) {
    const [right, down, forward] = this.axes(), R = [...right, ...down, ...forward];
    const eye = gsh.math.add(shift, gsh.math.subtract(this.target, gsh.math.scale(forward, this.distance)));
    const focal = height / (2 * Math.tan(this.fieldOfView / 2));
    return { size: [width, height], focal: [focal, focal], centre: [width / 2, height / 2], R,
             t: gsh.math.scale(gsh.math.times(R, eye), -1) };
  }

  /** Mouse: drag turns, right button or shift pans, wheel zooms. Touch: one finger turns, two pan and zoom. */
  listen(element, changed) {
    const pointers = new Map();
    element.addEventListener("contextmenu", (event) => event.preventDefault());
    element.addEventListener("mousedown", (event) => { // keys then go to the page: Tab alone focuses the picture
      event.preventDefault();
      document.activeElement?.blur();
    });
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    const release = (event) => pointers.delete(event.pointerId);
    element.addEventListener("pointerup", release);
    element.addEventListener("pointercancel", release);
    element.addEventListener("pointermove", (event) => {
      const before = pointers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], height = element.clientHeight;
      const dx = now[0] - before[0], dy = now[1] - before[1];
      if (pointers.size === 2) {
        const [id] = [...pointers.keys()].filter((key) => key !== event.pointerId), other = pointers.get(id);
        const apart = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
        this.zoom(apart(before) / apart(now));
        this.pan(dx / 2 / height, dy / 2 / height);
      } else if (event.buttons & 6 || event.shiftKey) {
        this.pan(dx / height, dy / height);
      } else {
        this.turn(dx / height * Math.PI, dy / height * Math.PI);
      }
      pointers.set(event.pointerId, now);
      changed();
    });
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(Math.min(Math.max(event.deltaY * (event.deltaMode ? 30 : 1), -240), 240) * 0.0015));
      changed();
    }, { passive: false });
    element.addEventListener("dblclick", () => {
      this.reset(element.clientWidth / element.clientHeight);
      changed();
    });
  }
};
