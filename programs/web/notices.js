// SPDX-License-Identifier: Apache-2.0
// What the page tells: messages, the stages of loading, hints, and the help.
"use strict";

gsh.notices = (() => {
  const element = (id) => document.getElementById(id);

  // ---- messages ----

  let timer = 0, standing = ""; // standing: what is shown whenever there is nothing else
  function show(text, kind, canBeClosed) {
    const box = element("message"), words = element("message-text");
    clearTimeout(timer);
    box.className = text ? kind : "";
    words.setAttribute("role", kind === "error" ? "alert" : "status");
    words.textContent = text;
    element("message-close").hidden = !text || !canBeClosed;
  }
  const close = () => show(standing, "error", false);

  /** kind: "error" and "info" stay until they are closed or another message comes; "good" goes by itself. */
  function say(text, kind = "error") {
    show(text, kind, true);
    if (kind === "good") timer = setTimeout(close, 6000);
  }
  /** A message that stays, also after others, until this is called with "". */
  function stand(text) {
    standing = text;
    close();
  }

  // ---- loading ----

  /** A stage of loading. share: how much of it is done, from 0 to 1, if that is known; amount: the same in words. */
  function stage(text, share = null, amount = "") {
    element("loading").hidden = false;
    if (element("loading-stage").textContent !== text) element("loading-stage").textContent = text;
    if (share === null) element("loading-bar").removeAttribute("value");
    else element("loading-bar").value = share;
    element("loading-amount").textContent = amount;
  }
  const loaded = () => (element("loading").hidden = true);
  /** Resolves when the browser has shown what was changed; in a tab in the background, soon. */
  const shown = () => new Promise((done) => {
    requestAnimationFrame(() => setTimeout(done));
    setTimeout(done, 100);
  });

  // ---- hints and help ----

  const hints = { mouse: "drag to turn · shift-drag to move · wheel to zoom",
                  touch: "one finger turns · two fingers move and zoom" };
  /** Shows what the mouse, or a finger, does with the picture. */
  function pointer(kind) {
    document.documentElement.dataset.pointer = kind;
    element("hint").textContent = hints[kind];
  }
  const hintUsed = () => element("hint").classList.add("gone");

  function listen() {
    pointer(matchMedia("(pointer: coarse)").matches ? "touch" : "mouse");
    const ofEvent = ({ pointerType }) => pointer(pointerType === "touch" ? "touch" : "mouse");
    document.addEventListener("pointerdown", ofEvent, true);
    element("message-close").addEventListener("click", close);
    element("help-open").addEventListener("click", () => element("help").showModal());
    element("help-close").addEventListener("click", () => element("help").close());
    const toggle = element("panel-toggle");
    toggle.addEventListener("click", () => {
      const open = toggle.getAttribute("aria-expanded") === "false";
      toggle.setAttribute("aria-expanded", String(open));
      element("app").classList.toggle("without-panel", !open);
    });
  }

  return { say, stand, close, stage, loaded, shown, hintUsed, listen };
})();
