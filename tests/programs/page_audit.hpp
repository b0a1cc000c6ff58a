// SPDX-License-Identifier: Apache-2.0
/// @file  Checks of pages in a browser that WCAG 2.2 AA asks for: contrast, names, tab stops, sizes, reflow.
#pragma once

namespace gsh::test {

/// Adds `audit`: functions that return what is wrong, as a list of texts. It begins after page_gestures.
inline constexpr const char* page_audit = R"js(
const audit = (() => {
  const controls = 'button, select, input:not([type="file"]), textarea, summary, a[href], [tabindex]';
  const isShown = (one) => one.checkVisibility({ visibilityProperty: true }) && !one.closest("[inert]");
  const called = (one) => `${one.tagName.toLowerCase()}${one.id && "#" + one.id} "${nameOf(one).slice(0, 30)}"`;
  const scope = () => document.querySelector("dialog[open]") || document.body; // an open dialog is all there is
  const all = (selector) => [...scope().querySelectorAll(selector)].filter(isShown);

  // Colours as [r, g, b, a], 0 to 255 and 0 to 1.
  const probe = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const numbers = (text) => {
    probe.clearRect(0, 0, 1, 1);
    probe.fillStyle = "#000", probe.fillStyle = text;
    probe.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = probe.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = ([r, g, b, a], under) => [r, g, b].map((x, k) => x * a + under[k] * (1 - a)).concat(1);
  const luminance = (c) => c.slice(0, 3).map((x) => x / 255)
    .map((x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4))
    .reduce((sum, x, k) => sum + x * [0.2126, 0.7152, 0.0722][k], 0);
  const contrast = (a, b) => {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
  };
  /** The colours that may be behind an element: over the picture, where any colour may be, black and white. */
  function behind(one) {
    if (!one) return [[255, 255, 255, 1]];
    if (one.id === "stage") return [[0, 0, 0, 1], [255, 255, 255, 1]];
    const own = numbers(getComputedStyle(one).backgroundColor);
    if (own[3] === 1) return [own];
    const parent = one.tagName === "DIALOG" ? null : one.parentElement;
    return behind(parent).map((under) => over(own, under));
  }
  const worst = (color, one) => Math.min(...behind(one).map((under) => contrast(over(color, under), under)));
  const isResting = (one) => one.matches(":disabled") || !!one.closest("fieldset:disabled");

  /** Texts have 4.5 : 1. */
  function texts() {
    const wrong = [], walker = document.createTreeWalker(scope(), NodeFilter.SHOW_TEXT);
    let count = 0;
    while (walker.nextNode()) {
      const node = walker.currentNode, one = node.parentElement;
      if (!node.data.trim() || /^(SCRIPT|STYLE|OPTION)$/.test(one.tagName) || !isShown(one) || isResting(one)) continue;
      ++count;
      const found = worst(numbers(getComputedStyle(one).color), one);
      if (found < 4.5) wrong.push(`text "${node.data.trim().slice(0, 30)}" has ${found.toFixed(2)} : 1`);
    }
    for (const one of all("select, input[type=text], input[type=number]")) {
      const found = worst(numbers(getComputedStyle(one).color), one);
      if (!isResting(one) && found < 4.5) wrong.push(`${called(one)} has ${found.toFixed(2)} : 1`);
    }
    return count < 5 ? [`only ${count} texts were found`] : wrong;
  }

  /** The style sheet's value of a property of the rule whose selector ends with `ending`. */
  const ruleOf = (ending, property) => [...document.styleSheets].flatMap((sheet) => [...sheet.cssRules])
    .find((rule) => rule.selectorText?.endsWith(ending))?.style.getPropertyValue(property);
  /** The colours of a value, with the variables of an element. */
  const coloursIn = (value, one) => value.replace(/var\((--[\w-]+)(,[^)]*)?\)/g,
    (_, name) => getComputedStyle(one).getPropertyValue(name) || "0").match(/#[0-9a-f]{3,8}|rgba?\([^)]*\)/gi) || [];

  /** What shows a control has 3 : 1: an edge or a ground of its own, and both parts of a slider's track. */
  function edges() {
    const wrong = [];
    for (const one of all("button, select, input")) {
      if (isResting(one)) continue;
      const outside = one.parentElement, style = getComputedStyle(one);
      const add = (what, found) => found < 3 && wrong.push(`${what} of ${called(one)} has ${found.toFixed(2)} : 1`);
      if (one.type === "range") {
        const colours = coloursIn(ruleOf("::-webkit-slider-runnable-track", "background"), one);
        if (colours.length < 2) wrong.push("the tracks have no colours");
        for (const colour of colours) add("track", worst(numbers(colour), outside));
        add("thumb", worst(numbers(coloursIn(ruleOf("::-webkit-slider-thumb", "background"), one)[0]), outside));
        continue;
      }
      const edge = parseFloat(style.borderBottomWidth) > 0 ? worst(numbers(style.borderBottomColor), outside) : 0;
      const ground = worst(numbers(style.backgroundColor), outside);
      const sign = one.matches("button") && !one.textContent ? worst(numbers(style.color), outside) : 0; // a sign alone
      add("edge", Math.max(edge, ground, sign));
    }
    return wrong;
  }

  function nameOf(one) {
    const label = one.getAttribute("aria-label");
    if (label) return label;
    const by = one.getAttribute("aria-labelledby");
    if (by) return by.split(" ").map((id) => document.getElementById(id)?.textContent || "").join(" ").trim();
    if (one.labels?.length) return [...one.labels].map((each) => each.textContent).join(" ").trim();
    return (/^(SELECT|INPUT)$/.test(one.tagName) ? "" : one.textContent.trim()) || one.title;
  }
  /** Controls have names, which contain what they show, and each id is there once. */
  function names() {
    const wrong = [];
    for (const one of all(controls)) {
      const name = nameOf(one), words = one.matches("button") ? one.textContent.trim() : "";
      if (!name) wrong.push(`${one.outerHTML.slice(0, 80)} has no name`);
      if (/\w/.test(words) && !name.includes(words)) wrong.push(`"${name}" does not contain "${words}"`);
      if (one.tagName === "DIV" && !one.getAttribute("role")) wrong.push(`${called(one)} has no role`);
    }
    const ids = [...document.querySelectorAll("[id]")].map((one) => one.id);
    ids.filter((id, k) => ids.indexOf(id) !== k).forEach((id) => wrong.push(`two elements are called ${id}`));
    for (const one of document.querySelectorAll("[aria-controls], [aria-describedby]"))
      for (const attribute of ["aria-controls", "aria-describedby"])
        if (one.hasAttribute(attribute) && !document.getElementById(one.getAttribute(attribute)))
          wrong.push(`${attribute} of ${called(one)} leads nowhere`);
    if (!document.documentElement.lang) wrong.push("the page states no language");
    return wrong;
  }

  /** What the Tab key reaches, in its order. */
  const stops = () => all(controls).filter((one) => one.tabIndex >= 0 && !isResting(one));
  /** Each stop can be focused, is then seen, has a visible ring, and the order is that of the document. */
  function focus() {
    const wrong = stops().filter((one) => one.tabIndex > 0).map((one) => `${called(one)} jumps the order`);
    for (const one of stops()) {
      if (!isShown(one)) continue;
      one.focus({ focusVisible: true });
      if (document.activeElement !== one) wrong.push(`${called(one)} takes no focus`);
      const style = getComputedStyle(one), after = getComputedStyle(one, "::after");
      const ring = style.outlineStyle !== "none" ? style.outlineColor
        : after.content !== "none" && parseFloat(after.borderTopWidth) >= 2 ? after.borderTopColor : null;
      const ground = one.id === "pictures" ? [16, 21, 29, 1] : behind(one.parentElement)[0]; // a dark line beside it
      if (!ring || contrast(numbers(ring), ground) < 3) wrong.push(`${called(one)} has no ring that is seen`);
      one.scrollIntoView({ block: "nearest" });
      const { left, top, width, height } = one.getBoundingClientRect();
      const there = document.elementFromPoint(left + width / 2, top + height / 2);
      if (!there || !(one.contains(there) || there.contains(one) || there.matches("#loading *, #message *, canvas")))
        wrong.push(`${called(one)} is hidden by ${there?.outerHTML.slice(0, 60)}`);
    }
    document.activeElement.blur();
    return wrong;
  }

  /** Targets have 24 pixels at least; a check box has its label, too. */
  function sizes() {
    const wrong = [];
    for (const one of all(controls)) {
      const target = one.type === "checkbox" || one.type === "color" ? one.closest("label") || one : one;
      const { width, height } = target.getBoundingClientRect();
      if (width < 23.99 || height < 23.99) wrong.push(`${called(one)} is ${width.toFixed(1)} x ${height.toFixed(1)}`);
    }
    return wrong;
  }

  /** Nothing needs scrolling from side to side. */
  function reflow() {
    const wrong = [], wide = document.documentElement;
    for (const one of [wide, document.body, scope(), ...all("#panel, #transport, #stage")])
      if (one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).overflowX !== "hidden")
        wrong.push(`${one.tagName} ${one.id} is ${one.scrollWidth} wide, of ${one.clientWidth}`);
    for (const one of all(controls + ", p, h1, h2, h3")) {
      const { left, right } = one.getBoundingClientRect();
      if (left < -0.5 || right > innerWidth + 0.5) wrong.push(`${called(one)} is at ${left} to ${right}`);
    }
    return wrong;
  }

  /** Checks everything; `where` is put before what is checked. */
  async function everything(where, most) {
    const parts = { texts, edges, names, sizes, focus, reflow };
    for (const [what, find] of Object.entries(parts)) {
      const wrong = find();
      await check(`${where}: ${what}${wrong.length ? ": " + wrong.slice(0, 5).join("; ") : ""}`, !wrong.length);
    }
    const count = stops().length;
    await check(`${where}: ${count} tab stops, at most ${most}`, count > 0 && count <= most);
  }

  return { everything, texts, edges, names, sizes, focus, reflow, stops, contrast, numbers };
})();
)js";

} // namespace gsh::test
