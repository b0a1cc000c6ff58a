// SPDX-License-Identifier: Apache-2.0
/// The page of gsh-view in headless Chromium: sliders, motions, dropped files, and the pictures of both engines.
#include "programs/browser.hpp"
#include "programs/view_scenes.hpp"
#include "support/skip.hpp"

#include "view/view_package.hpp"
#include "view/view_page.hpp"
#include "view/view_painter.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"
#include "view/view_server.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <httplib.h>

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
using namespace gsh::examples;

namespace {

/// What every script begins with: reports, and the gestures of a user.
constexpr const char* gestures = R"js(
const send = (name, content) =>
  fetch("report" + location.search, { method: "POST", body: new Blob([name + "\n", content]) });
const check = (what, good) => send("check", (good ? "good " : "bad ") + what);
const view = gsh.view, find = (text) => document.querySelector(text);
const drag = async (slider, value) => {
  slider.value = value;
  slider.dispatchEvent(new Event("input", { bubbles: true }));
  await view.nextPicture();
};
const press = (label) => [...document.querySelectorAll("button")].find((b) => b.textContent === label).click();
const choose = (select, value) => {
  select.value = value;
  select.dispatchEvent(new Event("change", { bubbles: true }));
};
const shoot = async (name) => {
  await view.nextPicture();
  await send("request " + name, JSON.stringify({ ...view.request(), format: "png" }));
  await send("picture " + name, await view.picture());
};
const until = async (what) => {
  for (let n = 0; n < 400; ++n) {
    if (what()) return true;
    await new Promise((done) => setTimeout(done, 25));
  }
  return false;
};
window.addEventListener("error", (event) => send("check", "bad script: " + event.message));
window.addEventListener("unhandledrejection", (event) => send("check", "bad script: " + event.reason));
)js";

/// The actor: everything that the page does, then the pictures of both engines.
constexpr const char* drive_actor = R"js(
(async () => {
  await view.started;
  await check("without a graphics card the server draws", view.engine.name === "server");
  await check("a motion plays at once", view.player.playing);
  const before = view.page.pictures;
  await check("pictures follow each other", await until(() => view.page.pictures > before + 2));
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
  await check("another file is refused in words", /bad\.npz/.test(find("#message").textContent));
  const stage = find("#stage"), yaw = view.camera.yaw, at = (type, x, y) => stage.dispatchEvent(new PointerEvent(type,
    { pointerId: 1, clientX: x, clientY: y, buttons: 1, bubbles: true }));
  stage.setPointerCapture = () => {};
  at("pointerdown", 300, 300), at("pointermove", 380, 320), at("pointerup", 380, 320);
  await check("dragging turns the camera", view.camera.yaw !== yaw);
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
  await send("done", "");
})();
)js";

/// What the scripts reported.
class Reports {
public:
    void take(const std::string& body) {
        const std::lock_guard lock(mutex_);
        const std::size_t line = body.find('\n');
        const std::string name = body.substr(0, line), content = body.substr(line + 1);
        if (name == "check")
            checks_.push_back(content);
        else
            others_[name] = content;
        if (name == "done") done_ = true;
        arrived_.notify_all();
    }
    /// Waits for the end of the last script, or for a failure.
    bool wait(std::chrono::seconds most) {
        std::unique_lock lock(mutex_);
        return arrived_.wait_for(lock, most, [&] { return done_; });
    }
    [[nodiscard]] const std::vector<std::string>& checks() const { return checks_; }
    [[nodiscard]] const std::map<std::string, std::string>& others() const { return others_; }

private:
    std::mutex mutex_;
    std::condition_variable arrived_;
    bool done_ = false;
    std::vector<std::string> checks_;
    std::map<std::string, std::string> others_;
};

/// A server of a scene on a thread of its own.
struct Served {
    Served(cpu::Threads& backend, ViewScene shown, const std::string& script, Reports& reports)
        : scene(std::move(shown)),
          server(backend, scene,
                 {.script = gestures + script, .report = [&reports](const std::string& body) { reports.take(body); }}),
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

/// A server of one page that knows nothing of gsh. It counts what else is asked for.
struct PlainServer {
    PlainServer(const std::string& page, Reports& reports) {
        server.Get("/", [&page](const httplib::Request&, httplib::Response& response) {
            response.set_content(page, "text/html; charset=utf-8");
        });
        server.Post("/report",
                    [&reports](const httplib::Request& request, httplib::Response&) { reports.take(request.body); });
        server.set_error_handler([this](const httplib::Request&, httplib::Response&) { ++foreign; });
        server.set_keep_alive_timeout(1);
        port = server.bind_to_any_port("127.0.0.1");
        thread = std::thread([this] { server.listen_after_bind(); });
    }
    ~PlainServer() {
        server.stop();
        thread.join();
    }
    httplib::Server server;
    int port = 0;
    std::atomic<int> foreign{0};
    std::thread thread;
};

std::string filled_in(std::string script, const std::string& word, const std::string& value) {
    for (std::size_t at = 0; (at = script.find(word, at)) != std::string::npos; at += value.size())
        script.replace(at, word.size(), value);
    return script;
}

/// PSNR in dB of a picture that the page sent, against one of ours; 200 for equal ones.
double psnr_of(const std::string& png, const Image<float>& truth) {
    const test::Temporary folder;
    write_file(folder / "picture.png", png, Sync::none);
    const PixelImage a = read_image(folder / "picture.png"), b = quantise(truth.view());
    REQUIRE(a.width == b.width);
    REQUIRE(a.height == b.height);
    double sum = 0;
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x)
            for (int c = 0; c < 3; ++c) sum += std::pow((a.pixel(y, x)[c] - b.pixel(y, x)[c]) / 255.0, 2);
    return sum == 0 ? 200 : -10 * std::log10(sum / (3.0 * a.width * a.height));
}

/// Compares all pictures whose names begin with `prefix` with gsh's own.
int check_pictures(const Reports& reports, const std::string& prefix, const ViewScene& scene, cpu::Threads& backend) {
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
        const double psnr = psnr_of(picture->second, truth);
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
    Reports reports;

    // A page without a server of gsh: everything that it asks for is counted.
    const ViewScene carried_scene = test::view_scene({files.actor}, {files.stride});
    const std::string carried = make_page({{"scene", describe(carried_scene)},
                                           {"gaussians", package_scene(carried_scene, Packing::compact)},
                                           {"motion-0-0", package_motion(carried_scene.motions[0][0])}},
                                          std::string(gestures) + drive_carried);
    const PlainServer plain(carried, reports);

    {
        const auto quoted = [](const std::string& text) { return "\"" + text + "\""; };
        std::string next = "http://127.0.0.1:" + std::to_string(plain.port) + "/";
        std::vector<std::unique_ptr<Served>> servers; // each page leads to the next
        const auto serve = [&](ViewScene scene, const char* script, const std::string& name) {
            servers.push_back(std::make_unique<Served>(
                backend, std::move(scene), filled_in(filled_in(script, "NEXT", quoted(next)), "NAME", quoted(name)),
                reports));
            next = servers.back()->server.url();
        };
        serve(test::view_scene({files.cloud}), drive_other, "cloud");
        serve(test::view_scene({files.polar, files.dual}, {files.left, files.right}), drive_other, "tubes");
        next += "&engine=client";
        serve(test::view_scene({files.actor}, {files.stride, files.reach}), drive_actor, "actor");

        const test::Browser browser(next);
        const bool finished = reports.wait(std::chrono::seconds(150));
        if (!finished) FAIL_CHECK("the scripts did not end; the browser says: " << browser.log());
        for (const std::string& check : reports.checks()) {
            INFO(check);
            CHECK(check.starts_with("good "));
        }
        CHECK(reports.checks().size() >= 20);
        CHECK(check_pictures(reports, "cloud", servers[0]->scene, backend) == 3);
        CHECK(check_pictures(reports, "tubes", servers[1]->scene, backend) == 3);
        CHECK(check_pictures(reports, "server", servers[2]->scene, backend) == 7);
        CHECK(check_pictures(reports, "client", servers[2]->scene, backend) == 5);
        CHECK(check_pictures(reports, "carried", servers[2]->scene, backend) == 2);

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
