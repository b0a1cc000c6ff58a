// SPDX-License-Identifier: Apache-2.0
// Plays motions: each person has one, and all share a clock.
"use strict";

gsh.Player = class {
  /** motions: one per person. */
  constructor(motions) {
    this.motions = motions;
    this.time = 0;
    this.speed = 1;
    this.loop = true;
    this.playing = false;
  }

  set(person, motion) {
    this.motions[person] = motion;
    this.time = 0;
  }
  /** Seconds from the first frame of a motion to the end of its last one. */
  static lengthOf({ seconds, frames }) { return frames > 1 ? seconds[frames - 1] * frames / (frames - 1) : 0; }
  /** The longest motion; its frames are those of the page's slider. */
  get leader() {
    const { lengthOf } = gsh.Player;
    return this.motions.reduce((a, b) => lengthOf(b) > lengthOf(a) ? b : a);
  }
  get frames() { return this.leader.frames; }
  get frame() { return this.frameOf(this.leader); }
  get length() { return gsh.Player.lengthOf(this.leader); }

  /** The last frame that has begun. */
  frameOf({ seconds, frames }) {
    let low = 0, high = frames - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (seconds[middle] <= this.time + 1e-6) low = middle;
      else high = middle - 1;
    }
    return low;
  }
  goTo(frame) { this.time = this.leader.seconds[Math.min(Math.max(frame, 0), this.frames - 1)]; }

  /** Goes on by some seconds of the clock; true if anything is to be shown anew. */
  advance(elapsed) {
    if (!this.playing || this.length <= 0) return false;
    this.time += elapsed * this.speed;
    if (this.time >= this.length) {
      if (this.loop) this.time %= this.length;
      else this.goTo(this.frames - 1), (this.playing = false);
    }
    return true;
  }

  /** The pose of a person at this time: between two frames while the motion plays, else that of a frame. */
  state(person) {
    const motion = this.motions[person], f = this.frameOf(motion), now = motion.frame(f);
    if (!this.playing || f + 1 >= motion.frames) return now;
    const { seconds } = motion, share = (this.time - seconds[f]) / Math.max(seconds[f + 1] - seconds[f], 1e-9);
    if (!(share > 0 && share < 1)) return now;
    const next = motion.frame(f + 1), mix = (a, b) => a.map((x, k) => x + share * (b[k] - x)), pose = [];
    for (let j = 0; j < now.pose.length; j += 3)
      pose.push(...gsh.math.between(now.pose.slice(j, j + 3), next.pose.slice(j, j + 3), share));
    return { pose, transl: mix(now.transl, next.transl),
             expression: now.expression && mix(now.expression, next.expression),
             occlusion: now.occlusion && mix(now.occlusion, next.occlusion) };
  }
};
