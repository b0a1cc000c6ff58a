// SPDX-License-Identifier: Apache-2.0
/// gsh-export to .html: the written file, opened in headless Chromium from the disk and without a network, draws what
/// gsh-animate renders. With GSH_PAGE=AVATAR.gsh:MOTION.npz it measures that pair instead of a small avatar.
#include "programs/page_driver.hpp"
#include "programs/process.hpp"
#include "programs/view_scenes.hpp"
#include "support/contains.hpp"
#include "support/skip.hpp"

#include "common/base64.hpp"
#include "common/input_files.hpp"
#include "view/view_painter.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/splat/ply.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using namespace gsh::programs;
using test::check_done;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;

namespace {

/// FRAMES are those of the first motion to compare.
constexpr const char* drive_exported = R"js(
(async () => {
  await view.started;
  await check("the page comes from the disk", location.protocol === "file:");
  await check("it draws by itself", view.engine.name === "client");
  const names = view.page.motions[0].map((m) => m.name).join();
  await check("it has both motions", names === "stride.npz,reach.npz" || MEASURES);
  view.pause();
  view.setSize([256, 256]);
  for (const frame of FRAMES) {
    await drag(find("#scrub"), frame);
    await shoot("exported-" + frame);
  }
  await drag(find('input[data-name="pose-56"]'), 70);
  await check("the slider turns the joint", Math.abs(view.page.states[0].pose[56] - 70 * Math.PI / 180) < 1e-9);
  await shoot("exported-slider");
  const light = find('input[data-name="light"]');
  if (light) await drag(light, 80);
  await shoot("exported-turned");
  const loaded = performance.getEntriesByType("resource").map((entry) => entry.name);
  const own = (name) => name === globalThis.reportTo || /^(blob|data):/.test(name);
  await check("nothing else is loaded", loaded.every(own));
  await view.openFile(new File(["HIERARCHY"], "walk.bvh"));
  await check("a BVH is refused in words", /walk\.bvh.*gsh-motion/.test(find("#message-text").textContent));

  const message = () => find("#message-text").textContent;
  view.page.states[0].transl = [3, 2, -1];
  const away = view.poseFile();
  await send("away", away);
  await view.openFile(new File([away], "away.npz"));
  await check("gsh's own file is read", view.player.leader.name === "away.npz" && message() === "away.npz: 1 frame");
  await send("placed", JSON.stringify(view.player.leader.frame(0).transl));
  const intact = await gsh.npz.read(await away.arrayBuffer(), "away.npz");
  const refused = async (what, bytes, words) => {
    await view.openFile(new File([bytes], "changed.npz"));
    const text = message(), good = text.startsWith("changed.npz: ") && words.every((word) => text.includes(word));
    await check(what + " is refused" + (good ? "" : ": " + text), good && view.player.leader.name === "away.npz");
  };
  const changed = (change) => {
    const arrays = Object.fromEntries(Object.entries(intact).map(([key, { data, shape }]) =>
      [key, { data: data.slice(), shape: shape.slice() }]));
    change(arrays);
    return gsh.npz.write(arrays);
  };
  await check("copies are equal", (await changed(() => {}).text()) === (await away.text()));
  await refused("a file without frames", changed((a) => {
    for (const one of Object.values(a)) if (one.shape.length === 2) one.shape[0] = 0, one.data = one.data.slice(0, 0);
  }), ["no frames"]);
  await refused("NaN", changed((a) => (a.body_pose.data[5] = NaN)), ["body_pose", "NaN"]);
  await refused("infinity", changed((a) => (a.transl.data[1] = -Infinity)), ["transl", "Infinity"]);
  await refused("a pose without a place", changed((a) => delete a.transl), ["transl is missing", "global_orient"]);
  await refused("a mean hand", changed((a) => (a.flat_hand.data[0] = 0)), ["mean hand", "gsh-motion"]);
  await refused("a file without flat_hand", changed((a) => delete a.flat_hand), ["mean hand", "gsh-motion"]);
  await refused("another width", changed((a) => (a.jaw_pose.shape = [3, 1])), ["jaw_pose", "(3, 1)", "(1, 3)"]);
  await refused("going back in time", changed((a) => {
    for (const one of Object.values(a)) if (one.shape.length === 2) {
      one.shape[0] = 2, one.data = Float64Array.of(...one.data, ...one.data);
    }
    a.timestamps = { data: [1, 0.5], shape: [2] };
  }), ["timestamps", "frame 1"]);
  await refused("a rate of 0", changed((a) => {
    delete a.timestamps;
    a.fps = { data: [0], shape: [1] };
  }), ["fps is 0", "frames per second"]);
  const doubled = (rate) => changed((a) => {
    for (const one of Object.values(a)) if (one.shape.length === 2) {
      one.shape[0] = 2, one.data = Float64Array.of(...one.data, ...one.data);
    }
    delete a.timestamps;
    Object.assign(a, rate);
  }).arrayBuffer();
  const person = { parents: new Array(55), expressions: intact.expression ? intact.expression.shape[1] : 0,
                   betas: Array.from(intact.betas.data) };
  const interval = async (rate, fps) => {
    const { seconds, warnings } = await gsh.poseFile.read(await doubled(rate), "two.npz", person, fps);
    return `${Math.round(seconds[1] * 1e4)} ${warnings.filter((text) => text.includes("per second")).length}`;
  };
  await check("no rate is 30 with a warning", await interval({}) === "333 1");
  await check("a rate is read", await interval({ framerate: { data: [50], shape: [1] } }) === "200 0");
  await check("the page's rate counts", await interval({ framerate: { data: [50], shape: [1] } }, 10) === "1000 1");
  const whole = new Uint8Array(await away.arrayBuffer()), end = whole.length - 22, flipped = whole.slice();
  flipped[60] ^= 1; // in the first array
  await refused("a wrong bit", flipped, ["is damaged"]);
  const misled = whole.slice();
  new DataView(misled.buffer).setUint32(end + 16, whole.length - 3, true);
  await refused("a wrong offset", misled, ["is damaged"]);
  await refused("a part of a file", whole.slice(0, end), ["archive"]);
  await refused("a file of a later version", Uint8Array.from(atob("OF_LATER"), (c) => c.charCodeAt(0)),
                ["holds 'motion 2'", "'motion 1'"]);
  await refused("a file that inflates", Uint8Array.from(atob("INFLATES"), (c) => c.charCodeAt(0)), ["256 MiB"]);
  await send("done", "");
})();
)js";

/// A page whose ambient occlusion follows its motion.
constexpr const char* drive_occluded = R"js(
(async () => {
  await view.started;
  view.pause();
  view.setSize([256, 256]);
  for (const frame of [0, 1, 2]) {
    await drag(find("#scrub"), frame);
    await shoot("follows-" + frame);
  }
  await check("the page says where shadows are the mean", /other poses.*mean/.test(find(".note").textContent));
  await drag(find('input[data-name="transl-0"]'), 0.1);
  await shoot("follows-moved");
  await drag(find('input[data-name="pose-4"]'), 25);
  await shoot("mean-slider");
  press("Reset");
  await shoot("follows-reset");
  view.page.shadows = false;
  await shoot("shadowless");
  await send("done", "");
})();
)js";

/// Runs a page with a script added, in a browser that opens it from the disk and reaches nothing but the test itself.
void drive_page(const fs::path& page, std::string script, test::PageReports& reports) {
    const std::string nothing = "no page";
    const test::PlainServer listener(nothing, reports);
    script = "globalThis.reportTo = \"http://127.0.0.1:" + std::to_string(listener.port) + "/report\";\n" +
             test::page_gestures + script;
    std::string text = read_file(page);
    text.insert(text.rfind("</body>"), "<script>\n" + script + "</script>\n");
    const fs::path driven = page.parent_path() / "driven.html";
    write_file(driven, text, Sync::none);
    // Names of hosts are not resolved; only the test itself is reached, by its number.
    const test::Browser browser(
        "file://" + driven.string(),
        {"--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1", "--disable-features=LocalNetworkAccessChecks"});
    if (!reports.wait(std::chrono::seconds(120)))
        FAIL_CHECK("the script did not end; the browser says: " << browser.log());
    for (const std::string& check : reports.checks()) {
        INFO(check);
        CHECK(check.starts_with("good "));
    }
    CHECK(listener.foreign == 0);
}

/// The refused exports leave nothing.
void refuse_page(const fs::path& input, const fs::path& to, std::vector<std::string> more,
                 std::initializer_list<std::string_view> words) {
    more.insert(more.begin(), {"gsh-export", input.string(), "--to", to.string()});
    check_refused(run(more), "gsh-export", words);
    CHECK(!fs::exists(to));
}

} // namespace

TEST_CASE("gsh-export writes a page that draws what gsh-animate renders, without a server or a network") {
    if (test::chromium().empty()) {
        test::skip("chromium is not installed");
        return;
    }
    const auto& files = test::view_files();
    const char* const measured = std::getenv("GSH_PAGE");
    const std::string pair = measured ? measured : "";
    const fs::path avatar = measured ? fs::path(pair.substr(0, pair.find(':'))) : files.actor;
    const fs::path motion = measured ? fs::path(pair.substr(pair.find(':') + 1)) : files.stride;
    const test::Temporary folder;
    std::vector<std::string> words{"gsh-export", avatar.string(), "--to", (folder / "page.html").string(),
                                   "--poses",    motion.string()};
    if (!measured) words.insert(words.end(), {"--poses", files.reach.string()});
    const test::Outcome outcome = run(words);
    check_done(outcome);
    CHECK(outcome.out == test::contains(" Gaussians, "));
    if (measured) MESSAGE(outcome.out);

    const ViewScene scene = test::view_scene({avatar}, {motion});
    const std::size_t count = scene.motions[0][0].motion.frame_count();
    const std::vector<std::size_t> frames{0, count / 3, count - 1};
    NpzWriter inflates(folder / "inflates.npz", Packing::deflated);
    inflates.add("global_orient", std::vector<std::uint8_t>((std::size_t(256) << 20) + 1));
    inflates.commit();
    std::string script = test::filled_in(drive_exported, "FRAMES", nlohmann::json(frames).dump());
    NpzWriter later(folder / "later.npz");
    later.add_text("gsh_format", "motion 2");
    later.commit();
    script = test::filled_in(script, "OF_LATER", base64(read_file(folder / "later.npz")));
    script = test::filled_in(script, "INFLATES", base64(read_file(folder / "inflates.npz")));
    test::PageReports reports;
    drive_page(folder / "page.html", test::filled_in(script, "MEASURES", measured ? "true" : "false"), reports);
    CHECK(reports.checks().size() == 25);

    cpu::Threads backend(2);
    ViewPainter painter(backend, scene);
    std::size_t pictures = 0;
    for (const auto& [name, content] : reports.others()) {
        if (!name.starts_with("request ")) continue;
        const std::string which = name.substr(8);
        INFO(which);
        const ViewRequest request = parse_view_request(content, scene.sizes());
        const auto picture = reports.others().find("picture " + which);
        REQUIRE(picture != reports.others().end());
        const bool turned =
            which == "exported-turned"; // gsh-animate turns the light of a file, the painter that of a page
        const double psnr =
            test::psnr_of(picture->second, turned ? painter.draw(request) : test::rendered(scene, request));
        CHECK(psnr >= 50);
        if (measured) MESSAGE(which << ": " << psnr << " dB");
        ++pictures;
    }
    CHECK(pictures == frames.size() + 2);
    // A dropped motion is placed as gsh-view places it.
    std::vector<std::string> warnings;
    const ViewMotion placed = read_sent_motion(scene, 0, "away.npz", reports.others().at("away"), warnings);
    const auto transl = nlohmann::json::parse(reports.others().at("placed")).get<std::vector<double>>();
    for (int axis = 0; axis < 3; ++axis)
        CHECK(transl[static_cast<std::size_t>(axis)] ==
              doctest::Approx(placed.motion.transl[0][axis]).epsilon(1e-3).scale(1));
    // The frames are those of the motion.
    for (const std::size_t f : frames) {
        const auto request = nlohmann::json::parse(reports.others().at("request exported-" + std::to_string(f)));
        const auto pose = request["people"][0]["pose"].get<std::vector<double>>();
        const auto truth = scene.motions[0][0].motion.pose_at(f);
        REQUIRE(pose.size() == 3 * truth.size());
        double apart = 0;
        for (std::size_t k = 0; k < pose.size(); ++k)
            apart = std::max(apart, std::abs(pose[k] - truth[k / 3][static_cast<int>(k % 3)]));
        CHECK(apart < 1e-6);
    }
}

TEST_CASE("in a page, ambient occlusion follows the motions, and is the mean in other poses") {
    if (test::chromium().empty()) {
        test::skip("chromium is not installed");
        return;
    }
    const auto& files = test::view_files();
    const test::Temporary folder;
    check_done(run({"gsh-export", files.occluded.string(), "--to", (folder / "page.html").string(), "--poses",
                    files.left.string()}));
    test::PageReports reports;
    drive_page(folder / "page.html", drive_occluded, reports);
    const ViewScene follows = test::view_scene({files.occluded}, {files.left});
    ViewScene mean = follows, shadowless = follows;
    mean.people->data[0].occlusion_field.reset();
    shadowless.people->data[0].occlusion_field.reset(), shadowless.people->data[0].ao.clear();
    std::size_t pictures = 0;
    for (const auto& [name, content] : reports.others()) {
        if (!name.starts_with("request ")) continue;
        const std::string which = name.substr(8);
        INFO(which);
        const ViewRequest request = parse_view_request(content, follows.sizes());
        const ViewScene& truth = which.starts_with("follows") ? follows : which.starts_with("mean") ? mean : shadowless;
        const std::string& picture = reports.others().at("picture " + which);
        for (const ViewScene* scene : std::initializer_list<const ViewScene*>{&follows, &mean, &shadowless}) {
            const double psnr = test::psnr_of(picture, test::rendered(*scene, request));
            if (scene == &truth)
                CHECK(psnr >= 50);
            else
                CHECK(psnr < 40); // the three can be told apart
        }
        ++pictures;
    }
    CHECK(pictures == 7);
}

TEST_CASE("gsh-export makes pages of scenes and of parts, and refuses what a page cannot have") {
    const auto& files = test::view_files();
    const test::Temporary folder;
    const auto make = [&](const fs::path& input, const char* to, std::vector<std::string> more) {
        more.insert(more.begin(), {"gsh-export", input.string(), "--to", (folder / to).string()});
        const test::Outcome outcome = run(more);
        check_done(outcome);
        return outcome.out;
    };
    CHECK(make(files.cloud, "cloud.html", {}) == test::contains(" Gaussians, "));
    CHECK(make(files.actor, "few.html", {"--largest", "100", "--sh", "0"}) == test::contains("100 Gaussians, "));
    CHECK(fs::file_size(folder / "few.html") < fs::file_size(folder / "cloud.html") * 8);
    CHECK(read_file(folder / "few.html") == test::contains("data-carried=\"motion-0-3\"")); // built in
    make(files.actor, "one.html", {"--poses", files.stride.string(), "--frame", "2"});
    make(files.actor, "part.html", {"--poses", files.stride.string(), "--frames", "0:2:2"});
    const std::string one = read_file(folder / "one.html"), part = read_file(folder / "part.html");
    CHECK(one.size() < part.size());
    const fs::path to = folder / "x.html";
    const std::string stride = files.stride.string();
    refuse_page(files.actor, folder / "x.ply", {"--poses", stride, "--poses", stride}, {"--poses", "only .html"});
    refuse_page(files.actor, to, {"--poses", stride, "--poses", stride, "--frame", "0"}, {"--poses", "--frame"});
    refuse_page(files.actor, to, {"--poses", stride, "--frame", "4"}, {"--frame 4", "4 frames"});
    refuse_page(files.actor, to, {"--poses", stride, "--frames", "0:4"}, {"--frames 0:4", "4 frames"});
    refuse_page(files.actor, to, {"--poses", stride, "--as-stored"}, {"--as-stored", ".html"});
    refuse_page(files.actor, to, {"--clusters", "9"}, {"--clusters", ".glb"});
    refuse_page(files.cloud, to, {"--poses", stride}, {"--poses", "avatar"});
    refuse_page(files.stride, to, {}, {"stride.npz", "no known format", ".spz"});
}

TEST_CASE("gsh-view takes scenes in every format that is read, and refuses others") {
    const auto& files = test::view_files();
    const test::Temporary folder;
    const GaussianCloud<float> truth = test::view_scene({files.cloud}).cloud;
    for (const char* name : {"s.ply", "s.compressed.ply", "s.spz", "s.splat", "s.glb"}) {
        INFO(std::string(name));
        CHECK(run({"gsh-export", files.cloud.string(), "--to", (folder / name).string()}).code == 0);
        const ViewScene scene = test::view_scene({folder / name});
        REQUIRE(scene.cloud.size() == truth.size());
        CHECK(scene.y_down == (std::string_view(name) == "s.splat")); // the others state which way is up
    }
    CHECK(test::view_scene({files.cloud}).y_down); // a PLY that states nothing
    write_gaussian_ply(folder / "stated.ply", truth, {.up = UpAxis::y, .filter = PixelFilter{.dilation = 0.1}});
    const ViewScene stated = test::view_scene({folder / "stated.ply"});
    CHECK(!stated.y_down);
    CHECK(stated.filter.dilation == doctest::Approx(0.1));
    write_file(folder / "bad.spz", "not a file of Gaussians");
    check_refused(run({"gsh-view", (folder / "bad.spz").string()}), "gsh-view", {"bad.spz"});
    check_refused(run({"gsh-view", files.stride.string()}), "gsh-view", {"stride.npz", "no known format", ".glb"});
    check_refused(run({"gsh-view", (folder / "none.ply").string()}), "gsh-view", {"none.ply", "No such file"});
}
