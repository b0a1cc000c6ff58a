// SPDX-License-Identifier: Apache-2.0
// Puts the page together: scene, engine, camera, motions, panel.
"use strict";

gsh.view = (() => {
  const element = (id) => document.getElementById(id);
  const page = { person: 0, states: [], occlusion: [], motions: [], chosen: [], inputFps: 0, show: "splats",
                 shadows: true, skeleton: false, follow: false, lightTurn: 0,
                 background: [0x23 / 255, 0x27 / 255, 0x2e / 255], resolution: 540, fixedSize: null, pictures: 0 };
  let scene, source, camera, player, engine, panel;

  const { say, stand, stage: showStage } = gsh.notices;

  /** The work with errors shown on the page. */
  const guarded = (work) => async (...inputs) => {
    try {
      return await work(...inputs);
    } catch (error) {
      if (error instanceof gsh.source.Gone) lose(error);
      else say(error.message);
    }
  };

  // ---- whether the page can be used ----

  let begun = false, lost = false; // the engine has shown a picture; the server does not answer
  let focused = null; // what had the focus when the controls began to rest
  /** Controls rest while there is no picture that they could change. */
  function showUse() {
    const rests = !canBeUsed();
    if (rests) focused = focused || document.activeElement;
    for (const id of ["transport-controls", "sections"]) element(id).disabled = rests;
    if (!rests && document.activeElement === document.body) focused?.focus();
    if (!rests) focused = null;
    element("connection").hidden = !lost;
    panel?.showServer(!lost);
  }
  const canBeUsed = () => begun && !isWaiting();
  /** The first picture is there, or an error in its place. */
  function begin() {
    if (begun) return;
    begun = true;
    gsh.notices.loaded();
    showUse();
  }

  /** The server does not answer: says so and asks it until it does. */
  async function lose(error) {
    if (lost) return;
    lost = true, source.giveUp();
    showUse();
    while (error) {
      if (error.isAnother)
        return stand("gsh-view was started anew, so the address of this page is no longer valid. Open the address " +
          "that gsh-view prints.");
      const rest = engine?.name === "client" ? "This browser draws on; files and other motions have to wait. " : "";
      stand(`gsh-view has stopped, or cannot be reached. ${rest}This page goes on by itself when it answers again.`);
      await new Promise((done) => setTimeout(done, 1500));
      error = await source.probe().then(() => null, (again) => again);
    }
    if (!engine) return location.reload(); // it was lost while it loaded
    lost = false, stand("");
    showUse();
    say("gsh-view answers again", "good");
    change();
  }
  /** Asks the server now and then whether it is still there, also while nothing is drawn. */
  function watchServer() {
    if (!source.canDraw) return;
    setInterval(() => {
      if (document.hidden || lost || !begun || performance.now() - source.answered < 3000) return;
      source.probe().catch((error) => error instanceof gsh.source.Gone && lose(error));
    }, 2000);
  }

  // ---- pictures ----

  let dirty = false, open = 0, ready = false, awake = false, lastStep = 0, saving = 0; // open: requests without answer
  let transportShown = 0; // milliseconds
  const waiting = [], shownTimes = []; // resolvers of nextPicture(); times of the last pictures, milliseconds
  const change = () => { dirty = true, wake(); };
  /** Whether another request may be sent. In a motion, the next one waits at the server and keeps it busy. */
  const hasRoom = () => open < (player.playing && engine ? engine.requests : 1);
  const isWaiting = () => lost && engine.name === "server";

  function pictureSize() {
    if (page.fixedSize) return page.fixedSize;
    const stage = element("stage"), w = Math.max(stage.clientWidth, 16), h = Math.max(stage.clientHeight, 16);
    const ratio = globalThis.devicePixelRatio || 1;
    const scale = Math.min(page.resolution / Math.min(w, h), ratio, 4096 / Math.max(w, h));
    return [w, h].map((x) => Math.max(16, Math.round(x * scale)));
  }
  /** How far the chosen person has gone since the first frame, if the camera follows. */
  function shift() {
    return page.follow ? gsh.math.subtract(state().transl, player.motions[page.person].frame(0).transl) : [0, 0, 0];
  }
  function request() {
    return { camera: camera.view(...pictureSize(), shift()), background: page.background, show: page.show,
             shadows: page.shadows, light_turn: page.lightTurn, people: page.states.map(copyState),
             occlusion: page.occlusion.some((one) => one) ? page.occlusion.slice() : undefined };
  }

  /** Draws if there is something new and a request may be sent. Earlier pictures may still be decoded. */
  async function drawIfNeeded() {
    if (!dirty || !hasRoom() || !ready || saving || isWaiting()) return;
    dirty = false, ++open;
    const wanted = request(), askers = waiting.splice(0), drawer = engine;
    let free = false;
    const goOn = () => {
      if (drawer !== engine) return;
      free = true, --open;
      step(); // at once: the next request need not wait for the screen
    };
    try {
      const shown = await drawer.draw(wanted, goOn); // else a later picture was faster
      if (shown && drawer === engine) {
        engine.canvas.hidden = false;
        showSkeletons(wanted);
        shownTimes.push(performance.now());
        ++page.pictures;
      }
    } catch (error) {
      if (error instanceof gsh.source.Gone) dirty = true, lose(error);
      else if (drawer === engine) say(error.message), pause();
    }
    if (drawer !== engine) { // another engine was chosen meanwhile; it draws for them
      waiting.push(...askers);
      return change();
    }
    if (!free) --open;
    if (isWaiting()) return waiting.push(...askers);
    begin();
    for (const done of askers) done();
    showRate(), wake();
  }

  function showSkeletons({ people, camera: shown }) {
    const canvas = element("overlay");
    canvas.hidden = !page.skeleton;
    if (page.skeleton) gsh.overlay.draw(canvas, scene.people, people, shown);
  }

  /** Goes on with the motion, and draws. */
  function step() {
    if (!hasRoom() || saving || document.hidden || isWaiting()) return;
    const now = performance.now();
    if (player.advance(Math.min((now - lastStep) / 1000, 0.25))) takeFrame();
    lastStep = now;
    drawIfNeeded();
  }
  /** Makes a step when the screen is next drawn, if there is anything to do then. */
  function wake() {
    if (awake || !hasRoom() || saving || !ready || !(dirty || player.playing) || isWaiting()) return;
    awake = true;
    requestAnimationFrame(() => {
      awake = false;
      step(), wake();
    });
  }
  function play() {
    player.playing = true, lastStep = performance.now();
    showTransport(), wake();
  }

  /** The picture of this moment as a PNG. Until it is there nothing else is drawn, and a motion stands still. */
  async function picture() {
    ++saving;
    try {
      return await engine.picture(request());
    } finally {
      --saving, lastStep = performance.now();
      wake();
    }
  }

  let rateTimer = 0;
  function showRate() { // twice a second, and once more when nothing moves
    if (rateTimer) return;
    rateTimer = setTimeout(() => {
      rateTimer = 0;
      while (shownTimes.length && shownTimes[0] < performance.now() - 1000) shownTimes.shift();
      element("rate").textContent = shownTimes.length > 1 ? `${shownTimes.length} fps` : "";
      if (shownTimes.length) showRate();
    }, 500);
  }

  // ---- engines ----

  async function useEngine(name) {
    ready = begun = false;
    showUse();
    const canvas = document.createElement("canvas");
    canvas.hidden = true; // until it shows something
    const next = new (name === "client" ? gsh.ClientEngine : gsh.ServerEngine)(source, canvas);
    try {
      await next.start(scene, showStage);
    } catch (error) {
      next.stop();
      const isGone = error instanceof gsh.source.Gone;
      if (engine) ready = true, begin(), panel.showEngine(engine);
      if (name !== "client" || !source.canDraw || isGone) throw error;
      say(`${error.message}; the server draws instead`, "info");
      return engine || useEngine("server");
    }
    if (engine) engine.stop();
    engine = next, open = 0;
    engine.onOrder = change;
    engine.onLost = guarded(async () => {
      say("the graphics card was lost");
      await useEngine(source.canDraw ? "server" : "client");
    });
    element("pictures").replaceChildren(canvas);
    panel.showEngine(engine);
    showStage("Drawing the first picture");
    ready = true;
    change();
  }

  /** The engine of the address, or the browser itself if it has a real graphics card. */
  function firstEngine() {
    const asked = new URLSearchParams(location.search).get("engine");
    if (!source.canDraw) return "client";
    if (asked === "server" || asked === "client") return asked;
    return gsh.ClientEngine.isFast() ? "client" : "server";
  }

  // ---- poses and motions ----

  const copyState = ({ pose, betas, expression, transl }) =>
    ({ pose: pose.slice(), betas: betas.slice(), expression: expression.slice(), transl: transl.slice() });
  const person = () => scene.people[page.person], state = () => page.states[page.person];

  const edited = new Set(); // the people whose poses sliders changed since the last frame
  const isUnedited = (p) => !edited.has(p);

  /** Shows the motions' poses of this moment, of all people or of some. */
  function takeFrame(isMeant = () => true) {
    page.states.forEach((one, p) => {
      if (!isMeant(p)) return;
      edited.delete(p);
      const { pose, transl, expression, occlusion } = player.state(p);
      one.pose = pose, one.transl = transl, page.occlusion[p] = occlusion || null;
      if (expression) one.expression = one.expression.map((_, k) => expression[k] || 0);
    });
    change(), showPose();
    const now = performance.now();
    if (player.playing && now < transportShown + 100) return; // repainting costs more than a picture
    transportShown = now;
    showTransport();
  }
  function takeBetas(p) {
    const { betas } = player.motions[p];
    page.states[p].betas = scene.people[p].betas.map((beta, k) => betas.length ? betas[k] || 0 : beta);
  }
  /** Shows motion `index` of a person from its beginning. Poses that sliders gave other people stay. */
  function useMotion(p, index) {
    page.chosen[p] = index;
    player.set(p, page.motions[p][index].loaded);
    restart(p);
  }
  /** The person as the motion has them, also in shape and expression. */
  function restart(p) {
    page.states[p].expression.fill(0), edited.delete(p);
    takeBetas(p), takeFrame(isUnedited);
  }
  function pause() {
    player.playing = false;
    showTransport();
  }
  function changePose(edit) {
    pause(), edited.add(page.person), edit(state());
    page.occlusion[page.person] = null; // only the frames of motions have it
    showPose(), change();
  }

  const openFile = guarded(async (file) => {
    const p = page.person, list = page.motions[p];
    const motion = await source.read(file, p, page.inputFps, scene, list[0].loaded, engine?.people?.[p].body);
    const { name, warnings } = motion, again = list.filter((one) => one.file === name).length;
    list.push({ name: again ? `${name} (${again + 1})` : name, file: name, loaded: motion });
    if (p === page.person) panel.showMotions(list, list.length - 1);
    useMotion(p, list.length - 1);
    const opened = `${name}: ${motion.frames} frame${motion.frames > 1 ? "s" : ""}`;
    const notes = warnings.map((text) => text.startsWith(`${name}: `) ? text.slice(name.length + 2) : text);
    say([opened, ...notes].join("; "), notes.length ? "info" : "good");
    if (player.frames > 1) play();
  });

  const poseFile = () => gsh.poseFile.write(person(), state());
  /** A name for what is saved now: of the avatar, the motion and its frame. */
  function savedName(ending) {
    const parts = [scene.names.map((name) => name.replace(/\.[^.]*$/, "")).join("-")];
    if (scene.people.length) {
      parts.push(player.motions[page.person].name.replace(/\.[^.]*$/, ""));
      if (player.frames > 1) parts.push(String(player.frame + 1));
    }
    return parts.join("-").replace(/[^\p{L}\p{N}]+/gu, "-") + ending;
  }
  function save(what, blob, name) {
    const url = URL.createObjectURL(blob), link = gsh.controls.make("a", { href: url, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
    say(`The ${what} is saved as ${name}, where the browser keeps downloads`, "good");
  }

  const actions = {
    change, openFile,
    useMotion: guarded(async (index) => {
      const p = page.person, entry = page.motions[p][index];
      entry.loaded = entry.loaded || await source.motion(p, index);
      useMotion(p, index);
    }),
    useEngine: guarded(useEngine),
    choosePerson: (p) => {
      page.person = p;
      panel.showPerson(page.motions[p], page.chosen[p], person(), state());
    },
    resetView: () => { camera.reset(stageAspect()), change(); },
    // in steps: of 7.5 degrees, of a twentieth of the picture's height
    turn: (right, down) => { camera.turn(right * Math.PI / 24, down * Math.PI / 24), change(); },
    move: (right, down) => { camera.pan(right * 0.05, down * 0.05), change(); },
    zoom: (steps) => { camera.zoom(1.12 ** -steps), change(); },
    turnUpsideDown: (on) => { camera.up = on ? -1 : 1, change(); },
    savePicture: guarded(async () => {
      const name = savedName(".png"); // of the moment when it was asked for
      save("picture", await picture(), name);
    }),
    changeNumber: (kind, index, value) => {
      if (player.playing) pause();
      edited.add(page.person);
      state()[kind][index] = value;
      if (kind === "pose") page.occlusion[page.person] = null;
      change();
    },
    resetPose: () => { pause(), restart(page.person); },
    restPose: () => changePose((s) => { s.pose.fill(0), s.expression.fill(0), s.betas = person().betas.slice(); }),
    mirror: () => changePose((s) => {
      s.pose = gsh.joints.mirrored(s.pose, gsh.joints.names(person().joint_names, person().parents.length));
    }),
    savePose: () => save("pose", poseFile(), savedName(".npz")),
  };

  // ---- what the page shows ----

  function showTransport() {
    const { frames, frame, playing } = player, scrub = element("scrub"), play = element("play");
    scrub.max = frames - 1, scrub.value = frame, scrub.disabled = play.disabled = frames < 2;
    scrub.setAttribute("aria-valuetext", `${frame + 1} of ${frames}`);
    gsh.controls.showShare(scrub, 0, frame);
    play.classList.toggle("playing", playing);
    play.setAttribute("aria-label", playing ? "pause" : "play");
    element("time").textContent = frames > 1 ? `${player.time.toFixed(2)} s  ·  ${frame + 1}/${frames}` : "one pose";
  }
  const showPose = () => panel?.showPose(state, player.playing);
  const stageAspect = () => element("stage").clientWidth / Math.max(element("stage").clientHeight, 1);

  function listen() {
    camera.listen(element("pictures"), () => {
      gsh.notices.hintUsed();
      change();
    });
    new ResizeObserver(change).observe(element("stage"));
    element("play").addEventListener("click", () => {
      if (player.playing) return pause();
      if (!player.loop && player.frame === player.frames - 1) player.time = 0;
      play();
    });
    const goTo = (frame) => {
      player.playing = false;
      player.goTo(frame);
      takeFrame();
    };
    element("scrub").addEventListener("input", () => goTo(Number(element("scrub").value)));
    element("speed").addEventListener("change", () => (player.speed = Number(element("speed").value)));
    element("loop").addEventListener("click", () => {
      player.loop = !player.loop;
      element("loop").setAttribute("aria-pressed", String(player.loop));
    });
    const { turn, move, zoom, resetView } = actions;
    const playing = { play: () => element("play").click(), step: (frames) => goTo(player.frame + frames) };
    gsh.keys.listen(element("pictures"), { turn, move, zoom, reset: resetView }, scene.people.length ? playing : null,
      canBeUsed);
    listenToDrops();
  }

  function listenToDrops() {
    let inside = 0;
    const show = (on) => (element("drop").hidden = !on || !scene.people.length);
    document.addEventListener("dragenter", (event) => {
      if (event.dataTransfer && [...event.dataTransfer.types].includes("Files")) ++inside, show(true);
    });
    document.addEventListener("dragleave", () => {
      inside = Math.max(inside - 1, 0);
      if (!inside) show(false);
    });
    document.addEventListener("dragover", (event) => event.preventDefault()); // else the browser leaves the page
    document.addEventListener("drop", (event) => {
      event.preventDefault();
      inside = 0, show(false);
      const { files, items } = event.dataTransfer;
      if (!files[0]) return;
      if (items[0].webkitGetAsEntry()?.isDirectory)
        return say(`${files[0].name}: is a folder; drop a file, or let gsh-motion make an .npz of the folder`);
      if (!scene.people.length) return say(`${files[0].name}: this scene has no people to move`);
      if (canBeUsed() && !lost) openFile(files[0]);
    });
  }

  async function start() {
    gsh.notices.listen();
    source = gsh.source.open();
    showStage("Loading the scene");
    scene = await source.scene();
    const { people } = scene;
    page.resolution = scene.size;
    page.motions = people.map((p) => p.motions.map(({ name }) => ({ name })));
    page.chosen = people.map(() => 0);
    camera = new gsh.OrbitCamera(scene);
    camera.up = scene.y_down ? -1 : 1;
    camera.reset(stageAspect());
    for (const [p, list] of page.motions.entries()) {
      const loading = `Loading the motion ${list[0].name}`;
      showStage(loading);
      list[0].loaded = await source.motion(p, 0, (share, words) => showStage(loading, share, words));
    }
    const still = { frames: 1, seconds: [0], betas: [], frame: () => ({}) }; // of a scene without people
    player = new gsh.Player(people.length ? page.motions.map((list) => list[0].loaded) : [still]);
    const zeros = (count) => new Array(count).fill(0);
    page.states = people.map((p) => ({ pose: [], betas: [], expression: zeros(p.expressions), transl: [] }));
    page.states.forEach((_, p) => takeBetas(p));
    element("transport").hidden = !people.length;
    takeFrame();
    panel = new gsh.Panel(scene, page, source.canDraw, actions);
    if (people.length) panel.showPerson(page.motions[0], 0, person(), state());
    listen();
    document.addEventListener("visibilitychange", wake);
    const first = nextPicture();
    await useEngine(firstEngine());
    await first;
    watchServer();
    if (player.frames > 1 && !matchMedia("(prefers-reduced-motion: reduce)").matches) play();
    else showTransport();
  }
  /** Resolves when the next picture is shown. */
  const nextPicture = () => new Promise((done) => { waiting.push(done), change(); });

  const started = guarded(start)().then(() => begun || gsh.notices.loaded());
  return {
    started, page, request, copyState, poseFile, pause, openFile, useEngine, picture, nextPicture,
    /** Pictures of [width, height] pixels from now on, whatever the size of the window. */
    setSize: (size) => { page.fixedSize = size, change(); },
    get engine() { return engine; }, get camera() { return camera; }, get player() { return player; },
  };
})();
