// SPDX-License-Identifier: Apache-2.0
// Reads packages: named arrays with a JSON header in one block of bytes (programs/view/package.hpp).
"use strict";

gsh.package = (() => {
  const types = { f32: Float32Array, u8: Uint8Array, u16: Uint16Array, u32: Uint32Array };

  /** Returns {header, array(name), has(name)}. An array has data, rows and columns; steps are undone. */
  function read(buffer) {
    const magic = new TextDecoder().decode(new Uint8Array(buffer, 0, 8));
    if (magic !== "GSHVIEW1") throw new Error("the data is not a package of gsh-view");
    const length = new DataView(buffer).getUint32(8, true), begin = 12 + length;
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 12, length)));
    const array = (name) => {
      const at = header.arrays[name];
      if (!at) throw new Error(`the package has no array ${name}`);
      const [rows, columns] = at.shape;
      let data = new types[at.type](buffer, begin + at.offset, rows * columns);
      if (at.low) {
        const exact = new Float32Array(data.length);
        for (let i = 0; i < data.length; ++i) exact[i] = at.low[i % columns] + at.step[i % columns] * data[i];
        data = exact;
      }
      return { data, rows, columns };
    };
    return { header, array, has: (name) => name in header.arrays };
  }

  /** The bytes of a text in base 64, piece by piece. progress(share, total bytes) is called after each piece. */
  async function fromBase64(text, progress) {
    const digits = text.trim(), piece = 4 << 20; // characters; four hold three bytes
    const bytes = new Uint8Array(digits.length / 4 * 3 - (digits.endsWith("==") ? 2 : digits.endsWith("=") ? 1 : 0));
    for (let from = 0, at = 0; from < digits.length; from += piece) {
      const binary = atob(digits.slice(from, from + piece));
      for (let i = 0; i < binary.length; ++i) bytes[at++] = binary.charCodeAt(i);
      if (!progress) continue;
      progress(at / bytes.length, bytes.length);
      await gsh.notices.shown();
    }
    return bytes.buffer;
  }

  return { read, fromBase64 };
})();
