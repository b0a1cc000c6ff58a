// SPDX-License-Identifier: Apache-2.0
// The panel beside the picture: motion, view and pose.
"use strict";

/**
 * actions: {change, useMotion(index), openFile(file), useEngine(name), resetView, turn(right, down), move(right, down),
 * zoom(steps), savePicture, changeNumber, resetPose, restPose, mirror, savePose, choosePerson(index),
 * turnUpsideDown(on)}. `page` is the state that the controls change.
 */
gsh.Panel = class {
  constructor(scene, page, canChooseEngine, actions) {
    const { people } = scene;
    this.scene = scene, this.page = page, this.actions = actions;
    this.motions = null; // the list of motions, a select
    this.needServer = []; // controls that do nothing without the server
    const parts = people.length ? [this.motionPart(), this.viewPart(canChooseEngine), this.posePart()]
      : [this.viewPart(canChooseEngine)];
    document.getElementById("sections").replaceChildren(...parts);
    document.getElementById("title").textContent = scene.names.join(", ");
    const count = people.reduce((sum, p) => sum + p.gaussians, scene.gaussians);
    const about = [`${count.toLocaleString("en")} Gaussians`];
    if (people.length === 1) about.push(`${people[0].parents.length} joints`);
    if (people.length > 1) about.push(`${people.length} people`);
    document.getElementById("about").textContent = about.join(" · ");
    document.title = `${scene.names[0]} · gsh-view`;
  }

  part(title, ...children) {
    const { make } = gsh.controls;
    return make("section", { class: "part" }, make("h2", {}, title), ...children);
  }
  buttons(...children) { return gsh.controls.make("div", { class: "buttons" }, ...children); }

  motionPart() {
    const { make, button, choice } = gsh.controls, { people } = this.scene;
    const motions = choice("Motion", [], null, (value) => this.actions.useMotion(Number(value)));
    this.motions = motions.select;
    const file = make("input", { type: "file", hidden: true, onchange: () => {
      if (file.files[0]) this.actions.openFile(file.files[0]);
      file.value = "";
    } });
    const whose = people.length > 1 ? [choice("Person", people.map((p, k) => [String(k), p.name]), "0",
      (value) => this.actions.choosePerson(Number(value))).row] : [];
    const rate = make("input", { type: "number", class: "number", min: "0", step: "any", placeholder: "as stated",
      "aria-label": "frames per second of files",
      title: "frames per second of the files that you open, whatever they state",
      onchange: () => (this.page.inputFps = Number(rate.value) || 0) });
    const rateRow = make("label", { class: "row" }, make("span", {}, "File's fps"), rate);
    const open = button("Open a motion…", "or drop a file onto the picture", () => file.click());
    this.needServer.push(open, rate);
    return this.part("Motion", ...whose, motions.row, rateRow, this.buttons(open, file));
  }

  viewPart(canChooseEngine) {
    const { make, button, choice, toggle, slider } = gsh.controls, { page, actions } = this;
    const { people, size } = this.scene;
    const set = (name) => (value) => {
      page[name] = value;
      actions.change();
    };
    const show = choice("Show", [["splats", "Gaussians"], ["ellipsoids", "ellipsoids"]], page.show, set("show"));
    const toggles = [];
    if (people.length) toggles.push(toggle("Skeleton", page.skeleton, set("skeleton")).row);
    if (people.length) toggles.push(toggle("Follow", page.follow, set("follow")).row);
    if (people.some((p) => p.shadows)) toggles.push(toggle("Shadows", page.shadows, set("shadows")).row);
    if (!people.length) toggles.push(toggle("y points down", this.scene.y_down, actions.turnUpsideDown).row);
    const turn = { label: "Turn light", name: "light", least: -180, most: 180, step: 1, digits: 0, value: 0, unit: "°",
                   changed: (x) => set("lightTurn")(x * Math.PI / 180) };
    const light = people.some((p) => p.lit) ? [slider(turn).row] : [];
    for (const row of light) row.classList.add("named");
    const color = make("input", { type: "color", value: "#23272e", "aria-label": "background", oninput: () => {
      document.getElementById("stage").style.background = color.value;
      set("background")([1, 3, 5].map((k) => parseInt(color.value.slice(k, k + 2), 16) / 255));
    } });
    const sizes = [...new Set([270, 360, 540, 720, 1080, size])].sort((a, b) => a - b);
    const resolution = choice("Resolution", sizes.map((r) => [String(r), `${r} pixels`]), String(page.resolution),
      (value) => set("resolution")(Number(value)));
    const names = [["server", "server: gsh draws"], ["client", "client: this browser"]];
    const engines = canChooseEngine ? [choice("Engine", names, null, actions.useEngine)] : [];
    this.engines = engines.length ? engines[0].select : null;
    this.needServer.push(...engines.map((one) => one.select));
    this.note = make("p", { class: "note", hidden: true });
    return this.part("View", show.row, make("div", { class: "toggles" }, ...toggles), ...light,
      make("label", { class: "row" }, make("span", {}, "Background"), color), resolution.row,
      ...engines.map((one) => one.row), this.note, this.cameraPad(),
      this.buttons(button("Reset view", "from the front; a double click does the same", actions.resetView),
        button("Save PNG", "the picture without loss", actions.savePicture)));
  }

  /** What drags and the wheel do, as buttons; the arrow keys go from one to the next, so they are one tab stop. */
  cameraPad() {
    const { make, button } = gsh.controls, { turn, move, zoom } = this.actions;
    const arrows = [["←", "left", -1, 0], ["→", "right", 1, 0], ["↑", "up", 0, -1], ["↓", "down", 0, 1]];
    const rows = [["turn", turn, arrows], ["move", move, arrows], ["zoom", zoom, [["+", "in", 1], ["−", "out", -1]]]];
    const pad = make("div", { class: "pad", role: "toolbar", "aria-label": "Camera" }), buttons = [];
    for (const [what, act, signs] of rows) {
      const own = signs.map(([sign, where, ...steps]) => button(sign, `${what} ${where}`, () => act(...steps)));
      for (const one of own) one.setAttribute("aria-label", one.title);
      buttons.push(...own);
      pad.append(make("div", { class: "keys", role: "group", "aria-label": what }, make("span", {}, what), ...own));
    }
    gsh.keys.rove(pad, buttons.map((one) => [one]), ["ArrowLeft", "ArrowUp"], ["ArrowRight", "ArrowDown"]);
    return make("div", { class: "row" }, make("span", {}, "Camera"), pad);
  }

  posePart() {
    const { make, button } = gsh.controls, { actions } = this;
    this.sliderPlace = make("div");
    return this.part("Pose", this.buttons(
      button("Reset", "back to the motion's frame", actions.resetPose),
      button("Rest pose", "all angles zero, no expression, the avatar's own shape", actions.restPose),
      button("Mirror", "exchange left and right", actions.mirror),
      button("Save pose", "as .npz, which all programs of gsh read", actions.savePose)),
    make("p", { class: "note by-keys" }, "Keys on a slider: ← → change it, ↑ ↓ go to the next one."),
    this.sliderPlace);
  }

  /** Shows the motions of a person, the chosen one of them, and the sliders. */
  showPerson(motions, chosen, person, state) {
    this.showMotions(motions, chosen);
    this.sliders = gsh.controls.poseSliders(person, this.actions.changeNumber);
    this.sliderPlace.replaceChildren(this.sliders.element);
    this.sliders.show(state);
  }
  /** Whether the server answers; without it, controls rest that need it, and motions that are not loaded. */
  showServer(answers) {
    for (const control of this.needServer) control.disabled = !answers;
    for (const [m, option] of [...this.motions?.options || []].entries())
      option.disabled = !answers && !this.listed[m].loaded;
  }
  showMotions(motions, chosen) {
    this.listed = motions;
    const option = ({ name }, m) => gsh.controls.make("option", { value: String(m) }, name);
    this.motions.replaceChildren(...motions.map(option));
    this.motions.value = String(chosen);
  }

  /** Moves the sliders to a pose: at once, or while a motion plays a few times a second, for there are many. */
  showPose(state, playing) {
    if (!this.sliders || this.timer) return;
    this.timer = setTimeout(() => {
      this.timer = 0;
      this.sliders.show(state());
    }, playing ? 500 : 0);
  }

  showEngine({ name, note }) {
    document.getElementById("engine").textContent = `${name} engine`;
    if (this.engines) this.engines.value = name;
    this.note.textContent = note;
    this.note.hidden = !note;
  }
};
