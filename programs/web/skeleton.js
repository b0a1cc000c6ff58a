// SPDX-License-Identifier: Apache-2.0
// Forward kinematics, as include/gsh/body/skeleton.hpp and include/gsh/avatar/rig.hpp.
"use strict";

gsh.skeleton = (() => {
  /** Rest positions of the joints [3 J] for betas and an expression. person: as the scene describes it. */
  function restJoints(person, betas, expression) {
    const J = person.parents.length, S = person.betas.length, E = person.expressions;
    const joints = Float64Array.from(person.rest_joints);
    for (let j = 0; j < J; ++j)
      for (let axis = 0; axis < 3; ++axis) {
        let sum = 0;
        for (let k = 0; k < S; ++k)
          sum += person.shape_directions[(j * S + k) * 3 + axis] * (betas[k] - person.betas[k]);
        for (let k = 0; k < E; ++k) sum += person.expression_directions[(j * E + k) * 3 + axis] * expression[k];
        joints[3 * j + axis] += sum;
      }
    return joints;
  }

  /**
   * Bones of a pose: B_j carries canonical points to the pose, B_j(x) = B_parent(R_j (x - J_j) + J_j).
   * Returns rotations (a list of 3x3), bones [12 J] as rows of 3x4, and posed joints [3 J].
   */
  function pose(person, state) {
    const J = person.parents.length, joints = restJoints(person, state.betas, state.expression);
    const bones = new Float64Array(12 * J), posed = new Float64Array(3 * J), rotations = [];
    for (let j = 0; j < J; ++j) {
      const R = gsh.math.rotation(state.pose[3 * j], state.pose[3 * j + 1], state.pose[3 * j + 2]);
      rotations.push(R);
      const J_j = joints.subarray(3 * j, 3 * j + 3), t = gsh.math.subtract(J_j, gsh.math.times(R, J_j));
      const parent = person.parents[j], B = bones.subarray(12 * j, 12 * j + 12);
      if (parent < 0) {
        for (let r = 0; r < 3; ++r) {
          B.set(R.slice(3 * r, 3 * r + 3), 4 * r);
          B[4 * r + 3] = t[r] + state.transl[r];
        }
      } else {
        const P = bones.subarray(12 * parent, 12 * parent + 12);
        for (let r = 0; r < 3; ++r) {
          for (let c = 0; c < 3; ++c)
            B[4 * r + c] = P[4 * r] * R[c] + P[4 * r + 1] * R[3 + c] + P[4 * r + 2] * R[6 + c];
          B[4 * r + 3] = P[4 * r] * t[0] + P[4 * r + 1] * t[1] + P[4 * r + 2] * t[2] + P[4 * r + 3];
        }
      }
      for (let r = 0; r < 3; ++r)
        posed[3 * j + r] = B[4 * r] * J_j[0] + B[4 * r + 1] * J_j[1] + B[4 * r + 2] * J_j[2] + B[4 * r + 3];
    }
    return { rotations, bones, posed };
  }

  /** Bones as dual quaternions [8 J]: real (w x y z), dual. */
  function dualQuaternions(bones) {
    const J = bones.length / 12, result = new Float32Array(8 * J);
    for (let j = 0; j < J; ++j) {
      const B = bones.subarray(12 * j, 12 * j + 12), t = [B[3], B[7], B[11]];
      const q = gsh.math.quaternion([B[0], B[1], B[2], B[4], B[5], B[6], B[8], B[9], B[10]]);
      const v = q.slice(1), c = gsh.math.cross(t, v);
      result.set([...q, -0.5 * gsh.math.dot(t, v), ...[0, 1, 2].map((k) => 0.5 * (t[k] * q[0] + c[k]))], 8 * j);
    }
    return result;
  }

  return { pose, dualQuaternions };
})();
