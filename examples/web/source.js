// SPDX-License-Identifier: Apache-2.0
// Where the page takes its scene and motions from: gsh-view's server, or blocks of data in the page itself.
"use strict";

gsh.source = (() => {
  /**
   * A motion of a package: frames with pose, transl and expression, and the time of each. In a page that carries its
   * data, also with the coefficients of the ambient occlusion, if that follows the pose.
   */
  function motionOf(buffer) {
    const pack = gsh.package.read(buffer), pose = pack.array("pose"), transl = pack.array("transl").data;
    const optional = (name) => pack.has(name) ? pack.array(name) : null, seconds = pack.array("seconds").data;
    const expression = optional("expression"), occlusion = optional("occlusion");
    const row = ({ data, columns }, f) => Array.from(data.subarray(f * columns, (f + 1) * columns));
    const { name, betas, warnings } = pack.header;
    return { name, betas, warnings, frames: pose.rows, seconds,
      frame: (f) => ({ pose: row(pose, f), transl: row({ data: transl, columns: 3 }, f),
                       expression: expression && row(expression, f), occlusion: occlusion && row(occlusion, f) }) };
  }

  /**
   * Moves a motion so that its first frame has the place and the ground of another one, as gsh-view's server does
   * (place_like). person: as the scene describes it; body: as gsh.body.load reads it.
   */
  function placeLike(other, motion, person, body) {
    const ground = ({ betas, frame }) => {
      const { pose, transl, expression } = frame(0);
      const state = { pose, transl, betas: person.betas.map((beta, k) => betas.length ? betas[k] || 0 : beta),
                      expression: Array.from({ length: person.expressions }, (_, k) => expression?.[k] || 0) };
      const { rotations, bones } = gsh.skeleton.pose(person, state);
      return gsh.body.ground(body, bones, gsh.body.offsets(body, person.betas, state, rotations));
    };
    const shift = gsh.math.subtract(other.frame(0).transl, motion.frame(0).transl);
    shift[1] = ground(other) - ground(motion);
    const frame = (f) => {
      const one = motion.frame(f);
      return { ...one, transl: gsh.math.add(one.transl, shift) };
    };
    return { ...motion, frame };
  }

  class Server {
    constructor() {
      this.key = new URLSearchParams(location.search).get("key") || "";
      this.canDraw = true;
    }
    async ask(path, options = {}) {
      let response;
      try {
        response = await fetch(`${path}${path.includes("?") ? "&" : "?"}key=${encodeURIComponent(this.key)}`, options);
      } catch {
        throw new Error("gsh-view does not answer; start it again and open the address that it prints");
      }
      if (!response.ok) throw new Error((await response.text()).trim() || `the server answered ${response.status}`);
      return response;
    }
    async scene() { return (await this.ask("scene")).json(); }
    async gaussians() { return (await this.ask("gaussians")).arrayBuffer(); }
    async motion(person, index) {
      return motionOf(await (await this.ask(`motion?person=${person}&motion=${index}`)).arrayBuffer());
    }
    async draw(request) {
      return (await this.ask("draw", { method: "POST", body: JSON.stringify(request) })).blob();
    }
    /** Reads a dropped file: the server reads all layouts. fps: the rate that the user states, or 0. */
    async read(file, person, fps) {
      if (file.size > 64 << 20) throw new Error(`${file.name}: is larger than 64 MiB, the most that is read`);
      const rate = fps > 0 ? `&fps=${fps}` : "";
      const path = `motion?person=${person}&name=${encodeURIComponent(file.name)}${rate}`;
      return motionOf(await (await this.ask(path, { method: "POST", body: file })).arrayBuffer());
    }
  }

  class Carried {
    constructor() { this.canDraw = false; }
    block(id) {
      const element = document.querySelector(`script[data-carried="${id}"]`);
      if (!element) throw new Error(`the page has no data called ${id}`);
      return gsh.package.fromBase64(element.textContent);
    }
    async scene() { return JSON.parse(new TextDecoder().decode(this.block("scene"))); }
    async gaussians() { return this.block("gaussians"); }
    async motion(person, index) { return motionOf(this.block(`motion-${person}-${index}`)); }
    async draw() { throw new Error("this page has no server that draws"); }
    /** Reads a dropped file in gsh's own layout (.npz), and places it like `first`, the person's first motion. */
    async read(file, person, fps, scene, first, body) {
      if (!/\.npz$/i.test(file.name))
        throw new Error(`${file.name}: this page reads motions of gsh (.npz); gsh-motion converts others`);
      if (file.size > gsh.npz.largest) throw new Error(`${file.name}: is larger than 256 MiB, the most that is read`);
      const described = scene.people[person];
      const motion = await gsh.poseFile.read(await file.arrayBuffer(), file.name, described, fps);
      return body ? placeLike(first, motion, described, body) : motion;
    }
  }

  /** The source of this page. */
  const open = () => document.querySelector('script[data-carried="scene"]') ? new Carried() : new Server();

  return { open };
})();
