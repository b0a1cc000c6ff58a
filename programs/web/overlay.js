// SPDX-License-Identifier: Apache-2.0
// Draws the skeletons over the picture.
"use strict";

gsh.overlay = (() => {
  /** people: as the scene describes them; states: their poses; camera: of the picture. Fills the canvas. */
  function draw(canvas, people, states, camera) {
    const ratio = globalThis.devicePixelRatio || 1, context = canvas.getContext("2d");
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) canvas.width = width, canvas.height = height;
    context.clearRect(0, 0, width, height);
    const scale = [width / camera.size[0], height / camera.size[1]];
    const place = (p) => {
      const c = gsh.math.add(gsh.math.times(camera.R, p), camera.t);
      return c[2] > 0.05 ? [(camera.focal[0] * c[0] / c[2] + camera.centre[0]) * scale[0],
                            (camera.focal[1] * c[1] / c[2] + camera.centre[1]) * scale[1]] : null;
    };
    people.forEach((person, p) => {
      const posed = gsh.skeleton.pose(person, states[p]).posed;
      const points = person.parents.map((_, j) => place(posed.subarray(3 * j, 3 * j + 3)));
      const names = gsh.joints.names(person.joint_names, person.parents.length);
      const small = (j) => gsh.joints.group(names[j]) !== "body";
      context.lineCap = "round";
      for (const [color, extra] of [["rgba(10, 12, 16, 0.55)", 2.5], ["#8cc2ff", 0]])
        person.parents.forEach((parent, j) => {
          if (parent < 0 || !points[j] || !points[parent]) return;
          context.strokeStyle = color;
          context.lineWidth = ((small(j) ? 1 : 2) + extra) * ratio;
          context.beginPath();
          context.moveTo(...points[parent]), context.lineTo(...points[j]);
          context.stroke();
        });
      points.forEach((point, j) => {
        if (!point) return;
        context.fillStyle = "#f3f6fa";
        context.beginPath();
        context.arc(...point, (small(j) ? 1.4 : 3) * ratio, 0, 2 * Math.PI);
        context.fill();
      });
    });
  }

  return { draw };
})();
