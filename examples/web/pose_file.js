// SPDX-License-Identifier: Apache-2.0
// gsh's own motion files as arrays of an .npz: see include/gsh/io/motion/motion_file.hpp.
"use strict";

gsh.poseFile = (() => {
  /** The parts of a pose with their numbers of joints. */
  const partsOf = (joints) => joints === 55
    ? [["global_orient", 1], ["body_pose", 21], ["jaw_pose", 1], ["leye_pose", 1], ["reye_pose", 1],
       ["left_hand_pose", 15], ["right_hand_pose", 15]]
    : [["poses", joints]];

  /** One pose as the bytes of a file. */
  function write(person, state) {
    const arrays = { betas: { data: state.betas, shape: [state.betas.length] } };
    if (state.expression.length) arrays.expression = { data: state.expression, shape: [1, state.expression.length] };
    let first = 0;
    for (const [name, count] of partsOf(person.parents.length)) {
      arrays[name] = { data: state.pose.slice(3 * first, 3 * (first + count)), shape: [1, 3 * count] };
      first += count;
    }
    arrays.transl = { data: state.transl, shape: [1, 3] };
    arrays.timestamps = { data: [0], shape: [1] };
    arrays.flat_hand = { data: Uint8Array.of(1), shape: [1] }; // the hand poses are complete
    return gsh.npz.write(arrays);
  }

  /** The motion in the bytes of a file, for a page that has no server to ask. */
  async function read(buffer, name, person) {
    const arrays = await gsh.npz.read(buffer), E = person.expressions, { expression } = arrays;
    const parts = partsOf(person.parents.length), first = arrays[parts[0][0]], transl = arrays.transl || arrays.trans;
    if (!first || first.shape.length !== 2)
      throw new Error(`${name}: has no ${parts[0][0]}; this page reads gsh's own poses`);
    const frames = first.shape[0], rate = arrays.mocap_framerate ? arrays.mocap_framerate.data[0] : 30;
    for (const [key, count] of parts)
      if (arrays[key] && arrays[key].data.length !== 3 * count * frames)
        throw new Error(`${name}: ${key} has not ${3 * count} numbers a frame`);
    if (transl && transl.data.length !== 3 * frames) throw new Error(`${name}: transl has not 3 numbers a frame`);
    const rows = ([key, count], f) => arrays[key]
      ? Array.from(arrays[key].data.subarray(3 * count * f, 3 * count * (f + 1))) : new Array(3 * count).fill(0);
    const width = expression ? expression.data.length / frames : 0;
    const times = arrays.timestamps && arrays.timestamps.data.length === frames ? arrays.timestamps.data : null;
    return {
      name, frames, warnings: [],
      betas: arrays.betas ? Array.from(arrays.betas.data.slice(0, person.betas.length)) : [],
      seconds: Float64Array.from({ length: frames }, (_, f) => times ? times[f] - times[0] : f / rate),
      frame: (f) => ({
        pose: parts.flatMap((part) => rows(part, f)),
        transl: transl ? Array.from(transl.data.subarray(3 * f, 3 * f + 3)) : [0, 0, 0],
        expression: width ? Array.from({ length: E }, (_, k) => k < width ? expression.data[f * width + k] : 0) : null,
      }),
    };
  }

  return { write, read };
})();
