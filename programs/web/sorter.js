// SPDX-License-Identifier: Apache-2.0
// Sorts splats by depth, front to back, in a worker.
"use strict";

gsh.sorter = (() => {
  /**
   * The slots of the splats beyond the near plane, nearest first; equally near ones stay in order. means: four numbers
   * a slot, of which the first three are the position. ranges: [[first slot, count], …]. Depth is row x + shift.
   * The bits of positive floats are in the order of their values: two counting passes of 16 bits sort exactly.
   */
  function sort(means, ranges, row, shift) {
    let total = 0;
    for (const [, count] of ranges) total += count;
    const depths = new Float32Array(total), slots = new Uint32Array(total);
    let n = 0;
    for (const [first, count] of ranges)
      for (let slot = first, at = 4 * first; slot < first + count; ++slot, at += 4) {
        const depth = row[0] * means[at] + row[1] * means[at + 1] + row[2] * means[at + 2] + shift;
        if (depth > 0.2) depths[n] = depth, slots[n++] = slot;
      }
    const keys = new Uint32Array(depths.buffer), a = new Uint32Array(n), b = new Uint32Array(n);
    const counts = new Uint32Array(65537);
    const pass = (from, to, bits) => {
      counts.fill(0);
      for (let i = 0; i < n; ++i) ++counts[((keys[i] >>> bits) & 65535) + 1];
      for (let k = 0; k < 65536; ++k) counts[k + 1] += counts[k];
      for (let i = 0; i < n; ++i) {
        const index = from ? from[i] : i;
        to[counts[(keys[index] >>> bits) & 65535]++] = index;
      }
    };
    pass(null, a, 0), pass(a, b, 16);
    for (let i = 0; i < n; ++i) a[i] = slots[b[i]];
    return a;
  }

  /** A worker that answers {row, shift, ticket} by {order, ticket}; {means, ranges} sets the positions. */
  function worker() {
    const source = document.querySelector('script[data-module="sorter.js"]').textContent;
    const loop = `globalThis.gsh = {};${source}
      let means = null, ranges = null;
      onmessage = ({ data }) => {
        if (data.means) means = data.means, ranges = data.ranges;
        if (!data.row) return;
        const order = gsh.sorter.sort(means, ranges, data.row, data.shift);
        postMessage({ order, ticket: data.ticket }, [order.buffer]);
      };`;
    const url = URL.createObjectURL(new Blob([loop], { type: "text/javascript" })), result = new Worker(url);
    URL.revokeObjectURL(url);
    return result;
  }

  return { sort, worker };
})();
