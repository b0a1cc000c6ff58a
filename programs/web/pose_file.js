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

  /**
   * The seconds of frames from the first: what frame_times of include/gsh/io/motion/frame_rate.hpp does. timestamps and
   * rate(key) are what the file states; fps is what the user states, or 0.
   */
  function frameTimes(frames, { timestamps, rate }, fps, fail, warn) {
    const slowest = 0.2, fastest = 1e5, text = (x) => String(Number(x.toPrecision(6)));
    const steps = Array.from({ length: frames - 1 }, (_, f) => timestamps ? timestamps[f + 1] - timestamps[f] : 0);
    const interval = timestamps && frames > 1 ? steps.slice().sort((a, b) => a - b)[steps.length >> 1] : 0;
    const keys = ["mocap_framerate", "mocap_frame_rate", "frame_rate", "framerate", "fps"];
    const key = timestamps ? "timestamps" : [...keys, "mocap_time_length"].find((one) => rate(one) !== undefined);
    const found = timestamps ? 1 / interval : key === "mocap_time_length" ? frames / rate(key) : key && rate(key);
    let perSecond = fps;
    if (fps > 0) {
      if (key && frames > 1 && !(Math.abs(found - fps) <= 0.005 * fps))
        warn(`${key}: ${text(found)} frames per second, but ${text(fps)} are stated, which are taken`);
    } else if (timestamps) {
      const at = steps.findIndex((step) => !(step > 0)) + 1;
      if (at > 0) fail(`timestamps ${steps[at - 1] < 0 ? "go back" : "stand still"} at frame ${at}`);
      if (interval * slowest >= 1) fail(`timestamps are ${text(interval)} apart, expected seconds`);
      return Float64Array.from({ length: frames }, (_, f) => timestamps[f] - timestamps[0]);
    } else if (key) {
      if (!(found >= slowest && found <= fastest))
        fail(`${key} is ${text(rate(key))}, expected frames per second above 0`);
      perSecond = found;
    } else {
      perSecond = 30;
      if (frames > 1) warn("no frame rate is stated, 30 frames per second are taken");
    }
    return Float64Array.from({ length: frames }, (_, f) => f / perSecond);
  }

  /**
   * The motion in the bytes of a file, for a page that has no server to ask. Refuses what load_motion refuses, and what
   * needs the body model: hands that count from the mean hand. fps: the rate that the user states, or 0.
   */
  async function read(buffer, name, person, fps = 0) {
    const J = person.parents.length, E = person.expressions, parts = partsOf(J), warnings = [];
    const arrays = await gsh.npz.read(buffer, name);
    const fail = (text) => {
      throw new Error(`${name}: ${text}`);
    };
    const shapeOf = ({ shape }) => `(${shape.join(", ")})`;
    /** An array whose numbers are finite. */
    const numbers = (key) => {
      const array = arrays[key];
      if (!array) fail(`${key} is missing; the file holds: ${Object.keys(arrays).join(", ").slice(0, 300)}`);
      if (!array.data) fail(`${key} has dtype ${array.type}, expected numbers; gsh-motion may convert it`);
      const at = array.data.findIndex((x) => !Number.isFinite(x));
      if (at < 0) return array;
      const row = Math.floor(at * (array.shape[0] || 1) / array.data.length);
      return fail(`${key}, row ${row}: a number is ${array.data[at]}, expected finite ones`);
    };
    let frames = 0;
    /** The numbers of every frame, `width` or any number of them; the first call determines the frames. */
    const rows = (key, width) => {
      const array = numbers(key), { shape, data } = array;
      const found = shape.slice(1).reduce((a, b) => a * b, 1);
      if (shape.length && !frames) frames = shape[0] || fail(`${key} holds no frames`);
      if (shape[0] !== frames || (width && found !== width))
        fail(`${key} has shape ${shapeOf(array)}, expected (${frames || "*"}, ${width || "*"})`);
      return { data, width: found };
    };
    const format = arrays.gsh_format?.text;
    if (format && format !== "motion 1") fail(`holds '${format}', but this page reads 'motion 1'`);
    if (!arrays[parts[0][0]])
      fail(`has no ${parts[0][0]}; this page reads gsh's own poses, and gsh-motion converts others`);
    const flat = ["flat_hand", "flat_hand_mean"].find((key) => arrays[key]?.data);
    if ((J === 55 || J === 52) && !(flat ? arrays[flat].data[0] : J === 52))
      fail("its hands count from a mean hand (flat_hand is not 1), which a page does not have; gsh-motion converts it");
    const found = parts.map(([key, count], k) => {
      if (k < 2 || arrays[key]) return rows(key, 3 * count).data; // the root and the body are required
      warnings.push(`${key} is missing, taken as zero`);
      return null;
    });
    const placeKeys = J === 55 ? ["trans", "transl"] : ["transl", "trans"];
    const transl = rows(placeKeys.find((key) => arrays[key]) || "transl", 3).data;
    const betas = numbers("betas"), sets = betas.shape.length > 1 ? betas.shape[0] : 1;
    if (betas.shape.length < 1 || betas.shape.length > 2 || sets === 0)
      fail(`betas has shape ${shapeOf(betas)}, expected (*,): one shape for all frames`);
    const expression = arrays.expression ? rows("expression") : null;
    const seconds = frameTimes(frames, {
      timestamps: arrays.timestamps && rows("timestamps", 1).data,
      rate: (key) => arrays[key] && numbers(key).data[0],
    }, fps, fail, (text) => warnings.push(text));
    const part = ([, count], k, f) => found[k]
      ? Array.from(found[k].subarray(3 * count * f, 3 * count * (f + 1))) : new Array(3 * count).fill(0);
    return {
      name, frames, warnings,
      betas: person.betas.map((_, k) => k < betas.data.length / sets ? betas.data[k] : 0),
      seconds,
      frame: (f) => ({
        pose: parts.flatMap((one, k) => part(one, k, f)),
        transl: Array.from(transl.subarray(3 * f, 3 * f + 3)),
        expression: expression && Array.from({ length: E },
          (_, k) => k < expression.width ? expression.data[f * expression.width + k] : 0),
      }),
    };
  }

  return { write, read };
})();
