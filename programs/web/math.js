// SPDX-License-Identifier: Apache-2.0
// Small vectors and rotations. Vectors are arrays of three numbers, matrices of nine, row by row.
"use strict";
globalThis.gsh = globalThis.gsh || {};

gsh.math = (() => {
  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const length = (a) => Math.hypot(a[0], a[1], a[2]);
  const normalize = (a) => scale(a, 1 / length(a));
  const times = (m, v) => [
    m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
    m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
    m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
  ];

  /** The rotation by |v| radians about v (Rodrigues). */
  function rotation(x, y, z) {
    const squared = x * x + y * y + z * z, angle = Math.sqrt(squared);
    const small = squared < 1e-8;
    const a = small ? 1 - squared / 6 : Math.sin(angle) / angle;
    const b = small ? 0.5 - squared / 24 : (1 - Math.cos(angle)) / squared;
    return [
      1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y,
      b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x,
      b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y),
    ];
  }

  /** The unit quaternion (w, x, y, z) of a rotation. */
  function quaternion(R) {
    const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = R;
    const q = xx + yy + zz > 0 ? [1 + xx + yy + zz, zy - yz, xz - zx, yx - xy]
      : xx > yy && xx > zz ? [zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx]
      : yy > zz ? [xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy]
      : [yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz];
    const s = 1 / Math.hypot(...q) * (q[0] < 0 ? -1 : 1);
    return q.map((x) => x * s);
  }

  /** Between two rotation vectors, the shorter way: a at share 0, b at share 1. */
  function between(a, b, share) {
    const versor = ([x, y, z]) => {
      const angle = Math.hypot(x, y, z), s = angle < 1e-8 ? 0.5 : Math.sin(angle / 2) / angle;
      return [Math.cos(angle / 2), x * s, y * s, z * s];
    };
    const p = versor(a), q = versor(b), cosine = p.reduce((sum, x, k) => sum + x * q[k], 0);
    const turn = cosine < 0 ? -share : share;
    const angle = Math.acos(Math.min(Math.abs(cosine), 1)), sine = Math.sin(angle);
    const weight = (x) => sine < 1e-6 ? x : Math.sin(x * angle) / sine, u = weight(1 - share), v = weight(turn);
    let [w, ...xyz] = p.map((x, k) => u * x + v * q[k]);
    if (w < 0) w = -w, xyz = scale(xyz, -1);
    const size = length(xyz);
    return size < 1e-9 ? scale(xyz, 2) : scale(xyz, 2 * Math.atan2(size, w) / size);
  }

  return { between, add, subtract, scale, dot, cross, length, normalize, times, rotation, quaternion };
})();
