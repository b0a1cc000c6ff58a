// SPDX-License-Identifier: Apache-2.0
// The engine that draws in the page, with WebGL 2: it poses and lights the Gaussians, sorts and blends them.
"use strict";

gsh.ClientEngine = class {
  /** Whether this browser can run it on a real graphics card. */
  static isFast() {
    const canvas = document.createElement("canvas"), gl = canvas.getContext("webgl2");
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) return false;
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    const renderer = gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return !/swiftshader|llvmpipe|software|basic render/i.test(renderer);
  }

  constructor(source, canvas) {
    this.name = "client";
    this.requests = 1; // at a time
    this.note = "";
    this.source = source;
    this.canvas = canvas;
    this.ticket = 0; // of the last sort that was asked for
    this.sorted = 0; // of the last that was answered
    this.pending = null; // what the worker must sort when it is done
    this.waiting = [];
    this.onOrder = this.onLost = () => {};
  }

  /** report(stage, share, words) is called while it loads. */
  async start(scene, report) {
    this.scene = scene;
    const kind = { alpha: false, antialias: false, preserveDrawingBuffer: true };
    const gl = this.gl = this.canvas.getContext("webgl2", kind);
    if (!gl || !gl.getExtension("EXT_color_buffer_float"))
      throw new Error("this browser has no WebGL 2 with float targets");
    this.canvas.addEventListener("webglcontextlost", () => this.stopped || this.onLost());
    this.tools = new gsh.WebGl(gl);
    this.wide = this.tools.wide;
    const loading = "Loading the Gaussians";
    report(loading);
    const pack = gsh.package.read(await this.source.gaussians((share, words) => report(loading, share, words)));
    report("Preparing the graphics card");
    await gsh.notices.shown();
    this.filter = pack.header;
    this.people = [];
    let rows = 0;
    for (let p = 0; p < pack.header.people.length; ++p) {
      const person = gsh.loadGaussians(this.tools, pack, p, this.scene.people[p]);
      person.firstRow = rows;
      rows += Math.ceil(person.count / this.wide);
      this.people.push(person);
    }
    this.rows = Math.max(rows, 1);
    this.ranges = this.people.map((person) => [person.firstRow * this.wide, person.count]);
    if (this.people.some((person) => person.aoIsMean)) {
      const where = this.people.some((person) => person.occlusion) ? "in other poses than those of its motions, " : "";
      this.note = `${where}shadows are the mean over the training's poses`;
    }
    this.makePosedTargets();
    this.programs = {
      splats: this.tools.program(gsh.shaders.splatVertex(false), gsh.shaders.splatFragment(false)),
      ellipsoids: this.tools.program(gsh.shaders.splatVertex(true), gsh.shaders.splatFragment(true)),
      copy: this.tools.program(gsh.shaders.cover, gsh.shaders.copyFragment),
    };
    this.order = gl.createBuffer();
    this.orderCount = 0;
    this.quads = gl.createVertexArray();
    gl.bindVertexArray(this.quads);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    this.plain = gl.createVertexArray();
    this.worker = gsh.sorter.worker();
    this.worker.onmessage = ({ data }) => this.takeOrder(data);
  }

  // ---- targets ----

  makePosedTargets() {
    const gl = this.gl;
    this.posed = [0, 1, 2, 3].map(() => this.tools.texture(gl.RGBA32F, this.wide, this.rows, null));
    this.posedTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.posedTarget);
    this.posed.forEach((texture, k) =>
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, texture, 0));
    gl.drawBuffers(this.posed.map((_, k) => gl.COLOR_ATTACHMENT0 + k));
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE)
      throw new Error("this graphics card cannot write four float targets at once");
    this.means = new Float32Array(4 * this.wide * this.rows);
    this.readBack = gl.createBuffer();
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.readBack);
    gl.bufferData(gl.PIXEL_PACK_BUFFER, this.means.byteLength, gl.STREAM_READ);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  }

  makePictureTarget(width, height) {
    const gl = this.gl;
    if (this.picture16 && this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width, this.canvas.height = height;
    if (this.picture16) {
      gl.deleteTexture(this.picture16), gl.deleteRenderbuffer(this.depth), gl.deleteFramebuffer(this.target);
    }
    this.picture16 = this.tools.texture(gl.RGBA16F, width, height, null);
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, width, height);
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.picture16, 0);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.depth);
  }

  // ---- a frame ----

  /** Bones, offsets, light of all people; true if anything but the camera changed. */
  update(request, centre) {
    const { people, occlusion, shadows, light_turn } = request;
    const key = JSON.stringify([people, occlusion, shadows, light_turn]), moved = key !== this.lastKey;
    this.lastKey = key;
    this.people.forEach((person, p) => {
      if (!person.body || !moved) return;
      const described = this.scene.people[p], state = request.people[p];
      person.pose = gsh.skeleton.pose(described, state);
      person.offsets = gsh.body.offsets(person.body, described.betas, state, person.pose.rotations);
      if (!person.light) return;
      person.surface = gsh.body.surface(person.body, person.pose.bones, person.offsets);
      person.turned = gsh.light.turned(person.light, request.light_turn);
      const vertices = new Float32Array(3 * person.casterVertices.length);
      person.casterVertices.forEach((v, i) => vertices.set(person.surface.vertices.subarray(3 * v, 3 * v + 3), 3 * i));
      person.caster = { vertices, triangles: person.casterTriangles };
    });
    for (const person of this.people) {
      if (!person.body) continue;
      if (moved && person.light) {
        const casters = request.shadows && person.light.shadows
          ? [person, ...this.people.filter((other) => other !== person && other.caster)].map((one) => one.caster) : [];
        person.visible = gsh.light.visibility(person.turned, person.surface, casters);
      }
      if (moved || person.light) this.uploadPerson(person, centre);
    }
    return moved;
  }

  uploadPerson(person, centre) {
    const gl = this.gl, V = person.body.count, data = person.vertexData, offsets = person.offsets;
    for (let v = 0; v < V; ++v)
      data[8 * v] = offsets[3 * v], data[8 * v + 1] = offsets[3 * v + 1], data[8 * v + 2] = offsets[3 * v + 2];
    if (person.light) {
      const shading = gsh.light.shade(person.turned, person.surface, person.visible, centre);
      for (let v = 0; v < V; ++v) data[8 * v + 4] = shading[2 * v], data[8 * v + 5] = shading[2 * v + 1];
    }
    gl.bindTexture(gl.TEXTURE_2D, person.vertices);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, this.wide, data.length / 4 / this.wide, gl.RGBA, gl.FLOAT, data);
    const bones = person.dual ? gsh.skeleton.dualQuaternions(person.pose.bones) : Float32Array.from(person.pose.bones);
    gl.bindTexture(gl.TEXTURE_2D, person.bones);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, bones.length / 4, 1, gl.RGBA, gl.FLOAT, bones);
  }

  /** Poses and colours all Gaussians into the posed targets. */
  poseAll(request, centre) {
    const gl = this.gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.posedTarget);
    gl.bindVertexArray(this.plain);
    gl.disable(gl.BLEND), gl.disable(gl.DEPTH_TEST);
    this.people.forEach((person, p) => {
      const program = person.program;
      gl.viewport(0, person.firstRow, this.wide, Math.ceil(person.count / this.wide));
      program.use();
      this.tools.bind(program, { u_fixed: person.fixed, u_bones: person.bones || person.fixed,
                           u_vertices: person.vertices || person.fixed,
                           ...(person.occlusion && { u_occlusion_basis: person.occlusion }) });
      gl.uniform1i(program.at("u_count"), person.count);
      gl.uniform1i(program.at("u_first_row"), person.firstRow);
      gl.uniform1i(program.at("u_vertices_wide"), this.wide);
      gl.uniform3fv(program.at("u_center"), centre);
      gl.uniform1f(program.at("u_occlusion"), request.shadows ? 1 : 0);
      if (person.occlusion) {
        const shares = new Float32Array(4 * person.occlusionBlocks);
        shares.set(request.occlusion?.[p] || []); // zeros are the mean
        gl.uniform4fv(program.at("u_occlusion_shares"), shares);
      }
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    });
  }

  /** Asks the worker for a new order. New positions are read back first, without waiting for the graphics card. */
  askForOrder(request, moved) {
    const gl = this.gl, { R, t } = request.camera, message = { row: R.slice(6), shift: t[2], ticket: ++this.ticket };
    if (!moved) return this.worker.postMessage(message);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.posedTarget);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.readBack);
    gl.readPixels(0, 0, this.wide, this.rows, gl.RGBA, gl.FLOAT, 0);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    const written = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const send = () => {
      if (this.stopped) return;
      const first = this.orderCount === 0; // nothing can be shown before it is there: getBufferSubData waits
      if (!first && gl.clientWaitSync(written, 0, 0) === gl.TIMEOUT_EXPIRED) return setTimeout(send, 4);
      gl.deleteSync(written);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, this.readBack);
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, this.means);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      this.worker.postMessage({ ...message, means: this.means, ranges: this.ranges });
    };
    send();
  }

  takeOrder({ order, ticket }) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.order);
    gl.bufferData(gl.ARRAY_BUFFER, order, gl.STREAM_DRAW);
    this.orderCount = order.length, this.sorted = ticket;
    if (this.pending) {
      const { request, moved } = this.pending;
      this.pending = null;
      this.askForOrder(request, moved);
    } else {
      for (const done of this.waiting.splice(0)) done();
    }
    this.onOrder();
  }

  /** Resolves when the order is that of the last request. */
  orderReady() {
    if (!this.pending && this.sorted >= this.ticket) return Promise.resolve();
    return new Promise((done) => this.waiting.push(done));
  }

  composite(request) {
    const gl = this.gl, camera = request.camera, [width, height] = camera.size, R = camera.R;
    this.makePictureTarget(width, height);
    const solid = request.show === "ellipsoids", program = solid ? this.programs.ellipsoids : this.programs.splats;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0), gl.clearDepth(1), gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    if (solid) {
      gl.disable(gl.BLEND), gl.enable(gl.DEPTH_TEST), gl.depthFunc(gl.LESS);
    } else { // front to back, premultiplied
      gl.disable(gl.DEPTH_TEST), gl.enable(gl.BLEND), gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE);
    }
    program.use();
    const [u_mean, u_factor, u_rest, u_color] = this.posed;
    this.tools.bind(program, { u_mean, u_factor, u_rest, u_color });
    [0, 1, 2].forEach((r) => gl.uniform3fv(program.at(`u_row${r}`), R.slice(3 * r, 3 * r + 3)));
    gl.uniform3fv(program.at("u_shift"), camera.t);
    gl.uniform4f(program.at("u_lens"), ...camera.focal, ...camera.centre);
    gl.uniform2f(program.at("u_size"), width, height);
    gl.uniform1f(program.at("u_dilation"), this.filter.dilation);
    gl.uniform1i(program.at("u_compensate"), this.filter.compensate ? 1 : 0);
    gl.bindVertexArray(this.quads);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.orderCount);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.disable(gl.BLEND), gl.disable(gl.DEPTH_TEST);
    this.programs.copy.use();
    this.tools.bind(this.programs.copy, { u_picture: this.picture16 });
    gl.uniform3fv(this.programs.copy.at("u_background"), request.background);
    gl.bindVertexArray(this.plain);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** Shows a picture; true. While things move, splats may be in the order of a moment before; onOrder then follows. */
  async draw(request) {
    const { R, t } = request.camera, centre = [0, 1, 2].map((k) => -(R[k] * t[0] + R[3 + k] * t[1] + R[6 + k] * t[2]));
    const view = JSON.stringify([R, t]), moved = this.update(request, centre);
    if (moved || view !== this.lastView) {
      this.poseAll(request, centre);
      if (this.sorted >= this.ticket || this.ticket === 0) this.askForOrder(request, moved);
      else this.pending = { request, moved: moved || !!this.pending?.moved };
      this.lastView = view;
      if (this.orderCount === 0) await this.orderReady(); // the first picture
      if (this.stopped) return false;
    }
    this.composite(request);
    return true;
  }

  /** The picture as a PNG, in the exact order. Nothing else may be drawn meanwhile, for that asks for new orders. */
  async picture(request) {
    await this.draw(request);
    await this.orderReady();
    this.composite(request);
    return new Promise((done) => this.canvas.toBlob(done, "image/png"));
  }

  stop() {
    this.stopped = true;
    for (const done of this.waiting.splice(0)) done();
    this.worker?.terminate();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
};
