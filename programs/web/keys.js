// SPDX-License-Identifier: Apache-2.0
// The keys of the page.
"use strict";

gsh.keys = (() => {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  /** Elements that use the arrow keys themselves, and those that use the space bar. */
  const usesArrows = 'input:not([type="checkbox"], [type="color"]), select, [role="toolbar"], dialog';
  const usesSpace = "input, select, button, summary, dialog";

  /** A key on the picture itself; false if it is none of the camera's. */
  function moveCamera({ key, shiftKey }, camera) {
    const arrow = arrows[key], { turn, move, zoom, reset } = camera;
    if (arrow) (shiftKey ? move : turn)(...arrow);
    else if (key === "+" || key === "=") zoom(1);
    else if (key === "-" || key === "_") zoom(-1);
    else if (key === "0") reset();
    else return false;
    return true;
  }

  /**
   * camera: {turn(right, down), move(right, down), zoom(steps), reset()} in steps; player: {play(), step(frames)} or
   * null, if nothing can be played; mayUse(): whether keys count at present.
   */
  function listen(picture, camera, player, mayUse) {
    document.addEventListener("keydown", (event) => {
      const { key, target } = event;
      if (event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
      if (key === "Escape" && !target.closest("dialog")) return gsh.notices.close();
      if (!mayUse()) return;
      const onPicture = target === picture || (!player && !target.closest(usesArrows));
      if (onPicture && moveCamera(event, camera)) return event.preventDefault();
      if (!player) return;
      if (key === " " && !target.closest(usesSpace)) player.play();
      else if (key === "ArrowRight" && !target.closest(usesArrows)) player.step(1);
      else if (key === "ArrowLeft" && !target.closest(usesArrows)) player.step(-1);
      else return;
      event.preventDefault();
    });
  }

  /**
   * Makes one tab stop of many: rows is a list of lists of elements, of which one row is reached by Tab. `back` and
   * `forth` are the keys that lead to the same element of the row before and after it.
   */
  function rove(container, rows, back, forth) {
    const stop = (chosen) => rows.forEach((row, r) => row.forEach((one) => (one.tabIndex = r === chosen ? 0 : -1)));
    const rowOf = (target) => rows.findIndex((row) => row.includes(target));
    container.addEventListener("focusin", ({ target }) => rowOf(target) >= 0 && stop(rowOf(target)));
    container.addEventListener("keydown", (event) => {
      const r = rowOf(event.target), next = r + (forth.includes(event.key) ? 1 : back.includes(event.key) ? -1 : 0);
      if (r < 0 || next === r) return;
      event.preventDefault(); // also at the ends: a slider's own keys would change it
      rows[next]?.[rows[r].indexOf(event.target)].focus();
    });
    stop(0);
  }

  return { listen, rove };
})();
