// SPDX-License-Identifier: Apache-2.0
// The Gaussians of a person, or of a static scene, on the graphics card.
"use strict";

gsh.loadGaussians = (() => {
  /** The basis of an ambient occlusion that follows motions: `occlusionBlocks` texels of four numbers a Gaussian. */
  function occlusionTexture(tools, { data, rows, columns }) {
    const { gl, wide } = tools, blocks = Math.ceil(columns / 4), height = Math.ceil(rows * blocks / wide);
    const numbers = new Float32Array(4 * wide * height);
    for (let i = 0; i < rows; ++i) numbers.set(data.subarray(columns * i, columns * (i + 1)), 4 * blocks * i);
    return { occlusionBlocks: blocks, occlusion: tools.texture(gl.RGBA32F, wide, height, numbers) };
  }

  /** Reads person p of a package into textures. described: as the scene describes the person; none for a scene. */
  function loadGaussians(tools, pack, p, described) {
    const { gl, wide } = tools, header = pack.header.people[p], get = (name) => pack.array(`${p}/${name}`);
    const means = get("means"), count = means.rows, quats = get("quats").data, scales = get("log_scales").data;
    const opacities = get("opacities").data, constant = get("sh_constant").data, degree = header.degree;
    const K = (degree + 1) ** 2, bands = K > 1 ? get("sh_bands").data : null;
    const ao = pack.has(`${p}/ao`) ? get("ao").data : null, hasBody = pack.has(`${p}/rest`);
    const joints = hasBody ? get("skin_joints") : null, weights = hasBody ? get("skin_weights").data : null;
    const triangles = hasBody ? get("triangles").data : null, barycentric = hasBody ? get("barycentric").data : null;
    const influences = hasBody ? joints.columns : 0, blocks = Math.ceil(influences / 4), texels = 5 + 2 * blocks + K;
    const height = Math.max(1, Math.ceil(count * texels / wide));
    if (height > gl.getParameter(gl.MAX_TEXTURE_SIZE)) throw new Error("the scene is too large for this graphics card");
    const fixed = new Float32Array(wide * height * 4);
    for (let i = 0; i < count; ++i) {
      let at = 4 * texels * i;
      const put = (...numbers) => { fixed.set(numbers, at); at += 4; };
      put(means.data[3 * i], means.data[3 * i + 1], means.data[3 * i + 2], opacities[i]);
      put(quats[4 * i], quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3]);
      put(Math.exp(scales[3 * i]), Math.exp(scales[3 * i + 1]), Math.exp(scales[3 * i + 2]), ao ? ao[i] : 1);
      if (hasBody) {
        put(triangles[3 * i], triangles[3 * i + 1], triangles[3 * i + 2], 0);
        put(barycentric[3 * i], barycentric[3 * i + 1], barycentric[3 * i + 2], 0);
        for (let k = 0; k < influences; ++k) {
          fixed[at + k] = joints.data[i * influences + k];
          fixed[at + 4 * blocks + k] = weights[i * influences + k];
        }
        at += 8 * blocks;
      } else {
        at += 8;
      }
      put(constant[3 * i], constant[3 * i + 1], constant[3 * i + 2], 0);
      for (let k = 0; k < K - 1; ++k) {
        const from = 3 * (i * (K - 1) + k);
        put(bands[from], bands[from + 1], bands[from + 2], 0);
      }
    }
    const occlusion = pack.has(`${p}/occlusion_basis`) ? occlusionTexture(tools, get("occlusion_basis")) : null;
    const person = { count, ...occlusion, aoIsMean: !!header.ao_is_mean, dual: header.deformation === "dual_quaternion",
                     fixed: tools.texture(gl.RGBA32F, wide, height, fixed) };
    if (hasBody) {
      person.body = gsh.body.load(pack, p);
      person.bones = tools.texture(gl.RGBA32F, 3 * described.parents.length, 1, null);
      person.vertices = tools.texture(gl.RGBA32F, wide, Math.ceil(2 * person.body.count / wide), null);
      person.vertexData = new Float32Array(4 * wide * Math.ceil(2 * person.body.count / wide));
    }
    if (header.light) {
      person.light = header.light;
      person.casterVertices = get("caster_vertices").data;
      person.casterTriangles = get("caster_triangles").data;
    }
    person.program = tools.program(gsh.shaders.cover, gsh.shaders.pose({
      texels, wide, influences, degree, body: hasBody, lit: !!header.light, deformation: header.deformation,
      clampAbove: header.clamp_above, occlusionBlocks: occlusion ? occlusion.occlusionBlocks : 0 }));
    return person;
  }

  return loadGaussians;
})();
