// SPDX-License-Identifier: Apache-2.0
// The vertices of a posed body: offsets of shape, expression and pose, skinning, normals. As include/gsh/avatar/rig.hpp
// and include/gsh/body/posed_surface.hpp.
"use strict";

gsh.body = (() => {
  /** Reads the body of person p from a package. */
  function load(pack, p) {
    const get = (name) => pack.has(`${p}/${name}`) ? pack.array(`${p}/${name}`) : null;
    const directions = (name) => {
      const found = get(name);
      return found && { data: found.data, count: found.columns / 3 };
    };
    const body = {
      rest: get("rest").data, shape: directions("shape_directions"), expression: directions("expression_directions"),
      pose: directions("pose_directions"), joints: get("vertex_joints"), weights: get("vertex_weights").data,
      faces: get("faces") && get("faces").data, normalOffsets: get("normal_offsets") && get("normal_offsets").data,
    };
    body.count = body.rest.length / 3;
    if (body.faces) body.corners = cornersOf(body.faces, body.count);
    return body;
  }

  /** For each vertex the faces at it, as ranges of a list. */
  function cornersOf(faces, count) {
    const starts = new Uint32Array(count + 1), list = new Uint32Array(faces.length);
    for (const v of faces) ++starts[v + 1];
    for (let v = 0; v < count; ++v) starts[v + 1] += starts[v];
    const next = starts.slice();
    for (let i = 0; i < faces.length; ++i) list[next[faces[i]]++] = Math.floor(i / 3);
    return { starts, list };
  }

  /** Canonical offsets [3 V] of the vertices. betas are those of the rig, state and rotations those of the pose. */
  function offsets(body, betas, state, rotations) {
    const result = new Float32Array(3 * body.count);
    const addAll = (directions, coefficient) => {
      if (!directions) return;
      const K = directions.count, used = [], values = [];
      for (let k = 0; k < K; ++k) {
        const value = coefficient(k);
        if (value !== 0) used.push(3 * k), values.push(value);
      }
      const n = used.length, data = directions.data;
      for (let v = 0, row = 0; n > 0 && v < body.count; ++v, row += 3 * K) {
        let x = 0, y = 0, z = 0;
        for (let i = 0; i < n; ++i) {
          const at = row + used[i], value = values[i];
          x += data[at] * value, y += data[at + 1] * value, z += data[at + 2] * value;
        }
        result[3 * v] += x, result[3 * v + 1] += y, result[3 * v + 2] += z;
      }
    };
    addAll(body.shape, (k) => state.betas[k] - betas[k]);
    addAll(body.expression, (k) => state.expression[k]);
    addAll(body.pose, (k) => rotations[Math.floor(k / 9) + 1][k % 9] - (k % 9 % 4 === 0 ? 1 : 0));
    return result;
  }

  /** Posed vertices and unit normals [3 V]; `lit` are the normals for shading, which have any length. */
  function surface(body, bones, offset) {
    const V = body.count, I = body.joints.columns, joints = body.joints.data, weights = body.weights;
    const vertices = new Float32Array(3 * V), normals = new Float32Array(3 * V), M = new Float64Array(12);
    const lit = body.normalOffsets ? new Float32Array(3 * V) : normals;
    for (let v = 0; v < V; ++v) {
      M.fill(0);
      let total = 0;
      for (let k = v * I; k < v * I + I && weights[k] !== 0; ++k) {
        const w = weights[k], B = 12 * joints[k];
        total += w;
        for (let n = 0; n < 12; ++n) M[n] += w * bones[B + n];
      }
      const s = 1 / total, x = body.rest[3 * v] + offset[3 * v], y = body.rest[3 * v + 1] + offset[3 * v + 1],
        z = body.rest[3 * v + 2] + offset[3 * v + 2], n = body.normalOffsets;
      for (let r = 0; r < 3; ++r) {
        const at = 4 * r;
        vertices[3 * v + r] = (M[at] * x + M[at + 1] * y + M[at + 2] * z + M[at + 3]) * s;
        if (n) lit[3 * v + r] = (M[at] * n[3 * v] + M[at + 1] * n[3 * v + 1] + M[at + 2] * n[3 * v + 2]) * s;
      }
    }
    const faces = body.faces, crosses = new Float32Array(faces.length);
    for (let f = 0; f < faces.length; f += 3) {
      const a = 3 * faces[f], b = 3 * faces[f + 1], c = 3 * faces[f + 2];
      const x = vertices[a], y = vertices[a + 1], z = vertices[a + 2];
      const ux = vertices[b] - x, uy = vertices[b + 1] - y, uz = vertices[b + 2] - z;
      const vx = vertices[c] - x, vy = vertices[c + 1] - y, vz = vertices[c + 2] - z;
      crosses[f] = uy * vz - uz * vy, crosses[f + 1] = uz * vx - ux * vz, crosses[f + 2] = ux * vy - uy * vx;
    }
    const { starts, list } = body.corners;
    for (let v = 0; v < V; ++v) {
      let x = 0, y = 0, z = 0;
      for (let i = starts[v]; i < starts[v + 1]; ++i) {
        const f = 3 * list[i];
        x += crosses[f], y += crosses[f + 1], z += crosses[f + 2];
      }
      const length = Math.sqrt(x * x + y * y + z * z), s = length > 0 ? 1 / length : 0;
      normals[3 * v] = x * s, normals[3 * v + 1] = y * s, normals[3 * v + 2] = z * s;
    }
    if (lit !== normals) for (let i = 0; i < 3 * V; ++i) lit[i] += normals[i];
    return { vertices, normals, lit };
  }

  /** The height of the lowest vertex of a posed body. */
  function ground(body, bones, offset) {
    const I = body.joints.columns, joints = body.joints.data, weights = body.weights;
    let lowest = Infinity;
    for (let v = 0; v < body.count; ++v) {
      const at = 3 * v, x = body.rest[at] + offset[at], y = body.rest[at + 1] + offset[at + 1];
      const z = body.rest[at + 2] + offset[at + 2];
      let total = 0, height = 0;
      for (let k = v * I; k < v * I + I && weights[k] !== 0; ++k) {
        const w = weights[k], B = 12 * joints[k] + 4; // the row of y
        total += w, height += w * (bones[B] * x + bones[B + 1] * y + bones[B + 2] * z + bones[B + 3]);
      }
      lowest = Math.min(lowest, height / total);
    }
    return lowest;
  }

  return { load, offsets, surface, ground };
})();
