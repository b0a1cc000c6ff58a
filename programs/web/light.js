// SPDX-License-Identifier: Apache-2.0
// Light on a posed body: shadow maps of all lights, and the shading of the vertices. The steps and constants are those
// of include/gsh/light/: shadow_frame.hpp, shadow_triangle.hpp, shadow_map.hpp and lit_element.hpp.
"use strict";

gsh.light = (() => {
  const { cross, dot, length, normalize, scale, subtract } = gsh.math;
  const boxVertices = 64, taps = 4, margin = 3, margins = margin + taps, subtexels = 16, empty = -1e30;

  /** A light of a package, turned by `angle` radians about the vertical through its centre. */
  function turned(light, angle) {
    const c = Math.cos(angle), s = Math.sin(angle), list = [];
    const turn = (v) => [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]];
    for (let i = 0; i < light.points.length; i += 3) {
      const p = turn(subtract(light.points.slice(i, i + 3), light.centre));
      list.push({ isPoint: true, at: gsh.math.add(light.centre, p) });
    }
    for (let i = 0; i < light.directions.length; i += 3)
      list.push({ isPoint: false, at: turn(light.directions.slice(i, i + 3)) });
    list.forEach((l, k) => (l.intensity = Math.exp(light.log_intensities[k])));
    const glossy = light.gloss.length === 2;
    return { list, settings: light, glossy,
             strength: glossy ? Math.exp(light.gloss[0]) : 0, sharpness: glossy ? Math.exp(light.gloss[1]) : 0 };
  }

  /** Boxes of 64 consecutive vertices: [low, high] each. */
  function boxesOf(casters) {
    const boxes = [];
    for (const { vertices } of casters)
      for (let begin = 0; begin < vertices.length; begin += 3 * boxVertices) {
        const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
        for (let i = begin; i < Math.min(begin + 3 * boxVertices, vertices.length); ++i) {
          low[i % 3] = Math.min(low[i % 3], vertices[i]);
          high[i % 3] = Math.max(high[i % 3], vertices[i]);
        }
        boxes.push([low, high]);
      }
    return boxes;
  }

  /** Where a point lies in a light's map: rows x, y, q, w are affine functions [4] of the point. */
  function aim(light, settings, boxes) {
    const low = [0, 1, 2].map((k) => Math.min(...boxes.map((b) => b[0][k])));
    const high = [0, 1, 2].map((k) => Math.max(...boxes.map((b) => b[1][k])));
    const centre = low.map((l, k) => (l + high[k]) / 2), kind = light.isPoint ? 0 : 1;
    let z = light.isPoint ? subtract(centre, light.at) : scale(light.at, -1), distance = length(z);
    z = distance > 1e-6 ? scale(z, 1 / distance) : [0, -1, 0];
    const x = normalize(cross(z, Math.abs(z[1]) < 0.999 ? [0, 1, 0] : [1, 0, 0])), y = cross(z, x);
    const origin = light.isPoint ? light.at : centre, row = (axis) => [...axis, -dot(axis, origin)], one = [0, 0, 0, 1];
    const rows = { x: row(x), y: row(y), w: light.isPoint ? row(z) : one, q: light.isPoint ? one : row(scale(z, -1)) };
    const near = light.isPoint ? 0.02 : 0.5, widest = light.isPoint ? 3 : 1e6;
    distance = Math.max(light.isPoint ? distance : 1, near);
    // bounds of x / w and y / w
    const least = [widest, widest], most = [-widest, -widest];
    const value = (r, p) => dot(r, p) + r[3];
    const reach = (r, half) => Math.abs(r[0]) * half[0] + Math.abs(r[1]) * half[1] + Math.abs(r[2]) * half[2];
    for (const [boxLow, boxHigh] of boxes) {
      const half = scale(subtract(boxHigh, boxLow), 0.5), at = gsh.math.add(boxLow, half);
      const depth = value(rows.w, at), depthHalf = reach(rows.w, half);
      const far = depth + depthHalf, close = Math.max(depth - depthHalf, near);
      if (!(far > near)) continue;
      [rows.x, rows.y].forEach((r, k) => {
        const a = value(r, at) - reach(r, half), b = value(r, at) + reach(r, half);
        least[k] = Math.min(least[k], Math.max(a / (a < 0 ? close : far), -widest));
        most[k] = Math.max(most[k], Math.min(b / (b < 0 ? far : close), widest));
      });
    }
    const extent = [0, 1].map((k) => most[k] - least[k]), stride = settings.resolutions[kind];
    const softness = settings.softness[kind], finest = softness / (1.5 * distance);
    const texel = Math.max(Math.max(extent[0], extent[1]) / (stride - margins - 1), Math.max(finest, 1e-6));
    const toTexels = (r, from) => r.map((f, n) => f / texel + rows.w[n] * (margin - from / texel));
    return {
      x: toTexels(rows.x, least[0]), y: toTexels(rows.y, least[1]), q: rows.q, w: rows.w, near, stride,
      light: light.at, isPoint: light.isPoint,
      width: Math.trunc(extent[0] / texel) + 1 + margins, height: Math.trunc(extent[1] / texel) + 1 + margins,
      radius: Math.min(Math.max(softness / (distance * texel), 0.5), 1.5),
    };
  }

  /** Keeps the greatest nearness of the triangles that face away from the light, at the centres of texels. */
  function draw(frame, { vertices, triangles }, map) {
    const V = vertices.length / 3, px = new Int32Array(V), py = new Int32Array(V), near = new Float32Array(V);
    const { x: rx, y: ry, q: rq, w: rw, stride } = frame;
    for (let v = 0; v < V; ++v) {
      const a = vertices[3 * v], b = vertices[3 * v + 1], c = vertices[3 * v + 2];
      const w = rw[0] * a + rw[1] * b + rw[2] * c + rw[3];
      const x = (rx[0] * a + rx[1] * b + rx[2] * c + rx[3]) / w, y = (ry[0] * a + ry[1] * b + ry[2] * c + ry[3]) / w;
      const inside = w > frame.near && x >= 0 && x <= frame.width && y >= 0 && y <= frame.height;
      px[v] = inside ? Math.trunc(x * subtexels + 0.5) : -1, py[v] = inside ? Math.trunc(y * subtexels + 0.5) : 0;
      near[v] = (rq[0] * a + rq[1] * b + rq[2] * c + rq[3]) / w;
    }
    for (let t = 0; t < triangles.length; t += 3) {
      const a = triangles[t], b = triangles[t + 1], c = triangles[t + 2];
      if ((px[a] | px[b] | px[c]) < 0) continue;
      const area = (px[b] - px[a]) * (py[c] - py[a]) - (py[b] - py[a]) * (px[c] - px[a]);
      if (area <= 0) continue; // it faces the light
      const left = (Math.min(px[a], px[b], px[c]) + 7) >> 4, right = (Math.max(px[a], px[b], px[c]) + 8) >> 4;
      const top = (Math.min(py[a], py[b], py[c]) + 7) >> 4, bottom = (Math.max(py[a], py[b], py[c]) + 8) >> 4;
      if (left >= right || top >= bottom) continue;
      const X = left * subtexels + subtexels / 2, Y = top * subtexels + subtexels / 2;
      const less = (dx, dy) => (dy < 0 || (dy === 0 && dx > 0) ? 0 : 1); // the top-left rule
      const bcx = px[c] - px[b], bcy = py[c] - py[b], cax = px[a] - px[c], cay = py[a] - py[c],
        abx = px[b] - px[a], aby = py[b] - py[a], lessCa = less(cax, cay), lessAb = less(abx, aby);
      let rowBc = bcx * (Y - py[b]) - bcy * (X - px[b]) - less(bcx, bcy),
        rowCa = cax * (Y - py[c]) - cay * (X - px[c]) - lessCa, rowAb = abx * (Y - py[a]) - aby * (X - px[a]) - lessAb;
      const toB = (near[b] - near[a]) / area, toC = (near[c] - near[a]) / area,
        atA = near[a] + lessCa * toB + lessAb * toC;
      for (let y = top; y < bottom; ++y) {
        let bc = rowBc, ca = rowCa, ab = rowAb;
        for (let x = left, at = y * stride + left; x < right; ++x, ++at) {
          if ((bc | ca | ab) >= 0) {
            const nearness = atA + ca * toB + ab * toC;
            if (nearness > map[at]) map[at] = nearness;
          }
          bc -= bcy * subtexels, ca -= cay * subtexels, ab -= aby * subtexels;
        }
        rowBc += bcx * subtexels, rowCa += cax * subtexels, rowAb += abx * subtexels;
      }
    }
  }

  /** Writes the share of a light that reaches each vertex to visibility[v * L + l]. */
  function receive(frame, map, surface, lift, visibility, l, L) {
    const { vertices, normals } = surface, V = vertices.length / 3, { x: rx, y: ry, q: rq, w: rw, stride } = frame;
    const side = 2 * frame.radius, share = 1 / side, across = new Float64Array(taps), down = new Float64Array(taps);
    const weigh = (from, weights) => {
      const to = from + side;
      for (let k = 0; k < taps; ++k) weights[k] = Math.max(Math.min(k + 1, to) - Math.max(k, from), 0) * share;
    };
    for (let v = 0; v < V; ++v) {
      const nx = normals[3 * v], ny = normals[3 * v + 1], nz = normals[3 * v + 2];
      let x = vertices[3 * v], y = vertices[3 * v + 1], z = vertices[3 * v + 2];
      const p = frame.isPoint ? 1 : 0;
      const lx = frame.light[0] - x * p, ly = frame.light[1] - y * p, lz = frame.light[2] - z * p;
      const facing = nx * lx + ny * ly + nz * lz;
      if (facing * Math.abs(facing) < -0.0625 * (lx * lx + ly * ly + lz * lz)) {
        visibility[v * L + l] = 0;
        continue;
      }
      x += nx * lift, y += ny * lift, z += nz * lift;
      const w = rw[0] * x + rw[1] * y + rw[2] * z + rw[3];
      if (!(w > frame.near)) {
        visibility[v * L + l] = 1;
        continue;
      }
      const clip = (value, size) => (value > 0 ? (value < size - taps ? value : size - taps) : 0);
      const left = clip((rx[0] * x + rx[1] * y + rx[2] * z + rx[3]) / w - frame.radius, frame.width);
      const top = clip((ry[0] * x + ry[1] * y + ry[2] * z + ry[3]) / w - frame.radius, frame.height);
      const nearness = (rq[0] * x + rq[1] * y + rq[2] * z + rq[3]) / w;
      const column = Math.trunc(left), row = Math.trunc(top);
      weigh(left - column, across), weigh(top - row, down);
      let hidden = 0;
      for (let j = 0, at = row * stride + column; j < taps; ++j, at += stride)
        for (let k = 0; k < taps; ++k) if (map[at + k] > nearness) hidden += down[j] * across[k];
      visibility[v * L + l] = Math.min(Math.max(1 - hidden, 0), 1);
    }
  }

  /** The share of each light that reaches each vertex, [V, L]. casters: a list of {vertices, triangles}. */
  function visibility(light, surface, casters) {
    const L = light.list.length, result = new Float32Array(surface.vertices.length / 3 * L).fill(1);
    if (!casters.length) return result;
    const boxes = boxesOf(casters), stride = Math.max(...light.settings.resolutions);
    const map = new Float32Array(stride * stride);
    light.list.forEach((one, l) => {
      const frame = aim(one, light.settings, boxes);
      map.fill(empty);
      for (const caster of casters) draw(frame, caster, map);
      receive(frame, map, surface, light.settings.lift, result, l, L);
    });
    return result;
  }

  /** Irradiance and gloss of each vertex, [2 V]. centre: of the camera. */
  function shade(light, surface, visible, centre) {
    const { vertices, lit } = surface, V = vertices.length / 3, L = light.list.length, result = new Float32Array(2 * V);
    const fresnel = 1 / 0.04 - 1;
    for (let v = 0; v < V; ++v) {
      const x = vertices[3 * v], y = vertices[3 * v + 1], z = vertices[3 * v + 2];
      let nx = lit[3 * v], ny = lit[3 * v + 1], nz = lit[3 * v + 2];
      const n = 1 / Math.sqrt(nx * nx + ny * ny + nz * nz + 1e-8);
      nx *= n, ny *= n, nz *= n;
      let vx = centre[0] - x, vy = centre[1] - y, vz = centre[2] - z;
      const toCamera = 1 / Math.sqrt(vx * vx + vy * vy + vz * vz + 1e-8);
      vx *= toCamera, vy *= toCamera, vz *= toCamera;
      let irradiance = 0, specular = 0;
      for (let l = 0; l < L; ++l) {
        const one = light.list[l], at = one.at, share = visible[v * L + l];
        if (share === 0) continue;
        if (!one.isPoint) {
          const cosine = nx * at[0] + ny * at[1] + nz * at[2];
          if (cosine > 0) irradiance += one.intensity * share * cosine;
          continue;
        }
        let lx = at[0] - x, ly = at[1] - y, lz = at[2] - z;
        const inverse = 1 / Math.sqrt(lx * lx + ly * ly + lz * lz + 1e-8);
        lx *= inverse, ly *= inverse, lz *= inverse;
        const cosine = nx * lx + ny * ly + nz * lz;
        if (!(cosine > 0)) continue;
        const e = one.intensity * share * inverse * inverse * cosine;
        irradiance += e;
        if (!light.glossy) continue;
        let hx = vx + lx, hy = vy + ly, hz = vz + lz;
        const h = 1 / Math.sqrt(hx * hx + hy * hy + hz * hz + 1e-8);
        hx *= h, hy *= h, hz *= h;
        const grazing = 1 - (hx * vx + hy * vy + hz * vz), below = nx * hx + ny * hy + nz * hz - 1;
        specular += e * (1 + fresnel * grazing ** 5) * Math.exp(Math.max(light.sharpness * below, -87));
      }
      result[2 * v] = irradiance, result[2 * v + 1] = specular * light.strength;
    }
    return result;
  }

  return { turned, visibility, shade };
})();
