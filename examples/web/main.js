// SPDX-License-Identifier: Apache-2.0
// Puts the page together: scene, engine, camera, motions, panel.
"use strict";

gsh.view = (() => {
  const element = (id) => document.getElementById(id);
  const page = { person: 0, states: [], occlusion: [], motions: [], chosen: [], inputFps: 0, show: "splats",
                 shadows: true, skeleton: false, follow: false, lightTurn: 0, background: [0x23 / 255, 0x27 / 255, 0x2e / 255],
                 resolution: 540, fixedSize: null, pictures: 0 };
  let scene, source, camera, player, engine, panel;

  // ---- messages ----

  let messageTimer = 0;
  function say(text, good = false) {
    const box = element("message");
    box.textContent = text, box.className = good ? "good" : "", box.hidden = false;
    clearTimeout(messageTimer);
    messageTimer = setTimeout(() => (box.hidden = true), good ? 3500 : 9000);
  }
  /** The work with errors shown on the page. */
  const guarded = (work) => async (...inputs) => {
    try {
      return await work(...inputs);
    } catch (error) {
      say(error.message);
    }
  };

  // ---- pictures ----

  let dirty = false, open = 0, ready = false, awake = false, lastStep = 0, saving = 0; // open: requests without answer
  let transportShown = 0; // milliseconds
  const waiting = [], shownTimes = []; // resolvers of nextPicture(); times of the last pictures, milliseconds
  const change = () => { dirty = true, wake(); };
  /** Whether another request may be sent. In a motion, the next one waits at the server and keeps it busy. */
  const hasRoom = () => open < (player.playing && engine ? engine.requests : 1);

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
    if (!dirty || !hasRoom() || !ready || saving) return;
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
      if (drawer === engine) say(error.message), pause();
    }
    if (drawer !== engine) { // another engine was chosen meanwhile; it draws for them
      waiting.push(...askers);
      return change();
    }
    if (!free) --open;
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
    if (!hasRoom() || saving || document.hidden) return;
    const now = performance.now();
    if (player.advance(Math.min((now - lastStep) / 1000, 0.25))) takeFrame();
    lastStep = now;
    drawIfNeeded();
  }
  /** Makes a step when the screen is next drawn, if there is anything to do then. */
  function wake() {
    if (awake || !hasRoom() || saving || !ready || !(dirty || player.playing)) return;
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
    ready = false;
    const canvas = document.createElement("canvas");
    canvas.hidden = true; // until it shows something
    const next = new (name === "client" ? gsh.ClientEngine : gsh.ServerEngine)(source, canvas);
    try {
      await next.start(scene);
    } catch (error) {
      next.stop();
      ready = !!engine;
      if (name !== "client" || !source.canDraw) throw error;
      say(`${error.message}; the server draws instead`);
      return useEngine("server");
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
    list.push({ name: motion.name, loaded: motion });
    if (p === page.person) panel.showMotions(list, list.length - 1);
    useMotion(p, list.length - 1);
    if (motion.warnings.length) say(motion.warnings.join(" · "));
    else say(`${motion.name}: ${motion.frames} frame${motion.frames > 1 ? "s" : ""}`, true);
    if (player.frames > 1) play();
  });

  const poseFile = () => gsh.poseFile.write(person(), state());
  function save(blob, name) {
    const url = URL.createObjectURL(blob), link = gsh.controls.make("a", { href: url, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
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
    turnUpsideDown: (on) => { camera.up = on ? -1 : 1, change(); },
    savePicture: guarded(async () => save(await picture(), "picture.png")),
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
    savePose: () => save(poseFile(), "pose.npz"),
  };

  // ---- what the page shows ----

  function showTransport() {
    const { frames, frame, playing } = player, scrub = element("scrub"), play = element("play");
    scrub.max = frames - 1, scrub.value = frame, scrub.disabled = play.disabled = frames < 2;
    gsh.controls.showShare(scrub, 0, frame);
    play.classList.toggle("playing", playing);
    play.setAttribute("aria-label", playing ? "pause" : "play");
    element("time").textContent = frames > 1 ? `${player.time.toFixed(2)} s  ·  ${frame + 1}/${frames}` : "one pose";
  }
  const showPose = () => panel?.showPose(state, player.playing);
  const stageAspect = () => element("stage").clientWidth / Math.max(element("stage").clientHeight, 1);

  function listen() {
    camera.listen(element("stage"), () => {
      element("hint").classList.add("gone");
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
    document.addEventListener("keydown", (event) => {
      if (!scene.people.length || /^(INPUT|SELECT|BUTTON|SUMMARY)$/.test(event.target.tagName)) return;
      if (event.key === " ") event.preventDefault(), element("play").click();
      if (event.key === "ArrowRight") goTo(player.frame + 1);
      if (event.key === "ArrowLeft") goTo(player.frame - 1);
    });
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
        return say(`${files[0].name}: is a folder; drop a file, or give the folder to gsh-motion`);
      if (!scene.people.length) return say(`${files[0].name}: this scene has no people to move`);
      openFile(files[0]);
    });
  }

  async function start() {
    source = gsh.source.open();
    scene = await source.scene();
    const { people } = scene;
    page.resolution = scene.size;
    page.motions = people.map((p) => p.motions.map(({ name }) => ({ name })));
    page.chosen = people.map(() => 0);
    camera = new gsh.OrbitCamera(scene);
    camera.up = scene.y_down ? -1 : 1;
    camera.reset(stageAspect());
    await Promise.all(page.motions.map(async (list, p) => (list[0].loaded = await source.motion(p, 0))));
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
    await useEngine(firstEngine());
    document.addEventListener("visibilitychange", wake);
    if (player.frames > 1) play();
    else showTransport();
  }

  const started = start().catch((error) => say(error.message));
  return {
    started, page, request, copyState, poseFile, pause, openFile, useEngine, picture,
    /** Resolves when the next picture is shown. */
    nextPicture: () => new Promise((done) => { waiting.push(done), change(); }),
    /** Pictures of [width, height] pixels from now on, whatever the size of the window. */
    setSize: (size) => { page.fixedSize = size, change(); },
    get engine() { return engine; }, get camera() { return camera; }, get player() { return player; },
  };
})();
