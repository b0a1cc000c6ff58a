// SPDX-License-Identifier: Apache-2.0
// Reads packages: named arrays with a JSON header in one block of bytes (examples/programs/view/package.hpp).
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

  /** The bytes of a text in base 64. */
  function fromBase64(text) {
    const binary = atob(text.trim()), bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; ++i) bytes[i] = binary.charCodeAt(i);
    return bytes.buffer;
  }

  return { read, fromBase64 };
})();
