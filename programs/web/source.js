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

  /** gsh-view does not answer. isAnother: something answers that does not know this page's key. */
  class Gone extends Error {
    constructor(isAnother = false) {
      super(isAnother ? "gsh-view was started anew" : "gsh-view does not answer");
      this.isAnother = isAnother;
    }
  }

  const megabytes = (bytes) => (bytes / 1e6).toFixed(1);
  /** The bytes of an answer. progress(share, words) is called as they arrive, if their number is known. */
  async function bytesOf(response, progress) {
    const total = Number(response.headers.get("Content-Length"));
    if (!progress || !total || response.headers.has("Content-Encoding")) return response.arrayBuffer();
    const bytes = new Uint8Array(total), reader = response.body.getReader();
    let size = 0;
    for (let next = await reader.read(); !next.done; next = await reader.read()) {
      bytes.set(next.value, size);
      size += next.value.length;
      progress(size / total, `${megabytes(size)} of ${megabytes(total)} MB`);
    }
    return bytes.buffer;
  }

  class Server {
    constructor() {
      this.key = new URLSearchParams(location.search).get("key") || "";
      this.canDraw = true;
      this.answered = 0; // when the server last did, in milliseconds
      this.hangUp = new AbortController();
    }
    /** Asks, and reads the answer by read(response). */
    async ask(path, read, options = {}) {
      const address = `${path}${path.includes("?") ? "&" : "?"}key=${encodeURIComponent(this.key)}`;
      let refusal = "";
      try {
        const response = await fetch(address, { signal: this.hangUp.signal, ...options });
        if (response.ok) {
          const answer = await read(response);
          this.answered = performance.now();
          return answer;
        }
        refusal = (await response.text()).trim() || `the server answered ${response.status}`;
        if (response.status === 403) throw new Gone(true);
      } catch (error) {
        throw error instanceof TypeError || error instanceof DOMException ? new Gone() : error; // of fetch
      }
      throw new Error(refusal);
    }
    /** Throws Gone unless gsh-view answers within ten seconds. */
    async probe() {
      const signal = AbortSignal.timeout(10000);
      await this.ask("scene", () => true, { method: "HEAD", cache: "no-store", signal });
    }
    /** Ends what is asked at present: it will not be answered. */
    giveUp() {
      this.hangUp.abort();
      this.hangUp = new AbortController();
    }
    scene() { return this.ask("scene", (response) => response.json()); }
    gaussians(progress) { return this.ask("gaussians", (response) => bytesOf(response, progress)); }
    async motion(person, index, progress) {
      return motionOf(await this.ask(`motion?person=${person}&motion=${index}`,
        (response) => bytesOf(response, progress)));
    }
    draw(request) {
      return this.ask("draw", (response) => response.blob(), { method: "POST", body: JSON.stringify(request) });
    }
    /** Reads a dropped file: the server reads all layouts. fps: the rate that the user states, or 0. */
    async read(file, person, fps) {
      if (file.size > 64 << 20) throw new Error(`${file.name}: is larger than 64 MiB, the most that is read`);
      const rate = fps > 0 ? `&fps=${fps}` : "";
      const path = `motion?person=${person}&name=${encodeURIComponent(file.name)}${rate}`;
      return motionOf(await this.ask(path, (response) => response.arrayBuffer(), { method: "POST", body: file }));
    }
  }

  class Carried {
    constructor() { this.canDraw = false; }
    async block(id, progress) {
      const element = document.querySelector(`script[data-carried="${id}"]`);
      if (!element) throw new Error(`the page has no data called ${id}`);
      return gsh.package.fromBase64(element.textContent, progress &&
        ((share, total) => progress(share, `${megabytes(share * total)} of ${megabytes(total)} MB`)));
    }
    async scene() { return JSON.parse(new TextDecoder().decode(await this.block("scene"))); }
    gaussians(progress) { return this.block("gaussians", progress); }
    async motion(person, index, progress) { return motionOf(await this.block(`motion-${person}-${index}`, progress)); }
    async draw() { throw new Error("this page has no server that draws"); }
    /** Reads a dropped file in gsh's own layout (.npz), and places it like `first`, the person's first motion. */
    async read(file, person, fps, scene, first, body) {
      if (!/\.npz$/i.test(file.name))
        throw new Error(`${file.name}: this page reads motions in gsh's own layout (.npz); gsh-motion makes one of ` +
          "other motions (.bvh, .glb, .gltf, .vrm, .vrma, other .npz)");
      if (file.size > gsh.npz.largest) throw new Error(`${file.name}: is larger than 256 MiB, the most that is read`);
      const described = scene.people[person];
      const motion = await gsh.poseFile.read(await file.arrayBuffer(), file.name, described, fps);
      return body ? placeLike(first, motion, described, body) : motion;
    }
  }

  /** The source of this page. */
  const open = () => document.querySelector('script[data-carried="scene"]') ? new Carried() : new Server();

  return { open, Gone };
})();
