// SPDX-License-Identifier: Apache-2.0
/// The page of gsh-view in headless Chromium: sliders, motions, dropped files, and the pictures of both engines.
#include "io/bvh_files.hpp"
#include "programs/page_audit.hpp"
#include "programs/page_driver.hpp"
#include "programs/view_scenes.hpp"
#include "support/skip.hpp"

#include "common/input_files.hpp"
#include "view/view_package.hpp"
#include "view/view_page.hpp"
#include "view/view_painter.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <nlohmann/json.hpp>

#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>
#include <string>
#include <thread>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

/// The actor: everything that the page does, then the pictures of both engines.
constexpr const char* drive_actor = R"js(
(async () => {
  const message = () => find("#message-text").textContent, kind = () => find("#message").className;
  const rests = () => find("#transport-controls").disabled && find("#sections").disabled;
  const stages = [find("#loading-stage").textContent];
  new MutationObserver((changes) => changes.forEach(({ addedNodes }) => stages.push(addedNodes[0].data)))
    .observe(find("#loading-stage"), { childList: true });
  await check("while it loads, the controls rest", rests() && !find("#loading").hidden);
  await view.started;
  await until(() => stages.length > 2);
  await check("it tells the stages: " + stages.join(), stages.join() ===
    "Loading the scene,Loading the motion stride.npz,Drawing the first picture");
  await check("after the first picture they do not", !rests() && find("#loading").hidden && view.page.pictures > 0);
  await check("without a graphics card the server draws", view.engine.name === "server");
  await check("a motion plays at once", view.player.playing);
  const before = view.page.pictures;
  await check("pictures follow each other", await until(() => view.page.pictures > before + 2));
  const chip = () => find("#engine").textContent + ", " + find("#rate").textContent;
  await check("the corner names the engine and counts", await until(() => /^server engine, \d+ fps$/.test(chip())));
  view.setSize([256, 256]);
  find("#play").click();
  await check("it pauses", !view.player.playing);
  const scrub = find("#scrub");
  await check("the scrubber has all frames", scrub.max === "3");
  await drag(scrub, 2);
  await shoot("server-frame");
  const elbow = find('input[data-name="pose-56"]');
  await drag(elbow, 70);
  await check("the slider turns the joint", Math.abs(view.page.states[0].pose[56] - 70 * Math.PI / 180) < 1e-9);
  await drag(find('input[data-name="expression-1"]'), 1.5);
  await drag(find('input[data-name="betas-0"]'), -1);
  await shoot("server-sliders");
  const pose = view.copyState(view.page.states[0]);
  const file = view.poseFile();
  await send("npz", file);
  press("Mirror");
  await shoot("server-mirrored");
  press("Mirror");
  await check("mirrored twice is the pose itself", view.page.states[0].pose.every((x, k) => x === pose.pose[k]));
  press("Rest pose");
  await check("the canonical pose is all zeros", view.page.states[0].pose.every((x) => x === 0));
  press("Reset");
  await check("reset is the frame", view.page.states[0].pose.some((x) => x !== 0));
  const transfer = new DataTransfer();
  transfer.items.add(new File([file], "my pose.npz"));
  document.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  await check("the dropped file is a motion", await until(() => view.player.leader.name === "my pose.npz"));
  await view.nextPicture();
  await check("it has the saved pose", view.page.states[0].pose.every((x, k) => Math.abs(x - pose.pose[k]) < 1e-6));
  await check("and its expression", Math.abs(view.page.states[0].expression[1] - 1.5) < 1e-6);
  await check("and its shape", Math.abs(view.page.states[0].betas[0] + 1) < 1e-6);
  await view.openFile(new File(["nonsense"], "bad.npz"));
  await check("another file is refused in words", /^bad\.npz: .*\.bvh/.test(message()) && kind() === "error");
  await view.openFile(new File([STRANGE], "strange.bvh"));
  await check("the words are for the page: " + message(), /gsh-motion/.test(message()) && !/--/.test(message()));
  const walk = new DataTransfer();
  walk.items.add(new File([WALK], "walk.bvh"));
  document.dispatchEvent(new DragEvent("drop", { dataTransfer: walk, bubbles: true, cancelable: true }));
  await check("a dropped BVH becomes a motion", await until(() => view.player.leader.name === "walk.bvh"));
  await check("the page says what was guessed", /centimetres/.test(message()) && kind() === "info");
  view.pause();
  await drag(scrub, 2);
  await check("it changes the pose", view.page.states[0].pose.some((x, k) => Math.abs(x - pose.pose[k]) > 0.1));
  await send("walked", JSON.stringify(view.page.states[0]));
  await shoot("server-walk");
  const stage = find("#pictures"), yaw = view.camera.yaw;
  const at = (type, x, y) => stage.dispatchEvent(new PointerEvent(type,
    { pointerId: 1, clientX: x, clientY: y, buttons: 1, bubbles: true }));
  stage.setPointerCapture = () => {};
  at("pointerdown", 300, 300), at("pointermove", 380, 320), at("pointerup", 380, 320);
  await check("dragging turns the camera", view.camera.yaw !== yaw);
  const target = view.camera.target.slice(), moved = () => view.camera.target.some((x, k) => x !== target[k]);
  const turned = view.camera.yaw, finger = (type, pointerId, clientX, clientY, more = {}) => stage.dispatchEvent(
    new PointerEvent(type, { pointerId, clientX, clientY, bubbles: true, ...more }));
  const shift = { shiftKey: true, buttons: 1 };
  finger("pointerdown", 1, 300, 300, shift), finger("pointermove", 1, 320, 290, shift), finger("pointerup", 1, 0, 0);
  await check("dragging with shift moves it", moved() && view.camera.yaw === turned);
  view.camera.target = target.slice();
  const spread = view.camera.distance;
  finger("pointerdown", 2, 300, 300), finger("pointerdown", 3, 400, 300), finger("pointermove", 3, 420, 300);
  await check("two fingers zoom and move it", Math.abs(view.camera.distance - spread / 1.2) < 1e-9 && moved());
  finger("pointerup", 2, 300, 300), finger("pointermove", 3, 440, 300), finger("pointerup", 3, 440, 300);
  await check("one finger turns it", view.camera.yaw !== turned);
  const distance = view.camera.distance;
  stage.dispatchEvent(new WheelEvent("wheel", { deltaY: -200, cancelable: true }));
  await check("the wheel zooms", view.camera.distance < distance);
  await shoot("server-near");
  const eye = () => view.request().camera.t[0], from = eye();
  view.page.follow = true;
  view.page.states[0].transl[0] += 0.5;
  await check("the camera follows the person", Math.abs(eye() - from) > 0.1);
  view.page.follow = false;
  view.page.states[0].transl[0] -= 0.5;
  await check("or stays where it is", Math.abs(eye() - from) < 1e-9);
  const groups = [...document.querySelectorAll("details")].map((group) => group.dataset.group).join();
  await check("sliders are in groups", groups === "body,face,left hand,right hand,expression,shape,place");
  await check("with three for each joint", document.querySelectorAll('input[data-name^="pose-"]').length === 165);
  const typed = find('input[aria-label="left elbow y, number"]');
  typed.value = "-30", typed.dispatchEvent(new Event("change"));
  await check("an angle can be typed", Math.abs(view.page.states[0].pose[55] + Math.PI / 6) < 1e-9);
  const bones = find("#overlay"), toggles = [...document.querySelectorAll(".toggle")];
  const skeleton = toggles.find((one) => one.textContent === "Skeleton");
  skeleton.querySelector("input").click();
  await view.nextPicture();
  const { data } = bones.getContext("2d").getImageData(0, 0, bones.width, bones.height);
  const drawn = data.filter((x, k) => k % 4 === 3 && x);
  await check("the skeleton is drawn over the picture", !bones.hidden && drawn.length > 200);
  skeleton.querySelector("input").click();
  await view.nextPicture();
  await check("and can be hidden", bones.hidden);
  choose(find("#speed"), "4");
  await check("the speed can be chosen", view.player.speed === 4);
  find("#loop").click(), find("#play").click();
  await check("without Loop a motion ends", await until(() => !view.player.playing));
  await check("at its last frame", view.player.frame === view.player.frames - 1);
  find("#loop").click(), choose(find("#speed"), "1");
  const press_key = (key) => document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  press_key("ArrowLeft");
  await check("an arrow key goes to the frame before", view.player.frame === view.player.frames - 2);
  const key_at = (one, key, more = {}) =>
    one.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true, ...more }));
  key_at(find("#play"), "ArrowLeft");
  await check("also where the button has the focus", view.player.frame === view.player.frames - 3);
  key_at(find("#speed"), "ArrowRight"), key_at(scrub, "ArrowRight");
  await check("but not where a control uses the key", view.player.frame === view.player.frames - 3);
  const placed = () => JSON.stringify([view.camera.yaw, view.camera.pitch, view.camera.target, view.camera.distance]);
  const places = [placed()], frame_before = view.player.frame;
  for (const [key, more] of [["ArrowLeft", {}], ["ArrowUp", {}], ["ArrowRight", { shiftKey: true }], ["+", {}]])
    key_at(stage, key, more), places.push(placed());
  await check("keys on the picture turn, move and zoom it", new Set(places).size === 5 &&
    view.player.frame === frame_before);
  const nearer = view.camera.distance;
  key_at(stage, "-");
  await check("minus is the way back", view.camera.distance > nearer);
  key_at(stage, "0");
  await check("and 0 the view from the front", view.camera.yaw === 0);
  press_label("turn right"), press_label("zoom in"), press_label("move up");
  await check("so do buttons", view.camera.yaw !== 0 && placed() !== places[0]);
  await view.nextPicture();
  finger("pointerdown", 4, 300, 300, { pointerType: "touch" }), finger("pointerup", 4, 300, 300);
  await check("a finger gets the hint for fingers", /finger/.test(find("#hint").textContent));
  finger("pointerdown", 4, 300, 300, { pointerType: "mouse" }), finger("pointerup", 4, 300, 300);
  await check("the mouse that for the mouse", /wheel/.test(find("#hint").textContent));
  const first_slider = find('input[data-name="pose-0"]'), number_of = (slider) => slider.nextElementSibling;
  first_slider.focus(), key_at(first_slider, "ArrowDown");
  await check("a slider's key goes to the next one", document.activeElement.dataset.name === "pose-1");
  key_at(document.activeElement, "ArrowUp");
  await check("and back", document.activeElement === first_slider && first_slider.tabIndex === 0 &&
    number_of(first_slider).tabIndex === 0 && find('input[data-name="pose-1"]').tabIndex === -1);
  await audit.everything("the page", 45);
  find("#panel-toggle").click();
  await check("the panel closes", find("#panel-toggle").getAttribute("aria-expanded") === "false" &&
    !find("#panel").checkVisibility() && find("#stage").clientWidth === innerWidth);
  await audit.everything("without the panel", 10);
  find("#panel-toggle").click();
  await check("and opens", find("#panel").checkVisibility());
  find("#help-open").click();
  await check("the help names the keys", /turn/.test(find("#help").textContent) && find("#help").open);
  await audit.everything("the help", 1);
  find("#help-close").click();
  const background = find('input[aria-label="background"]');
  background.value = "#ffffff", background.dispatchEvent(new Event("input"));
  await check("the background can be chosen", view.request().background.every((x) => x === 1));
  await shoot("server-white");
  const light = find('input[data-name="light"]');
  await drag(light, 80);
  await shoot("server-light");
  view.page.shadows = false;
  await shoot("server-shadowless");
  view.page.shadows = true;
  view.page.show = "ellipsoids";
  await shoot("server-ellipsoids");
  view.page.show = "splats";
  await drag(light, 0);

  await view.useEngine("client");
  await check("the client draws when it is chosen", view.engine.name === "client");
  await shoot("client-near");
  await drag(find('input[data-name="pose-57"]'), -50);
  await shoot("client-slider");
  await drag(light, 80);
  await shoot("client-light");
  view.page.shadows = false;
  await shoot("client-shadowless");
  view.page.shadows = true;
  view.page.show = "ellipsoids";
  await shoot("client-ellipsoids");
  view.page.show = "splats";

  await check("another engine tells its stages: " + stages.slice(3).join(), stages.slice(3).join() ===
    "Loading the Gaussians,Preparing the graphics card,Drawing the first picture");
  const saved = [], address = URL.createObjectURL;
  URL.createObjectURL = (blob) => (saved.push(blob), address(blob));
  const names = [];
  HTMLAnchorElement.prototype.click = function () { names.push(this.download); }; // no downloads
  find("#play").click();
  const shown = view.page.pictures;
  await check("the client plays", await until(() => view.player.playing && view.page.pictures > shown + 2));
  const wanted = view.request();
  press("Save PNG");
  await check("a picture is saved while a motion plays", await until(() => saved.length === 1));
  await send("request client-saved", JSON.stringify({ ...wanted, format: "png" }));
  await send("picture client-saved", saved[0]);
  const later = view.page.pictures;
  await check("and the motion goes on", await until(() => view.player.playing && view.page.pictures > later + 2));
  const confirms = (name) => kind() === "good" && message().includes(name);
  await check("it says under which name: " + message(), confirms(names[0]) && /^actor-.+-\d+\.png$/.test(names[0]));
  press("Save pose");
  await check("also for a pose: " + message(), confirms(names[1]) && /^actor-.+-\d+\.npz$/.test(names[1]));

  // The server stops, and is there again; then another one answers in its place.
  const ask = fetch, reaches = (answer) => (globalThis.fetch = (path, options) =>
    /^(report|http)/.test(path) ? ask(path, options) : answer(path, options));
  const gone = () => Promise.reject(new TypeError("Failed to fetch"));
  const stopped = () => /stopped/.test(message()) && kind() === "error" && !find("#connection").hidden;
  reaches(gone);
  await check("the client's page notices by itself that the server has stopped", await until(stopped));
  await check("it draws on", !rests() && find('select[aria-label="Engine"]').disabled);
  const without = view.page.pictures;
  await check("also while a motion plays", await until(() => view.page.pictures > without + 2));
  reaches(ask);
  await check("it notices that it is back", await until(() => /^gsh-view answers again/.test(message())));
  await check("and all controls are, too", !find('select[aria-label="Engine"]').disabled);
  await view.useEngine("server");
  await view.nextPicture();
  reaches(gone);
  await check("the server's page rests", await until(() => stopped() && rests()));
  press_key(" ");
  await new Promise((done) => setTimeout(done, 2500));
  await check("it stays so", stopped() && rests());
  reaches(ask);
  await check("until the server is back", await until(() => !rests() && find("#connection").hidden));
  const after = view.page.pictures;
  await check("then the motion goes on", await until(() => view.player.playing && view.page.pictures > after + 2));
  reaches(async () => new Response("key: is missing or wrong\n", { status: 403 }));
  await check("another server is told from it", await until(() => /address that gsh-view prints/.test(message())));
  await check("and the controls rest", rests());
  location.href = NEXT;
})();
)js";

/// Other scenes with both engines; NAME is the scene's.
constexpr const char* drive_other = R"js(
(async () => {
  await view.started;
  const asked = location.search.includes("engine=client") ? "client" : "server";
  await check("the address of " + NAME + " chooses the engine", view.engine.name === asked);
  await view.useEngine("server");
  view.pause();
  view.setSize([256, 256]);
  view.camera.turn(0.8, -0.2);
  await shoot(NAME + "-server");
  await view.useEngine("client");
  await check(NAME + " is drawn by the client", view.engine.name === "client");
  await shoot(NAME + "-client");
  const people = view.page.states.length;
  if (people > 1) {
    const posed = () => view.page.states[0].pose[4];
    await drag(find('input[data-name="pose-4"]'), 40);
    const turned = posed();
    choose(find('select[aria-label="Person"]'), "1");
    await view.openFile(new File([view.poseFile()], "one.npz"));
    view.pause();
    const motions = find('select[aria-label="Motion"]');
    await check("a motion of one person leaves the others as they are", motions.value === "1" && posed() === turned);
    await drag(find('input[data-name="pose-4"]'), 10);
    press("Reset");
    await check("so does Reset", posed() === turned && Math.abs(view.page.states[1].pose[4] - Math.PI / 18) > 1e-3);
    choose(find('select[aria-label="Person"]'), "0");
    await check("a person's own motion is the chosen one", motions.value === "0");
    choose(find('select[aria-label="Person"]'), "1");
    await check("also if it is another one", motions.value === "1");
    const quick = { frames: 3, seconds: [0, 0.1, 0.2] }, slow = { frames: 2, seconds: [0, 1] };
    await check("the longest motion leads", new gsh.Player([quick, slow]).leader === slow);
  }
  const drop = new DragEvent("drop", { bubbles: true, cancelable: true });
  const folder = { files: [{ name: "motions" }], items: [{ webkitGetAsEntry: () => ({ isDirectory: true }) }] };
  Object.defineProperty(drop, "dataTransfer", { value: folder });
  document.dispatchEvent(drop);
  const words = () => find("#message-text").textContent;
  await check("a folder is refused", drop.defaultPrevented && /^motions: is a folder/.test(words()));
  await audit.everything(NAME, 45);
  if (!people) {
    const box = { centre: [0, 0, 0], half: [1, 1, 1] }, up = new gsh.OrbitCamera(box), down = new gsh.OrbitCamera(box);
    down.up = -1;
    for (const camera of [up, down]) camera.yaw = 0.7, camera.pitch = 0.3, camera.turn(0.1, 0.05);
    const axes = up.axes().flat(), turned = down.axes().map(([x, y, z]) => [x, -y, -z]).flat();
    await check("y down is seen turned about x", axes.every((v, k) => Math.abs(v - turned[k]) < 1e-12));
    const one = new DataTransfer();
    one.items.add(new File(["x"], "walk.bvh"));
    const onto = (type) => new DragEvent(type, { dataTransfer: one, bubbles: true, cancelable: true });
    const stays = !document.dispatchEvent(onto("dragover")) && !document.dispatchEvent(onto("drop"));
    await check("a scene without people keeps the page", stays && /no people/.test(words()));
  }
  const first = find('input[data-name="pose-4"]');
  if (first) await drag(first, 25);
  view.page.shadows = false;
  await shoot(NAME + "-client-changed");
  location.href = NEXT;
})();
)js";

/// A page that carries its data.
constexpr const char* drive_carried = R"js(
(async () => {
  await view.started;
  await check("a page with data draws by itself", view.engine.name === "client" && find("#engine").textContent !== "");
  view.pause();
  view.setSize([256, 256]);
  await drag(find("#scrub"), 1);
  await drag(find('input[data-name="pose-57"]'), -60);
  await shoot("carried-client");
  const saved = new File([view.poseFile()], "own.npz");
  await view.openFile(saved);
  const read = view.player.leader.name === "own.npz" && view.page.states[0].pose.length === 165;
  await check("it reads gsh's own poses", read);
  await shoot("carried-client-dropped");
  await view.openFile(saved);
  const names = [...find('select[aria-label="Motion"]').options].map((option) => option.textContent);
  await check("the same name again gets a number: " + names.join(), names.slice(-2).join() === "own.npz,own.npz (2)");
  await check("in a narrow frame it is narrow", (innerWidth === 320) === (globalThis !== top));
  await audit.everything(`a page of ${innerWidth} pixels`, 45);
  find("#help-open").click();
  await audit.everything(`its help at ${innerWidth} pixels`, 1);
  if (globalThis === top) location.href = "narrow";
  else await send("done", "");
})();
)js";

/// A server of a scene on a thread of its own.
struct Served {
    Served(cpu::Threads& backend, ViewScene shown, const std::string& script, test::PageReports& reports)
        : scene(std::move(shown)), server(backend, scene,
                                          {.script = std::string(test::page_gestures) + test::page_audit + script,
                                           .report = [&reports](const std::string& body) { reports.take(body); }}),
          thread([this] { server.run(stop); }) {}
    ~Served() {
        stop = true;
        thread.join();
    }
    ViewScene scene;
    ViewServer server;
    std::atomic<bool> stop{false};
    std::thread thread;
};

/// Compares all pictures whose names begin with `prefix` with gsh's own.
int check_pictures(const test::PageReports& reports, const std::string& prefix, const ViewScene& scene,
                   cpu::Threads& backend) {
    ViewPainter painter(backend, scene);
    int count = 0;
    for (const auto& [name, content] : reports.others()) {
        if (!name.starts_with("request " + prefix)) continue;
        const std::string which = name.substr(8);
        INFO(which);
        const ViewRequest request = parse_view_request(content, scene.sizes());
        // gsh-animate's renderer has no ellipsoids, and always shadows; the painter, which is compared with it, has.
        const bool plain = request.show == ViewRequest::Show::splats && request.shadows && request.light_turn == 0;
        const Image<float> truth = plain ? test::rendered(scene, request) : painter.draw(request);
        const auto picture = reports.others().find("picture " + which);
        REQUIRE(picture != reports.others().end());
        const double psnr = test::psnr_of(picture->second, truth);
        if (which.find("server") != std::string::npos)
            CHECK(psnr == 200); // the very picture
        else
            CHECK(psnr >= (request.show == ViewRequest::Show::splats ? 50 : 42));
        ++count;
    }
    return count;
}

} // namespace

TEST_CASE("gsh-view in a browser: both engines draw what gsh-animate renders, and the controls do what they say") {
    if (test::chromium().empty()) {
        test::skip("chromium is not installed");
        return;
    }
    const auto& files = test::view_files();
    cpu::Threads backend(2);
    test::PageReports reports;

    // A page without a server of gsh: everything that it asks for is counted.
    const ViewScene carried_scene = test::view_scene({files.actor}, {files.stride});
    const std::string carried = make_page({{"scene", describe(carried_scene)},
                                           {"gaussians", package_scene(carried_scene, ScenePacking::compact)},
                                           {"motion-0-0", package_motion(carried_scene.motions[0][0])}},
                                          std::string(test::page_gestures) + test::page_audit + drive_carried);
    const test::PlainServer plain(carried, reports);

    {
        const auto quoted = [](const std::string& text) { return "\"" + text + "\""; };
        std::string next = "http://127.0.0.1:" + std::to_string(plain.port) + "/";
        std::vector<std::unique_ptr<Served>> servers; // each page leads to the next
        const auto serve = [&](ViewScene scene, const char* script, const std::string& name) {
            servers.push_back(std::make_unique<Served>(
                backend, std::move(scene),
                test::filled_in(test::filled_in(script, "NEXT", quoted(next)), "NAME", quoted(name)), reports));
            next = servers.back()->server.url();
        };
        serve(test::view_scene({files.cloud}), drive_other, "cloud");
        serve(test::view_scene({files.polar, files.dual}, {files.left, files.right}), drive_other, "tubes");
        next += "&engine=client";
        const std::string walk = test::bvh_text(test::sample_rig({.names = test::Names::cmu, .units = 100}), "ZYX");
        const std::string strange = "HIERARCHY\nROOT Bone\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
                                    "End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n";
        const std::string drive = test::filled_in(test::filled_in(drive_actor, "WALK", nlohmann::json(walk).dump()),
                                                  "STRANGE", nlohmann::json(strange).dump());
        serve(test::view_scene({files.actor}, {files.stride, files.reach}), drive.c_str(), "actor");

        const test::Browser browser(next);
        const bool finished = reports.wait(std::chrono::seconds(240));
        if (!finished) FAIL_CHECK("the scripts did not end; the browser says: " << browser.log());
        for (const std::string& check : reports.checks()) {
            INFO(check);
            CHECK(check.starts_with("good "));
        }
        CHECK(reports.checks().size() >= 130);
        CHECK(check_pictures(reports, "cloud", servers[0]->scene, backend) == 3);
        CHECK(check_pictures(reports, "tubes", servers[1]->scene, backend) == 3);
        CHECK(check_pictures(reports, "server", servers[2]->scene, backend) == 9);
        CHECK(check_pictures(reports, "client", servers[2]->scene, backend) == 6);
        CHECK(check_pictures(reports, "carried", servers[2]->scene, backend) == 2);

        // The dropped BVH is the motion that programs read from the file. The avatar keeps its shape.
        const RigData& rig = servers[2]->scene.people->data[0].rig;
        const test::Temporary there;
        write_file(there / "walk.bvh", walk, Sync::none);
        std::vector<std::string> guesses;
        const Motion walked = motion_of_file(there / "walk.bvh", rig.body, guesses, true, rig.betas);
        const auto state = nlohmann::json::parse(reports.others().at("walked"));
        CHECK(state["betas"].get<std::vector<double>>() == rig.betas);
        const auto angles = state["pose"].get<std::vector<double>>();
        REQUIRE(angles.size() == 3 * rig.joint_count());
        for (std::size_t j = 0; j < rig.joint_count(); ++j)
            for (int axis = 0; axis < 3; ++axis)
                CHECK(angles[3 * j + static_cast<std::size_t>(axis)] ==
                      doctest::Approx(walked.pose_at(2)[j][axis]).epsilon(1e-6).scale(1));

        // The saved pose is a file of gsh's own.
        const auto saved = reports.others().find("npz");
        REQUIRE(saved != reports.others().end());
        const test::Temporary folder;
        write_file(folder / "pose.npz", saved->second, Sync::none);
        std::vector<std::string> warnings;
        const BodyModel& body = servers[2]->scene.people->data[0].rig.body;
        const Motion motion = load_motion(folder / "pose.npz", body, {}, &warnings);
        CHECK(warnings.empty());
        REQUIRE(motion.frame_count() == 1);
        CHECK(motion.pose[18].z == doctest::Approx(70 * std::numbers::pi / 180).epsilon(1e-9));
        CHECK(motion.expression[1] == doctest::Approx(1.5));
        CHECK(motion.betas[0] == doctest::Approx(-1));
    }
    CHECK(plain.foreign == 0);
}
