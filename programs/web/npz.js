// SPDX-License-Identifier: Apache-2.0
// Writes and reads .npz files: zip archives of NumPy arrays.
"use strict";

gsh.npz = (() => {
  const crcTable = Uint32Array.from({ length: 256 }, (_, n) => {
    for (let k = 0; k < 8; ++k) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
    return n >>> 0;
  });
  function crc32(bytes) {
    let crc = 0xffffffff;
    for (const b of bytes) crc = crcTable[(crc ^ b) & 255] ^ (crc >>> 8);
    return (crc ^ 0xffffffff) >>> 0;
  }

  /** The bytes of an .npy file of doubles, or of bytes for a Uint8Array. */
  function npy(data, shape) {
    const type = data instanceof Uint8Array ? "|u1" : "<f8";
    const numbers = type === "|u1" ? data : Float64Array.from(data);
    const tuple = shape.length === 1 ? `(${shape[0]},)` : `(${shape.join(", ")})`;
    let text = `{'descr': '${type}', 'fortran_order': False, 'shape': ${tuple}, }`;
    text += " ".repeat(63 - ((10 + text.length) % 64)) + "\n";
    const bytes = new Uint8Array(10 + text.length + numbers.byteLength);
    bytes.set([0x93, 0x4e, 0x55, 0x4d, 0x50, 0x59, 1, 0, text.length & 255, text.length >> 8]);
    bytes.set(new TextEncoder().encode(text), 10);
    bytes.set(new Uint8Array(numbers.buffer, numbers.byteOffset, numbers.byteLength), 10 + text.length);
    return bytes;
  }

  /** The bytes of an archive. arrays: {name: {data, shape}}. */
  function write(arrays) {
    const parts = [], directory = [];
    let offset = 0;
    for (const [name, { data, shape }] of Object.entries(arrays)) {
      const file = npy(data, shape), path = new TextEncoder().encode(name + ".npy"), crc = crc32(file);
      const header = (size, central) => {
        const view = new DataView(new ArrayBuffer(size));
        view.setUint32(0, central ? 0x02014b50 : 0x04034b50, true);
        const at = central ? 6 : 4; // the version that is needed; the rest is the same in both headers
        if (central) view.setUint16(4, 20, true);
        view.setUint16(at, 20, true);
        view.setUint16(at + 8, 0x21, true); // 1 January 1980
        view.setUint32(at + 10, crc, true);
        view.setUint32(at + 14, file.length, true), view.setUint32(at + 18, file.length, true);
        view.setUint16(at + 22, path.length, true);
        if (central) view.setUint32(42, offset, true);
        return new Uint8Array(view.buffer);
      };
      const local = header(30, false);
      directory.push(header(46, true), path);
      parts.push(local, path, file);
      offset += local.length + path.length + file.length;
    }
    const size = directory.reduce((sum, part) => sum + part.length, 0), end = new DataView(new ArrayBuffer(22));
    end.setUint32(0, 0x06054b50, true);
    end.setUint16(8, directory.length / 2, true), end.setUint16(10, directory.length / 2, true);
    end.setUint32(12, size, true), end.setUint32(16, offset, true);
    return new Blob([...parts, ...directory, new Uint8Array(end.buffer)], { type: "application/octet-stream" });
  }

  const largest = 256 << 20; // bytes of all arrays of an archive
  const tooLarge = () => new Error("holds more than 256 MiB when inflated, the most that is read");

  /** Inflates bytes, to `most` at most. */
  async function inflate(bytes, most) {
    const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
    const chunks = [];
    let size = 0;
    for (let next = await reader.read(); !next.done; next = await reader.read()) {
      size += next.value.length;
      if (size > most) {
        await reader.cancel();
        throw tooLarge();
      }
      chunks.push(next.value);
    }
    const whole = new Uint8Array(size);
    size = 0;
    for (const chunk of chunks) whole.set(chunk, size), size += chunk.length;
    return whole;
  }

  /**
   * The array in the bytes of an .npy file: {type, shape, data}, without data unless its numbers can be read. A single
   * text has `text` instead, its first 64 characters.
   */
  function parseNpy(bytes, key) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    if (view.getUint32(0) !== 0x934e554d) throw new Error(`${key} is not an .npy array`);
    const long = bytes[6] > 1, length = long ? view.getUint32(8, true) : view.getUint16(8, true);
    const begin = (long ? 12 : 10) + length;
    const header = new TextDecoder("latin1").decode(bytes.subarray(long ? 12 : 10, begin));
    const descr = /'descr':\s*'([^']*)'/.exec(header), shapeText = /'shape':\s*\(([^)]*)\)/.exec(header);
    if (!shapeText) throw new Error(`${key} has an unknown header`);
    const kinds = { "<f8": Float64Array, "<f4": Float32Array, "<i4": Int32Array, "<u4": Uint32Array, "<i2": Int16Array,
                    "<u2": Uint16Array, "|i1": Int8Array, "|u1": Uint8Array, "|b1": Uint8Array, "<i8": BigInt64Array,
                    "<u8": BigUint64Array };
    const shape = shapeText[1].split(",").map((s) => s.trim()).filter((s) => s).map(Number);
    const inColumns = /'fortran_order':\s*True/.test(header) && shape.length > 1;
    const type = (descr ? descr[1] : "of a record") + (inColumns ? " in Fortran order" : ""), Kind = kinds[type];
    const text = /^<U(\d+)$/.exec(type); // of code points in four bytes each, behind them zeros
    if (text && shape.length < 2 && (shape[0] ?? 1) === 1 && bytes.length - begin === 4 * text[1]) {
      const points = new Uint32Array(bytes.slice(begin).buffer).filter((point) => point > 0 && point < 0x110000);
      return { type, shape, text: String.fromCodePoint(...points.slice(0, 64)) };
    }
    if (!Kind) return { type, shape };
    const size = shape.reduce((a, b) => a * b, Kind.BYTES_PER_ELEMENT);
    if (!shape.every((n) => Number.isSafeInteger(n) && n >= 0) || size !== bytes.length - begin)
      throw new Error(`${key} has shape (${shape.join(", ")}), which does not fit its ${bytes.length - begin} bytes`);
    const data = new Kind(bytes.slice(begin).buffer);
    return { type, shape, data: data instanceof BigInt64Array || data instanceof BigUint64Array
      ? Float64Array.from(data, Number) : data };
  }

  /**
   * Reads the arrays of an archive of at most 256 MiB: {key: {type, shape, data}}, as parseNpy returns them.
   * Errors begin with `name`, that of the file.
   */
  async function read(buffer, name) {
    try {
      return await readMembers(buffer);
    } catch (error) { // from a DataView, or from inflating
      const broken = error instanceof RangeError || error instanceof TypeError;
      throw new Error(`${name}: ${broken ? "is damaged" : error.message}`);
    }
  }

  const converted = "expected an .npz archive; docs/captures.md has a program that converts it";

  /** What a file is that is no archive, as io/file/foreign_file.hpp names it; "" for a kind that is not known. */
  function kindOf(bytes) {
    const start = String.fromCharCode(...bytes.subarray(0, 20));
    if (/^\x80[\x02-\x05]/.test(start)) return `is a pickle of Python, ${converted}`;
    if (start.startsWith("\x93NUMPY")) return `is a single array of NumPy (.npy), ${converted}`;
    if (/^(\x89HDF|MATLAB)/.test(start)) return `is an HDF5 or MATLAB file, ${converted}`;
    if (/^\s*HIERARCHY|^glTF|^\s*\{/.test(start)) return "is a motion of another rig; gsh-motion converts it to .npz";
    if (/^(Kaydara FBX|; FBX)/.test(start)) return "is an FBX file; convert it to GLB with Blender, then with gsh-motion";
    return "";
  }

  async function readMembers(buffer) {
    const bytes = new Uint8Array(buffer), view = new DataView(buffer), arrays = {};
    let end = bytes.length - 22, left = largest;
    while (end >= 0 && view.getUint32(end, true) !== 0x06054b50) --end;
    if (end < 0) throw new Error(kindOf(bytes) || "is not an .npz archive, or a truncated one");
    let at = view.getUint32(end + 16, true);
    for (let n = view.getUint16(end + 10, true); n > 0; --n) {
      if (view.getUint32(at, true) !== 0x02014b50) throw new Error("is damaged");
      const method = view.getUint16(at + 10, true), crc = view.getUint32(at + 16, true);
      const size = view.getUint32(at + 20, true);
      const lengths = [28, 30, 32].map((o) => view.getUint16(at + o, true)), local = view.getUint32(at + 42, true);
      const member = new TextDecoder().decode(bytes.subarray(at + 46, at + 46 + lengths[0]));
      if (member.endsWith("data.pkl")) throw new Error(`is a file of PyTorch, ${converted}`);
      const key = member.replace(/\.npy$/, "");
      const begin = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
      const stored = bytes.subarray(begin, begin + size);
      if (method !== 0 && method !== 8) throw new Error(`${key} is packed by method ${method}, which is not read`);
      const file = method === 8 ? await inflate(stored, left) : stored;
      left -= file.length;
      if (left < 0) throw tooLarge();
      if (crc32(file) !== crc) throw new Error(`${key} is damaged`);
      arrays[key] = parseNpy(file, key);
      at += 46 + lengths[0] + lengths[1] + lengths[2];
    }
    return arrays;
  }

  return { write, read, largest };
})();
