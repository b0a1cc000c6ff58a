// SPDX-License-Identifier: Apache-2.0
// Joints by name: which group of sliders a joint belongs to, what it is called on the page, and its mirror image.
"use strict";

gsh.joints = (() => {
  const body = ["pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle",
    "right_ankle", "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"];
  const fingers = (side) => ["index", "middle", "pinky", "ring", "thumb"]
    .flatMap((finger) => [1, 2, 3].map((n) => `${side}_${finger}${n}`));
  const known = {
    55: [...body, "jaw", "left_eye", "right_eye", ...fingers("left"), ...fingers("right")], // SMPL-X
    52: [...body, ...fingers("left"), ...fingers("right")], // SMPL-H
    24: [...body, "left_hand", "right_hand"], // SMPL
  };

  /** A body's own names, or those of the SMPL family, or numbers. */
  function names(own, count) {
    if (own.length === count) return own;
    return known[count] || Array.from({ length: count }, (_, j) => `joint ${j}`);
  }

  function group(name) {
    const n = name.toLowerCase();
    if (/jaw|eye|tongue|brow|lip|teeth/.test(n)) return "face";
    if (!/index|middle|pinky|little|ring|thumb|finger/.test(n)) return "body";
    return /right|_r$|^r_/.test(n) ? "right hand" : "left hand";
  }

  function label(name) {
    const [side] = /^(left|right)/.exec(name) || [];
    const rest = (side ? name.slice(side.length) : name).replace(/_/g, " ").replace(/([a-z])(\d)/, "$1 $2").trim();
    return (side ? `${side} ` : "") + rest;
  }

  /** For each joint its mirror image: the other side's joint, or itself. */
  function mirrorImages(list) {
    const other = (name) => /left/i.test(name) ? name.replace("left", "right").replace("Left", "Right")
      : name.replace("right", "left").replace("Right", "Left");
    return list.map((name, j) => {
      const at = list.indexOf(other(name));
      return at < 0 ? j : at;
    });
  }

  /** A pose reflected at the plane between left and right: rotations (x, y, z) become (x, -y, -z). */
  function mirrored(pose, list) {
    const images = mirrorImages(list), result = pose.slice();
    images.forEach((from, j) => {
      result[3 * j] = pose[3 * from];
      result[3 * j + 1] = -pose[3 * from + 1];
      result[3 * j + 2] = -pose[3 * from + 2];
    });
    return result;
  }

  return { names, group, label, mirrored };
})();
