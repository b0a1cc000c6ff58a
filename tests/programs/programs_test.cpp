// SPDX-License-Identifier: Apache-2.0
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/core/rng.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/train/memory.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <initializer_list>
#include <iterator>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::json_of;
using test::run;
using test::same_file;
namespace fs = std::filesystem;

namespace {

/// One capture and one reconstruction of it for all tests here.
struct Reconstructed : test::SmallCapture {
    fs::path out = folder / "out";
    test::Outcome reconstruction = run(reconstruct(out, {"--steps", "4", "--threads", "1"}));
};
Reconstructed& reconstructed() {
    static Reconstructed instance;
    return instance;
}

/// A folder for the results of one run. The destructor deletes it, because checkpoints are large.
struct OutFolder {
    test::Temporary folder;
    fs::path path = folder / "out";
    [[nodiscard]] bool has(const char* name) const { return fs::exists(path / name); }
};

} // namespace

TEST_CASE("a reconstruction leaves all that was promised") {
    const Reconstructed& s = reconstructed();
    check_done(s.reconstruction);
    CHECK(s.reconstruction.out == test::contains("1500 Gaussians, 4 training and 2 test images, 1 threads"));

    const auto metrics = json_of(s.out / "metrics.json");
    for (const char* key : {"psnr", "ssim", "psnr_person", "steps", "seconds", "gaussians", "peak_memory_bytes"})
        CHECK(metrics.at(key).is_number());
    CHECK(metrics.at("steps") == 4);
    CHECK(metrics.at("gaussians") == 1500);
    CHECK(metrics.at("psnr") > 10.0);
    CHECK(metrics.at("peak_memory_bytes") > 50'000'000);
    CHECK(metrics.at("backend") == "threads");
    CHECK(metrics.at("threads") == 1);
    CHECK(metrics.at("instruction_set") == GSH_TEXT(GSH_ISA));
    CHECK(!metrics.contains("device"));
    CHECK(metrics.at("protocol").get<std::string>().find("Test views of capture (2 images)") == 0);
    REQUIRE(metrics.at("images").size() == 2);
    CHECK(metrics.at("images")[1].at("name") == "test00_0001");
    CHECK(metrics.at("images")[1].at("psnr").is_number());
    CHECK(metrics.at("ms_per_stage").at("render") > 0.0);
    CHECK(metrics.at("configuration").get<std::string>().starts_with(default_configuration));
    for (const char* region : {"face", "hands", "body"}) {
        CHECK(metrics.at("psnr_regions").contains(region)); // null if images of 64 pixels show too little of it
        CHECK(metrics.at("images")[0].at("psnr_regions").contains(region));
    }
    CHECK(metrics.at("psnr_regions").at("body").is_number());
    CHECK(!metrics.contains("lpips"));

    const AvatarData avatar = load_avatar(s.out / "avatar.gsh");
    CHECK(avatar.gaussians.size() == 1500);
    CHECK(avatar.light.has_value());
    CHECK(avatar.ao.size() == 1500);
    const GaussianCloud<float> cloud = read_gaussian_ply(s.out / "avatar.ply");
    CHECK(cloud.size() == 1500);
    CHECK(cloud.sh_degree == 3);
    CHECK(cloud.means == avatar.gaussians.means);
    for (const char* name : {"test00_0000.png", "test00_0001.png"}) {
        const PixelImage comparison = read_image(s.out / "test" / name);
        CHECK(comparison.width == 3 * 64);
        CHECK(comparison.height == 64);
    }
    const std::string page = read_file(s.out / "report.html");
    CHECK(page != test::contains("http"));
    // A verdict and pictures come before figures; then what to do next.
    CHECK(page.find("class=\"verdict\"") < page.find("class=\"wiper\""));
    CHECK(page.find("class=\"wiper\"") < page.find("The avatar from all around"));
    CHECK(page.find("gsh-view " + (s.out / "avatar.gsh").string() + " --open") < page.find("<h2>Figures</h2>"));
    CHECK(metrics.at("verdict").get<std::string>() == test::contains(": "));
    REQUIRE(!metrics.at("advice").empty()); // what so short a training lacks
    CHECK(metrics.at("advice")[0].at("help").get<std::string>().starts_with("docs/README.md#"));
    CHECK(page == test::contains("Read docs/README.md, &quot;"));
    CHECK(page == test::contains("src=\"data:image/png;base64,"));
    CHECK(page == test::contains("<th>Backend</th><td>threads</td>"));
    CHECK(page == test::contains("over steps</figcaption></figure>"));  // a single sample gives no curve
    CHECK(page == test::contains("over photographs</figcaption><svg")); // exposure
    CHECK(page == test::contains("<th>Photographs</th><td>exposure from "));
    CHECK(page.ends_with("</html>\n"));
    CHECK(fs::exists(s.out / "checkpoint.gsh"));
    CHECK(test::files_below(s.out) == 8);
}

TEST_CASE("who asks for nothing gets the default configuration") {
    const Reconstructed& s = reconstructed();
    const OutFolder out;
    check_done(run({"gsh-reconstruct", "--capture", s.path.string(), "--body", s.body_file.string(), "--out",
                    out.path.string(), "--gaussians", "1500", "--steps", "1"}));
    const auto metrics = json_of(out.path / "metrics.json");
    CHECK(metrics.at("configuration") == std::string(default_configuration));
    const auto settings = stated_settings_of(named_configuration(default_configuration));
    CHECK(metrics.at("settings").size() == settings.size());
    for (const auto& [key, value] : settings) CHECK(metrics.at("settings").at(key) == value);
}

TEST_CASE("without a file of anybody's, the built-in actor is filmed, reconstructed and judged") {
    const OutFolder out;
    check_done(
        run({"gsh-reconstruct", "--synthetic", "--out", out.path.string(), "--gaussians", "6000", "--steps", "60",
             "--hold-out-motion", "0.25", "--set", "hash.table_size=4096", "--set", "ao.table_size=4096"}));
    const auto metrics = json_of(out.path / "metrics.json");
    CHECK(metrics.at("images").size() == 12);
    CHECK(metrics.at("psnr") > 25.0); // it is 19 after three steps
    CHECK(metrics.at("held_out_frames") == std::vector<int>{9, 10, 11});
    CHECK(metrics.at("seen_motion").at("images") == 9);
    CHECK(metrics.at("new_motion").at("images") == 3);
    CHECK(metrics.at("protocol").get<std::string>() == test::contains("the built-in actor"));
    CHECK(load_avatar(out.path / "avatar.gsh").gaussians.size() == 6000);
}

TEST_CASE("the same seed gives the same avatar on any number of threads, another seed another") {
    const Reconstructed& s = reconstructed();
    const OutFolder two, other;
    check_done(run(s.reconstruct(two.path, {"--steps", "4", "--threads", "2"})));
    CHECK(same_file(two.path / "avatar.gsh", s.out / "avatar.gsh"));
    CHECK(same_file(two.path / "avatar.ply", s.out / "avatar.ply"));
    CHECK(same_file(two.path / "test/test00_0001.png", s.out / "test/test00_0001.png"));
    check_done(run(s.reconstruct(other.path, {"--steps", "4", "--seed", "7"})));
    CHECK(!same_file(other.path / "avatar.ply", s.out / "avatar.ply"));

    const OutFolder paper_one, paper_two; // ambient occlusion over time
    check_done(run(s.reconstruct(paper_one.path, {"--config", "paper", "--steps", "12", "--threads", "1"})));
    check_done(run(s.reconstruct(paper_two.path, {"--config", "paper", "--steps", "12", "--threads", "2"})));
    CHECK(same_file(paper_one.path / "avatar.gsh", paper_two.path / "avatar.gsh"));
    CHECK(same_file(paper_one.path / "test/test00_0001.png", paper_two.path / "test/test00_0001.png"));
    const AvatarData avatar = load_avatar(paper_one.path / "avatar.gsh");
    CHECK(!avatar.light.has_value());
    CHECK(avatar.ao.size() == 1500);
}

TEST_CASE("a signal in the middle loses nothing that a checkpoint keeps") {
    const Reconstructed& s = reconstructed();
    const auto interrupt = [&](const OutFolder& out, const char* steps, int signal) {
        test::Process process(s.reconstruct(out.path, {"--steps", steps}));
        REQUIRE(process.wait_until([&] { return process.err().find("step 1 ") != std::string::npos; }));
        process.send(signal);
        const test::Outcome outcome = process.wait();
        CHECK(outcome.code == 130);
        CHECK(outcome.err == test::contains("--resume continues from there"));
        CHECK(out.has("checkpoint.gsh"));
        CHECK(test::files_below(out.path) == (out.has("checkpoint.before.gsh") ? 2 : 1));
    };
    const OutFolder whole, parts, terminated;
    check_done(run(s.reconstruct(whole.path, {"--steps", "60"})));
    interrupt(parts, "60", SIGINT);
    // Capture, body, steps and all else are in the checkpoint.
    check_done(run({"gsh-reconstruct", "--out", parts.path.string(), "--resume"}));
    CHECK(same_file(parts.path / "avatar.gsh", whole.path / "avatar.gsh"));
    CHECK(same_file(parts.path / "avatar.ply", whole.path / "avatar.ply"));
    CHECK(json_of(parts.path / "metrics.json").at("steps") == 60);
    interrupt(terminated, "1000000", SIGTERM);
}

TEST_CASE("killed again and again, also while a checkpoint is written, a reconstruction ends as if it never had been") {
    const Reconstructed& s = reconstructed();
    const OutFolder whole, killed;
    const char* steps = "400"; // far more than the run reaches before the last kill
    check_done(run(s.reconstruct(whole.path, {"--steps", steps})));

    const fs::path checkpoint = killed.path / "checkpoint.gsh", partial = killed.path / "checkpoint.gsh.partial";
    const auto written = [&] {
        return fs::exists(checkpoint) ? fs::last_write_time(checkpoint) : fs::file_time_type();
    };
    Rng random(11);
    int while_writing = 0;
    for (int kill = 0; kill < 6 || (kill < 20 && while_writing == 0); ++kill) {
        CAPTURE(kill);
        const bool in_writing = kill % 2 == 1;
        std::vector<std::string> more{"--steps", steps, "--checkpoint-interval", in_writing ? "1e-9" : "0.02"};
        if (kill > 0) more.push_back("--resume");
        const auto before = written();
        test::Process process(s.reconstruct(killed.path, more));
        REQUIRE(process.wait_until([&] { return written() != before; })); // each run gets further than the one before
        if (in_writing) { // wait until a part of a checkpoint is written
            const auto begun = [&] {
                std::error_code none;
                const auto size = fs::file_size(partial, none);
                return !none && size > 0;
            };
            REQUIRE(process.wait_until(begun, 0));
        } else { // at any moment
            std::this_thread::sleep_for(std::chrono::microseconds(static_cast<int>(random.uniform(0, 40'000))));
        }
        process.send(SIGKILL);
        REQUIRE(process.wait().code == -SIGKILL);
        CHECK(!killed.has("metrics.json"));
        while_writing += fs::exists(partial);
    }
    CHECK(while_writing > 0);
    check_done(run(s.reconstruct(killed.path, {"--steps", steps, "--resume"})));
    CHECK(json_of(killed.path / "metrics.json").at("steps") == 400);
    CHECK(!fs::exists(partial));
    for (const char* name : {"avatar.gsh", "avatar.ply", "test/test00_0000.png", "test/test00_0001.png"}) {
        CAPTURE(name);
        CHECK(same_file(killed.path / name, whole.path / name));
    }
    CHECK(test::files_below(killed.path) == test::files_below(whole.path));
}

TEST_CASE("a checkpoint belongs to one training alone") {
    const Reconstructed& s = reconstructed();
    const OutFolder out;
    check_done(run(s.reconstruct(out.path, {"--steps", "2"})));
    const std::string avatar = read_file(out.path / "avatar.gsh");
    const auto resume = [&](std::vector<std::string> more) {
        more.push_back("--resume");
        return run(s.reconstruct(out.path, more));
    };
    check_refused(resume({"--seed", "1"}), "gsh-reconstruct", {"checkpoint.gsh", "seed 0"});
    using Words = std::vector<std::string>;
    for (const auto& [other, said] : {std::pair(Words{"--config", "baseline-x"}, "region.samples = false"),
                                      {Words{"--set", "rate.sh=1e-3"}, "rate.sh = 0.001"},
                                      {Words{"--refine"}, "'nothing' where this run has 'refine'"}})
        check_refused(resume(other), "gsh-reconstruct", {"checkpoint.gsh", "a different run", said});
    Words fewer = s.reconstruct(out.path, {"--steps", "3", "--resume"});
    *std::next(std::find(fewer.begin(), fewer.end(), "--gaussians")) = "400";
    check_refused(run(fewer), "gsh-reconstruct", {"checkpoint.gsh", "gaussians = 400"});
    const OutFolder paper; // of a run with another configuration than the default
    check_done(run(s.reconstruct(paper.path, {"--config", "paper", "--steps", "2"})));
    check_refused(run(s.reconstruct(paper.path, {"--config", "light", "--steps", "4", "--resume"})), "gsh-reconstruct",
                  {"checkpoint.gsh", "a different run",
                   "'rate.stored_displacements = 0.00016' where this run has 'rate.stored_displacements = 1e-04'",
                   "--config"});
    check_done(run(s.reconstruct(paper.path, {"--steps", "4", "--resume"}))); // with the checkpoint's configuration
    CHECK(json_of(paper.path / "metrics.json").at("configuration").get<std::string>().starts_with("paper"));
    check_done(run(s.reconstruct(paper.path, {"--config", "paper", "--steps", "4", "--resume"})));
    check_done(resume({"--config", std::string(default_configuration), "--steps", "2"})); // named, it is the same
    CHECK(read_file(out.path / "avatar.gsh") == avatar);
    test::truncate_file(out.path / "checkpoint.gsh", 1000);
    check_refused(resume({"--steps", "6"}), "gsh-reconstruct", {"checkpoint.gsh"});
    fs::remove(out.path / "checkpoint.gsh");
    check_refused(resume({"--steps", "6"}), "gsh-reconstruct", {"checkpoint.gsh", "nothing to resume"});
    CHECK(read_file(out.path / "avatar.gsh") == avatar); // no run changed it
}

TEST_CASE("a training that fails says which checkpoint is complete") {
    const Reconstructed& s = reconstructed();
    const OutFolder out, without;
    const std::vector<std::string> failing{"--steps", "12", "--set", "rate.quats=1e38"};
    std::vector<std::string> keeping = failing;
    keeping.insert(keeping.end(), {"--checkpoint-interval", "1e-9"});
    const test::Outcome kept = run(s.reconstruct(out.path, keeping)), lost = run(s.reconstruct(without.path, failing));
    for (const test::Outcome& outcome : {kept, lost}) {
        CHECK(outcome.code == 2);
        CHECK(outcome.err == test::contains("\ngsh-reconstruct: ")); // after the line of progress
        CHECK(outcome.err == test::contains("not finite"));
    }
    CHECK(kept.err == test::contains("the checkpoint of step 1 is complete; the run can be resumed"));
    CHECK(fs::exists(out.path / "checkpoint.gsh"));
    CHECK(lost.err != test::contains("checkpoint"));
}

TEST_CASE("a reconstruction keeps to time and memory") {
    const Reconstructed& s = reconstructed();
    const OutFolder timed, small, none;
    check_done(run(s.reconstruct(timed.path, {"--seconds", "1"})));
    const auto metrics = json_of(timed.path / "metrics.json");
    CHECK(metrics.at("seconds") >= 1.0);
    CHECK(metrics.at("seconds") < 10.0);
    CHECK(metrics.at("steps") >= 1);
    const bool curves = read_file(timed.path / "report.html").find("<svg") != std::string::npos;
    CHECK(curves == (metrics.at("steps") >= 10)); // two samples make a curve

    // Photographs that are read when they are needed give the same avatar.
    const test::Outcome in_memory = run(s.reconstruct(small.path, {"--steps", "2"}));
    const std::string avatar = read_file(small.path / "avatar.gsh");
    const test::Outcome stored = run(s.reconstruct(small.path, {"--steps", "2", "--image-memory", "1"}));
    CHECK(stored.code == 0);
    CHECK(stored.out == test::contains("test images, read when they are needed, "));
    CHECK(in_memory.out != test::contains("read when they are needed"));
    CHECK(read_file(small.path / "avatar.gsh") == avatar);

    std::size_t held = 0; // the program crops photographs
    for (const bool of_test : {false, true})
        for (const Photo& photo : photos_of(s.capture, of_test)) held += 4 * box_of_photo(photo).size();
    for (const std::string name : {"light", "paper"}) {
        ConfiguredAvatarParams config = named_configuration(name).avatar;
        config.appearance.field.grid.table_size = config.occlusion.grid.table_size = 4096;
        const MemoryModel memory = training_memory<cpu::Serial>(config, 64 * 64, held, 1,
                                                                {.joint_count = s.body.joint_count(),
                                                                 .vertex_count = s.body.vertex_count(),
                                                                 .frame_count = s.capture.frame_count()});
        const auto budget = [&](std::size_t gaussians) { return std::to_string(memory.bytes(gaussians)); };
        const test::Outcome fewer =
            run(s.reconstruct(small.path, {"--config", name, "--steps", "1", "--max-memory", budget(1000)}));
        CHECK(fewer.code == 0);
        CHECK(fewer.err == test::contains("warning: 1000 instead of 1500 Gaussians"));
        CHECK(json_of(small.path / "metrics.json").at("gaussians") == 1000);
        check_refused(run(s.reconstruct(none.path, {"--config", name, "--steps", "1", "--max-memory", budget(100)})),
                      "gsh-reconstruct", {"--max-memory", "too little"});
    }
    CHECK(!fs::exists(none.path));
}

TEST_CASE("without test views there is an avatar, and no figures") {
    const Reconstructed& s = reconstructed();
    const OutFolder out;
    const test::Temporary folder;
    const fs::path path = folder / "a <b> & \xC3\xBC";
    Capture capture = s.capture;
    for (NamedCamera& camera : capture.cameras) camera.role = NamedCamera::Role::train;
    save_capture(path, capture);
    const test::Outcome outcome = run(s.reconstruct(out.path, {"--steps", "1"}, path));
    check_done(outcome);
    CHECK(outcome.out == test::contains("PSNR none dB"));
    CHECK(json_of(out.path / "metrics.json").at("psnr").is_null());
    CHECK(json_of(out.path / "metrics.json").at("images").empty());
    CHECK(read_file(out.path / "report.html") == test::contains("a &lt;b&gt; &amp; \xC3\xBC"));
    CHECK(out.has("avatar.gsh"));
}

TEST_CASE("what is probably wrong is said, and done all the same") {
    const Reconstructed& s = reconstructed();
    const OutFolder out;
    const test::Temporary folder;
    const fs::path path = folder / "capture";
    Capture capture = s.capture;
    capture.cameras[1].camera.t += vec3<double>(40, 0, 0);
    for (std::size_t f = 0; f < 2; ++f) // of the first camera
        for (std::size_t i = 3; i < capture.images[f].data.size(); i += 4)
            capture.images[f].data[i] = static_cast<std::uint8_t>(255 - capture.images[f].data[i]);
    save_capture(path, capture);
    BodyModel body = s.body; // its mean hands are those of the first frame
    const auto pose = capture.motion.pose_at(0);
    body.hands_mean_left.assign(pose.begin() + 25, pose.begin() + 40);
    body.hands_mean_right.assign(pose.begin() + 40, pose.begin() + 55);
    save_body_model(folder / "body.npz", body);
    test::NpzEdit(path / "poses.npz").replace("flat_hand", test::npy_bytes("|u1", "()", std::string(1, '\0')));
    // Both training cameras are wrong, so no photograph shows where the light comes from.
    check_refused(run(s.reconstruct(out.path, {"--steps", "1"}, path, folder / "body.npz")), "gsh-reconstruct",
                  {"check cameras, poses and masks", "--config paper"});
    const test::Outcome outcome =
        run(s.reconstruct(out.path, {"--config", "paper", "--steps", "1"}, path, folder / "body.npz"));
    INFO(outcome.err);
    CHECK(outcome.code == 0);
    for (const char* words : {"warning: ", "mean hand was added twice", "camera 'cam01' is far off the body",
                              "camera 'cam00' has a mask that is probably inverted"})
        CHECK(outcome.err == test::contains(words));
    CHECK(out.has("metrics.json"));
}

TEST_CASE("pictures of an avatar and of its canonical Gaussians") {
    const Reconstructed& s = reconstructed();
    const test::Temporary folder;
    const auto render = [&](const fs::path& scene, std::vector<std::string> more) {
        std::vector<std::string> words{"gsh-render", scene.string(),
                                       "--camera",   s.camera.string(),
                                       "--out",      (folder / "a.png").string(),
                                       "--npy",      (folder / "a.npy").string()};
        words.insert(words.end(), more.begin(), more.end());
        check_done(run(words));
        auto pixels = read_npy<float>(folder / "a.npy");
        CHECK(pixels.shape == Shape{64, 64, 3});
        const PixelImage picture = read_image(folder / "a.png");
        for (std::size_t i = 0; i < pixels.size(); ++i) {
            const double wanted = 255 * std::clamp(pixels[i], 0.0f, 1.0f);
            if (std::abs(picture.data[i / 3 * 4 + i % 3] - wanted) > 0.51) FAIL_CHECK("pixel " << i / 3);
        }
        return pixels;
    };
    const auto canonical = render(s.out / "avatar.gsh", {}), cloud = render(s.out / "avatar.ply", {});
    double difference = 0; // a PLY is rendered with the standard pixel filter, an avatar with its own
    for (std::size_t i = 0; i < cloud.size(); ++i)
        difference += std::abs(double(canonical[i]) - double(cloud[i])) / static_cast<double>(cloud.size());
    CHECK(difference < 0.05);
    CHECK(cloud[0] == 0.0f);
    const auto white = render(s.out / "avatar.gsh", {"--poses", (s.path / "poses.npz").string(), "--frame", "1",
                                                     "--background", "1", "0.5", "0"});
    CHECK(white[0] == 1.0f);
    CHECK(white[1] == 0.5f);
    CHECK(white.data != canonical.data);
    // Of several cameras, one must be named.
    const std::vector<std::string> list{"gsh-render", (s.out / "avatar.ply").string(),
                                        "--camera",   (s.path / "cameras.json").string(),
                                        "--out",      (folder / "b.png").string()};
    check_refused(run(list), "gsh-render", {"cameras.json", "cam00, cam01, test00"});
    auto named = list;
    named.insert(named.end(), {"--camera-name", "cam00"});
    check_done(run(named));
    CHECK(fs::exists(folder / "b.png"));
    // A camera that looks away from the person causes a warning.
    auto camera = json_of(s.camera);
    for (const int row : {0, 2}) { // half a turn about y
        for (auto& number : camera["R"][row]) number = -number.get<double>();
        camera["t"][row] = -camera["t"][row].get<double>();
    }
    write_file(folder / "away.json", camera.dump());
    const test::Outcome away =
        run({"gsh-render", (s.out / "avatar.ply").string(), "--camera", (folder / "away.json").string(), "--out",
             (folder / "c.png").string(), "--background", "1,1,1"});
    CHECK(away.code == 0);
    CHECK(away.err == test::contains("away.json: sees nothing"));
    CHECK(read_image(folder / "c.png").pixel(0, 0)[0] == 255);
}

TEST_CASE("frames of a new motion, through a camera that finds its place or that is given") {
    const Reconstructed& s = reconstructed();
    const test::Temporary folder;
    const std::vector<std::string> words{"gsh-animate", (s.out / "avatar.gsh").string(), "--poses", s.dance.string()};
    const auto animate = [&](const char* name, std::vector<std::string> more) {
        more.insert(more.begin(), words.begin(), words.end());
        more.insert(more.end(), {"--out", (folder / name).string()});
        const test::Outcome outcome = run(more);
        check_done(outcome);
        CHECK(outcome.out == test::contains("3 of 3 frames"));
        CHECK(test::files_below(folder / name) == 3);
    };
    animate("framed", {"--size", "96"});
    int left = 96, right = 0, top = 96, bottom = 0; // of the person over all frames
    for (const char* name : {"0000.png", "0001.png", "0002.png"}) {
        const PixelImage picture = read_image(folder / "framed" / fs::path(name));
        REQUIRE(picture.width == 96);
        for (int y = 0; y < 96; ++y)
            for (int x = 0; x < 96; ++x) {
                if (picture.pixel(y, x)[0] > 200) continue; // nearly the white background
                left = std::min(left, x), right = std::max(right, x + 1);
                top = std::min(top, y), bottom = std::max(bottom, y + 1);
            }
    }
    CHECK(std::max(right - left, bottom - top) >= 84);
    CHECK(std::abs((left + right) / 2 - 48) <= 4);
    CHECK(std::abs((top + bottom) / 2 - 48) <= 4);
    animate("given", {"--camera", s.camera.string(), "--background", "0", "0", "0"});
    CHECK(read_image(folder / "given" / fs::path("0002.png")).width == 64);

    // Pictures of an earlier, longer motion are kept, and a message names them.
    write_file(folder / "given" / fs::path("0003.png"), "of a longer motion");
    auto again = words;
    again.insert(again.end(), {"--size", "64", "--out", (folder / "given").string()});
    const test::Outcome outcome = run(again);
    CHECK(outcome.code == 0);
    CHECK(outcome.err == test::contains("1 pictures of a longer motion"));
    CHECK(fs::exists(folder / "given" / fs::path("0003.png")));
}

TEST_CASE("each program lists its options") {
    for (const char* program : {"gsh-reconstruct", "gsh-render", "gsh-animate"}) {
        const test::Outcome outcome = run({program, "--help"});
        CHECK(outcome.code == 0);
        CHECK(outcome.err.empty());
        CHECK(outcome.out == test::contains("--out"));
    }
}

TEST_CASE("every program prints its version, on one line, without its required options") {
    std::vector<std::string> programs;
    for (const auto& entry : fs::directory_iterator(fs::path(GSH_SOURCE_DIR) / "programs"))
        if (entry.path().extension() == ".cpp") programs.push_back(entry.path().stem().string());
    CHECK(programs.size() >= 11);
    for (std::string program : programs) {
        std::replace(program.begin(), program.end(), '_', '-');
        CAPTURE(program);
        const test::Outcome outcome = run({program, "--version"});
        CHECK(outcome.code == 0);
        CHECK(outcome.err.empty());
        CHECK(outcome.out.starts_with(program + " " GSH_VERSION_TEXT " (instructions: " GSH_TEXT(GSH_ISA) "; "));
        CHECK(outcome.out == test::contains("backends: threads"));
        CHECK(outcome.out.ends_with(")\n"));
        CHECK(std::count(outcome.out.begin(), outcome.out.end(), '\n') == 1);
    }
}
