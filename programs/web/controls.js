// SPDX-License-Identifier: Apache-2.0
// The page's controls: small builders, and the sliders of a pose.
"use strict";

gsh.controls = (() => {
  /** An element with attributes and children; attributes that begin with "on" are listeners. */
  function make(tag, attributes = {}, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (value === true) element.setAttribute(name, "");
      else if (value !== false && value !== null) element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  }

  const button = (text, title, action) => make("button", { type: "button", title, onclick: action }, text);

  function choice(label, options, chosen, changed) {
    const select = make("select", { "aria-label": label, onchange: () => changed(select.value) },
      ...options.map(([value, text]) => make("option", { value, selected: value === chosen }, text)));
    return { row: make("label", { class: "row" }, make("span", {}, label), select), select };
  }

  function toggle(label, on, changed) {
    const input = make("input", { type: "checkbox", checked: on, onchange: () => changed(input.checked) });
    return { row: make("label", { class: "toggle" }, input, make("span", {}, label)), input };
  }

  /** Colours a slider's track from one of its values to another. */
  function showShare(track, from, to) {
    const share = (x) => `${100 * (x - track.min) / Math.max(track.max - track.min, 1e-9)}%`;
    track.style.setProperty("--from", share(Math.min(from, to)));
    track.style.setProperty("--to", share(Math.max(from, to)));
  }

  /** A slider with a name and a number that can be typed. */
  function slider({ label, title, name, least, most, step, digits, value, unit = "", changed }) {
    const show = (x) => x.toFixed(digits);
    const track = make("input", { type: "range", min: least, max: most, step, "aria-label": title || label,
                                  "data-name": name || null });
    const number = make("input", { type: "text", inputmode: "decimal", class: "number",
                                   "aria-label": `${title || label}, number` });
    let written = null;
    const set = (x) => {
      const digitsAndUnit = show(x) + unit;
      if (document.activeElement !== number && number.value !== digitsAndUnit) number.value = digitsAndUnit;
      if (x === written) return;
      track.value = written = x;
      track.setAttribute("aria-valuetext", digitsAndUnit);
      showShare(track, Math.min(Math.max(0, least), most), Number(track.value));
    };
    track.addEventListener("input", () => {
      set(Number(track.value));
      changed(Number(track.value));
    });
    number.addEventListener("change", () => {
      const x = parseFloat(number.value);
      if (Number.isFinite(x)) changed(Math.min(Math.max(x, least), most));
      number.blur();
      set(Number.isFinite(x) ? Math.min(Math.max(x, least), most) : Number(track.value));
    });
    number.addEventListener("keydown", (event) => event.key === "Enter" && number.blur());
    track.addEventListener("dblclick", () => (set(0), changed(0)));
    set(value);
    const text = make("span", { class: "label", title: title || label }, label);
    return { row: make("div", { class: "slider" }, text, track, number), parts: [track, number], set };
  }

  const degrees = 180 / Math.PI;

  /**
   * Sliders for every axis of every joint, grouped, and for expression and shape. changed(kind, index, value) is called
   * with kind "pose", "expression", "betas" or "transl". Returns {element, show(state)}; closed groups are not updated.
   * Tab reaches one slider of a group, and the arrow keys up and down lead to the others.
   */
  function poseSliders(person, changed) {
    const names = gsh.joints.names(person.joint_names, person.parents.length), groups = new Map();
    let shown = null;
    const groupOf = (title) => {
      if (!groups.has(title)) groups.set(title, { children: [], setters: [], rows: [] });
      return groups.get(title);
    };
    /** One slider of a group. `factor` leads from the number of the pose to that of the slider. */
    const add = (group, kind, index, factor, settings) => {
      const one = slider({ name: `${kind}-${index}`, value: 0, ...settings,
                           changed: (x) => changed(kind, index, x / factor) });
      group.setters.push((state) => one.set(state[kind][index] * factor));
      group.rows.push(one.parts);
      return one.row;
    };
    const axes = (group, kind, first, factor, title, settings) => ["x", "y", "z"].map((axis, k) => {
      const row = add(group, kind, first + k, factor, { label: axis, title: `${title} ${axis}`, ...settings });
      row.classList.add(axis);
      return row;
    });
    for (const title of ["body", "face", "left hand", "right hand"]) groupOf(title);
    names.forEach((name, j) => {
      const label = gsh.joints.label(name), group = groupOf(gsh.joints.group(name));
      group.children.push(make("div", { class: "joint" }, make("h3", {}, label), ...axes(group, "pose", 3 * j, degrees,
        label, { least: -180, most: 180, step: 0.5, digits: 0, unit: "°" })));
    });
    const numbers = (title, kind, count, most) => {
      const group = groupOf(title);
      for (let k = 0; k < count; ++k)
        group.children.push(add(group, kind, k, 1, { label: `${k + 1}`, title: `${title} ${k + 1}`, least: -most, most,
                                                     step: 0.01, digits: 2 }));
    };
    numbers("expression", "expression", person.expressions, 3);
    numbers("shape", "betas", person.betas.length, 4);
    const place = groupOf("place");
    place.children.push(make("div", { class: "joint" }, ...axes(place, "transl", 0, 1, "place",
      { least: -3, most: 3, step: 0.01, digits: 2, unit: " m" })));

    const element = make("div", { class: "groups" });
    for (const [title, group] of groups) {
      if (!group.children.length) continue;
      group.details = make("details", { open: title === "body", "data-group": title,
                                        ontoggle: () => shown && showGroup(group) },
        make("summary", {}, `${title} `, make("span", { class: "count" }, `${group.children.length}`)), ...group.children);
      gsh.keys.rove(group.details, group.rows, ["ArrowUp"], ["ArrowDown"]); // a group is one tab stop, not many
      element.append(group.details);
    }
    const showGroup = (group) => group.details?.open && group.setters.forEach((set) => set(shown));
    return { element, show: (state) => {
      shown = state;
      for (const group of groups.values()) showGroup(group);
    } };
  }

  return { make, button, choice, toggle, showShare, slider, poseSliders };
})();
