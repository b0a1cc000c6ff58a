// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-reconstruct in its configurations, with refinement, regions, plates and LPIPS, as a user runs it.
#include "io/colmap_files.hpp"
#include "io/safetensors_files.hpp"
#include "io/sample_files.hpp"
#include "loss/lpips_networks.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/bodies.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/math/rotation.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
using test::studio;
namespace fs = std::filesystem;

namespace {

/// A folder for results, and files beside it.
struct Out {
    test::Temporary folder;
    fs::path path = folder / "out";

    [[nodiscard]] fs::path operator/(const char* name) const { return path / name; }
    [[nodiscard]] nlohmann::json metrics() const { return nlohmann::json::parse(read_file(path / "metrics.json")); }
    [[nodiscard]] AvatarData avatar() const { return load_avatar(path / "avatar.gsh"); }
    [[nodiscard]] std::string avatar_bytes() const { return read_file(path / "avatar.gsh"); }
};

test::Outcome reconstruct(const Out& out, const std::vector<std::string>& more, const fs::path& capture = {}) {
    return run(studio().reconstruct(out.path, more, capture));
}
std::vector<std::string> animate(const Out& out, const char* name = "frames") {
    return {"gsh-animate", (out / "avatar.gsh").string(), "--poses", studio().dance.string(), "--size", "64",
            "--out",       (out.folder / name).string()};
}

std::vector<std::uint8_t> column(const PixelImage& picture, int first, int width) {
    std::vector<std::uint8_t> pixels;
    for (int y = 0; y < picture.height; ++y)
        for (int x = first; x < first + width; ++x)
            pixels.insert(pixels.end(), picture.pixel(y, x), picture.pixel(y, x) + 3);
    return pixels;
}

/// A project of COLMAP: a person seen by ten pinhole cameras, in two folders of five, with masks in both naming schemes
/// and points on the skin.
struct ColmapProject {
    test::Temporary folder;
    fs::path path = folder / "project";
    std::vector<std::string> names; ///< of the images, without ".png", in order
    Capture capture;
    std::vector<vec3<double>> points;

    ColmapProject() {
        const BodyModel& body = studio().body;
        const Motion motion = actor_motion(ActorMotion::talk, 1);
        StudioParams ring;
        ring.train_cameras = 10, ring.test_cameras = 0, ring.image_size = 48, ring.samples = 4;
        cpu::Threads backend;
        capture = film(backend, body, motion, ring);
        test::ColmapFiles files;
        for (const std::size_t i : {7, 3, 0, 9, 1, 8, 2, 6, 5, 4}) {
            const Camera<double>& c = capture.cameras[i].camera;
            const auto id = static_cast<std::uint32_t>(20 + i);
            files.cameras.push_back({id, 1, "PINHOLE", 48, 48, {c.fx, c.fy, c.cx, c.cy}});
            files.images.push_back({id, quat_from_rotation(c.R), c.t, id, name_of(i) + ".png"});
        }
        const auto vertices = test::posed_vertices(body, motion, 0);
        for (std::size_t v = 0; v < vertices.size(); v += 20) {
            points.push_back(vertices[v]);
            files.points.push_back({v, vertices[v], {200, 150, 100}});
        }
        fs::create_directories(path / "sparse/0");
        files.write_binary(path / "sparse/0");
        for (std::size_t i = 0; i < 10; ++i) {
            names.push_back(name_of(i));
            for (const char* kind : {"images", "masks"}) fs::create_directories((path / kind / names[i]).parent_path());
            write_png(path / "images" / (names[i] + ".png"), test::colors_of(capture.images[i]));
            write_png(path / "masks" / (names[i] + (i < 5 ? ".png" : ".png.png")), test::mask_of(capture.images[i]));
        }
    }
    static std::string name_of(std::size_t i) { return (i < 5 ? "left/" : "right/") + std::to_string(i); }
};

} // namespace

TEST_CASE("the baseline's avatar moves with 22 joints, also by poses of all 55") {
    const Out baseline, all;
    check_done(reconstruct(baseline, {"--steps", "3", "--config", "baseline"}));
    CHECK(baseline.metrics().at("configuration").get<std::string>().starts_with("baseline"));
    CHECK(baseline.metrics().at("settings").at("heads") == "separate");
    CHECK(baseline.metrics().at("settings").at("joints") == "trunk_and_limbs");
    const AvatarData avatar = baseline.avatar();
    CHECK(avatar.rig.joint_count() == 22);
    CHECK(avatar.filter.dilation == 0.3);
    CHECK(avatar.gaussians.size() == 1500);
    const test::Outcome frames = run(animate(baseline));
    INFO(frames.err);
    CHECK(frames.code == 0);
    CHECK(test::files_below(baseline.folder / "frames") == 3);

    check_done(reconstruct(all, {"--steps", "3", "--config", "baseline-x"}));
    CHECK(all.avatar().rig.joint_count() == 55);
    CHECK(!all.avatar().ao.empty());
    check_done(run(animate(all)));
}

TEST_CASE("a file of settings is what the same settings are on the command line") {
    const Out file, words, other;
    const fs::path mine = file.folder / "mine.json";
    write_file(mine, R"({"configuration": "no-ao", "mlp.width": 32, "rate.sh": 1e-3, "prior.depth": false})");
    check_done(reconstruct(file, {"--steps", "3", "--config", mine.string()}));
    CHECK(file.metrics().at("configuration").get<std::string>().starts_with("mine"));
    const auto settings = file.metrics().at("settings");
    CHECK(settings.at("ao") == "none");
    CHECK(settings.at("mlp.width") == "32");
    CHECK(settings.at("hash.table_size") == "4096"); // --set overrides the file
    CHECK(file.avatar().ao.empty());

    check_done(reconstruct(words, {"--steps", "3", "--config", "no-ao", "--set", "mlp.width=32", "--set",
                                   "rate.sh=0.001", "--set", "prior.depth=false"}));
    CHECK(words.metrics().at("settings") == settings);
    CHECK(words.metrics()
              .at("configuration")
              .get<std::string>()
              .ends_with("mlp.width=32 rate.sh=0.001 prior.depth=false"));
    CHECK(words.avatar_bytes() == file.avatar_bytes());
    check_done(reconstruct(other, {"--steps", "3", "--config", "no-ao", "--set", "mlp.width=32"}));
    CHECK(other.avatar_bytes() != file.avatar_bytes());

    // The page shows the file's name, and the checkpoint stores the settings.
    CHECK(read_file(file / "report.html") == test::contains("mine"));
    check_refused(reconstruct(file, {"--steps", "4", "--config", "no-ao", "--resume"}), "gsh-reconstruct",
                  {"checkpoint.gsh", "a different run"});
    check_done(reconstruct(file, {"--steps", "4", "--config", mine.string(), "--resume"}));
    CHECK(file.metrics().at("steps") == 4);
}

TEST_CASE("refinement leaves refined poses, says so, and resumes") {
    const Out out, plain;
    const fs::path capture = out.folder / "capture";
    fs::copy(studio().path, capture, fs::copy_options::recursive);
    Motion noisy = studio().capture.motion;
    test::Rng rng(5);
    for (auto& angle : noisy.pose) angle += rng.vec(-0.05, 0.05);
    save_motion(capture / "poses_noisy.npz", noisy);
    const std::vector<std::string> words{"--poses", "poses_noisy.npz", "--refine", "--no-registration"};
    const auto with = [&](std::vector<std::string> more) {
        more.insert(more.begin(), words.begin(), words.end());
        return more;
    };
    check_done(reconstruct(out,
                           with({"--steps", "3", "--set", "refine.pose.start=1", "--set", "refine.transl.start=1",
                                 "--set", "refine.expression.start=1"}),
                           capture));
    // Poses that start to learn at the end of the run do not change.
    CHECK(load_motion(out / "poses_refined.npz", studio().body).pose == noisy.pose);
    CHECK(out.metrics().at("protocol").get<std::string>() == test::contains("poses_noisy.npz, refined in training"));
    check_done(reconstruct(plain, {"--poses", "poses_noisy.npz", "--steps", "3"}, capture));
    CHECK(!fs::exists(plain / "poses_refined.npz"));
    CHECK(plain.metrics().at("protocol").get<std::string>() == test::contains("as given, not refined"));
    CHECK(out.avatar_bytes() == plain.avatar_bytes());             // test images have no influence on the avatar
    CHECK(out.metrics().at("psnr") != plain.metrics().at("psnr")); // but on the poses in which it is evaluated

    const Out moved;
    check_done(reconstruct(moved, with({"--steps", "20"}), capture));
    check_done(reconstruct(moved, with({"--steps", "40", "--resume"}), capture));
    CHECK(moved.metrics().at("steps") == 40);
    const Motion refined = load_motion(moved / "poses_refined.npz", studio().body);
    CHECK(refined.pose != noisy.pose);
    CHECK(refined.betas == noisy.betas); // off
    CHECK(refined.frame_count() == 2);
    check_refused(reconstruct(moved, with({"--steps", "50", "--refine-cameras", "--resume"}), capture),
                  "gsh-reconstruct", {"checkpoint.gsh"});
    check_refused(reconstruct(moved, with({"--steps", "50", "--set", "refine.betas.rate=1e-3", "--resume"}), capture),
                  "gsh-reconstruct", {"checkpoint.gsh"});
    check_done(reconstruct(plain, with({"--steps", "3", "--refine-cameras", "--set", "refine.test_steps=0"}), capture));
    CHECK(plain.metrics().at("protocol").get<std::string>() == test::contains("refined in training, not fitted"));

    // The fit of test poses shows its progress. A signal ends it within a frame, and earlier results stay.
    const std::string before = moved.avatar_bytes();
    test::Process process(
        studio().reconstruct(moved.path, with({"--steps", "3", "--set", "refine.test_steps=1000000000"}), capture));
    REQUIRE(process.wait_until([&] { return process.err().find("fitting test poses") != std::string::npos; }));
    process.send(SIGINT);
    const test::Outcome outcome = process.wait();
    CHECK(outcome.code == 130);
    CHECK(moved.avatar_bytes() == before);
}

TEST_CASE("registration moves poses and shape before training, says so, and comes again with --resume") {
    const Out out, again;
    const fs::path capture = out.folder / "capture";
    fs::copy(studio().path, capture, fs::copy_options::recursive);
    Motion noisy = studio().capture.motion;
    for (auto& angle : noisy.pose) angle += vec3<double>(0.05, -0.05, 0.05);
    save_motion(capture / "poses_noisy.npz", noisy);
    const auto refined = [&](const Out& to, std::vector<std::string> more) {
        more.insert(more.begin(), {"--poses", "poses_noisy.npz", "--refine"});
        return reconstruct(to, more, capture);
    };
    const test::Outcome outcome = refined(out, {"--steps", "4"});
    check_done(outcome);
    CHECK(outcome.out == test::contains("registration: the registered bodies explain the photographs to"));
    const auto metrics = out.metrics();
    CHECK(metrics.at("protocol").get<std::string>() == test::contains("registered to the training images"));
    const auto& registration = metrics.at("registration");
    CHECK(registration.at("people").at(0).at("joints_mm") > 1.0);
    CHECK(registration.at("frame_fit").size() == noisy.frame_count());
    CHECK(registration.at("psnr") > 15.0);
    CHECK(registration.at("focal").is_null()); // two cameras
    CHECK(read_file(out / "report.html") == test::contains("registered bodies"));
    CHECK(load_motion(out / "poses_refined.npz", studio().body).pose != noisy.pose);

    check_done(refined(again, {"--steps", "2"}));
    check_done(refined(again, {"--steps", "4", "--resume"}));
    CHECK(again.metrics().at("registration") == registration); // the same bits
    check_refused(refined(again, {"--steps", "5", "--resume", "--no-registration"}), "gsh-reconstruct",
                  {"checkpoint.gsh", "not registered"});
    check_refused(refined(again, {"--steps", "5", "--resume", "--fine-registration"}), "gsh-reconstruct",
                  {"checkpoint.gsh", "fine registration"});
    check_refused(reconstruct(again, {"--steps", "5", "--fine-registration"}, capture), "gsh-reconstruct",
                  {"--fine-registration", "--refine"});
    check_refused(reconstruct(again, {"--steps", "5", "--no-registration"}, capture), "gsh-reconstruct",
                  {"--no-registration", "--refine"});
}

namespace {

/// Six frames before two cameras with keypoints in the layout of OpenPose. The photographs of frame 3 are upside down.
struct SpoiltTurn {
    static constexpr std::size_t wrong_frame = 3;
    test::Temporary folder;
    fs::path path = folder / "capture";

    SpoiltTurn() {
        cpu::Threads backend;
        StudioParams ring;
        ring.train_cameras = 2, ring.test_cameras = 1, ring.image_size = 64, ring.samples = 4;
        const BodyModel& body = studio().body;
        const Motion motion = actor_motion(ActorMotion::talk, 6);
        Capture capture = film(backend, body, motion, ring);
        const std::vector<vec3<double>> joints = motion_joints(body, motion);
        // Shoulder, elbow, wrist of the right arm and of the left, knee and ankle: of BODY_25, and of SMPL-X.
        constexpr std::array<std::array<std::size_t, 2>, 10> numbers{
            {{2, 17}, {3, 19}, {4, 21}, {5, 16}, {6, 18}, {7, 20}, {10, 5}, {11, 8}, {13, 4}, {14, 7}}};
        for (std::size_t c = 0; c < 2; ++c) {
            const NamedCamera& named = capture.cameras[c];
            fs::create_directories(folder / "capture/keypoints" / named.name);
            for (std::size_t t = 0; t < motion.frame_count(); ++t) {
                std::vector<double> points(75, 0);
                for (const auto& [point, joint] : numbers) {
                    const vec2<double> pixel =
                        to_pixel(named.camera, to_camera(named.camera, joints[t * motion.joint_count + joint]));
                    points[3 * point] = pixel.x, points[3 * point + 1] = pixel.y, points[3 * point + 2] = 0.9;
                }
                nlohmann::json person{{"pose_keypoints_2d", points}};
                write_file(folder / "capture/keypoints" / named.name / ("00" + std::to_string(t) + "_keypoints.json"),
                           nlohmann::json{{"people", {person}}}.dump());
            }
            PixelImage& image = capture.images[c * motion.frame_count() + wrong_frame];
            for (std::size_t a = 0, b = image.data.size() - 4; a < b; a += 4, b -= 4)
                for (std::size_t k = 0; k < 4; ++k) std::swap(image.data[a + k], image.data[b + k]);
        }
        save_capture(path, capture);
    }
};

} // namespace

TEST_CASE("a run with keypoints and a doubted frame resumes with the same bits, and names the frame") {
    const SpoiltTurn scene;
    const Out whole, parts;
    const auto words = [&](const Out& out, std::vector<std::string> more = {}) {
        more.insert(more.begin(), {"--refine", "--keypoints", "keypoints", "--steps", "60"});
        return studio().reconstruct(out.path, more, scene.path);
    };
    const auto check_finished = [](const test::Outcome& outcome) {
        INFO(outcome.err);
        CHECK(outcome.code == 0);
        CHECK(outcome.err == test::contains("warning: frames 3 fit clearly worse"));
        CHECK(outcome.out == test::contains("with keypoints in 12 photographs"));
    };
    check_finished(run(words(whole)));
    test::Process process(words(parts));
    REQUIRE(process.wait_until([&] { return process.err().find("step 1 ") != std::string::npos; }));
    process.send(SIGINT);
    CHECK(process.wait().code == 130);
    check_finished(run(words(parts, {"--resume"})));
    CHECK(whole.avatar_bytes() == parts.avatar_bytes());
    CHECK(read_file(whole / "poses_refined.npz") == read_file(parts / "poses_refined.npz"));
    const auto registration = whole.metrics().at("registration");
    CHECK(parts.metrics().at("registration") == registration);
    CHECK(registration.at("doubtful_frames") == std::vector<std::size_t>{SpoiltTurn::wrong_frame});
    for (std::size_t t = 0; t < 6; ++t)
        CHECK((registration.at("frame_weights").at(t) < 0.25) == (t == SpoiltTurn::wrong_frame));
    check_finished(reconstruct(parts, {"--resume"}, scene.path)); // keypoints and steps are those of the checkpoint
    // Keypoints that were found in images of half the size, or are scaled to 0…1.
    for (const double scale : {0.5, 1.0 / 32}) { // the second after the first
        for (const auto& file : list_files_below(scene.path / "keypoints")) {
            auto json = nlohmann::json::parse(read_file(file));
            auto& points = json["people"][0]["pose_keypoints_2d"];
            for (std::size_t k = 0; k < points.size(); ++k)
                if (k % 3 != 2) points[k] = points[k].get<double>() * scale;
            write_file(file, json.dump());
        }
        check_refused(run(words(whole)), "gsh-reconstruct",
                      {"keypoints", scale == 0.5 ? "0.50 times as far" : "not pixels, but scaled to 0"});
    }
}

TEST_CASE("regions of the user's decide where Gaussians and fine levels go") {
    const Out usual, painted;
    const auto& vertices = studio().body.v_template;
    double ground = 0;
    for (const auto& vertex : vertices) ground = std::min(ground, vertex.y);
    nlohmann::json regions;
    for (const auto& vertex : vertices) regions["importance"].push_back(vertex.y < ground + 0.2 ? 1 : 0); // the feet
    write_file(painted.folder / "regions.json", regions.dump());
    const std::vector<std::string> words{"--steps", "1", "--set", "region.samples_high=60"};
    check_done(reconstruct(usual, words));
    auto more = words;
    more.insert(more.end(), {"--regions", (painted.folder / "regions.json").string()});
    check_done(reconstruct(painted, more));
    const auto feet = [&](const Out& out) {
        const auto means = out.avatar().gaussians.means;
        return std::count_if(means.begin(), means.end(), [&](const auto& p) { return p.y < ground + 0.2; });
    };
    CHECK(feet(painted) > 2 * feet(usual));
    CHECK(painted.metrics().at("psnr_regions").contains("hands"));

    more.push_back("--resume");
    check_done(reconstruct(painted, more));
    regions["importance"][0] = 0.5;
    write_file(painted.folder / "regions.json", regions.dump());
    check_refused(reconstruct(painted, more), "gsh-reconstruct", {"checkpoint.gsh", "a different run", "'regions "});
}

TEST_CASE("a person before a plate is trained and judged over it") {
    const Out out;
    const fs::path capture = out.folder / "capture";
    Capture filmed = studio().capture;
    for (std::size_t c = 0; c < filmed.cameras.size(); ++c) {
        PixelImage plate(4, 64, 64);
        for (std::size_t i = 0; i < plate.data.size(); ++i)
            plate.data[i] = static_cast<std::uint8_t>(i % 4 == 3 ? 255 : 40 + 60 * c + i / 256);
        filmed.backgrounds.push_back(plate);
    }
    save_capture(capture, filmed);
    check_done(reconstruct(out, {"--steps", "3"}, capture));
    CHECK(out.metrics().at("protocol").get<std::string>() == test::contains("the capture's backgrounds"));
    const PixelImage picture = read_image(out.path / "test" / "test00_0000.png");
    REQUIRE(picture.width == 3 * 64);
    const PixelImage& plate = filmed.backgrounds[2];
    for (int y = 0; y < 64; ++y) // a column at the edge, without a person: render, photograph, no error
        for (int c = 0; c < 3; ++c) {
            CHECK(picture.pixel(y, 0)[c] == plate.pixel(y, 0)[c]);
            CHECK(picture.pixel(y, 64)[c] == plate.pixel(y, 0)[c]);
            CHECK(picture.pixel(y, 128)[c] == 0);
        }
    CHECK(column(picture, 64, 64) != column(plate, 0, 64)); // the person is there
}

TEST_CASE("with weights there is LPIPS, and it says which") {
    const Out out;
    test::SafetensorsFile file;
    const LpipsNetwork network = test::with_noise(lpips_alexnet());
    std::size_t convolution = 0, inputs = 3, slice = 0;
    for (const LpipsStep& step : network.steps) {
        if (step.is_convolution()) {
            const std::string name = "features." + std::to_string(step.number);
            const std::string channels = std::to_string(step.channels), kernel = std::to_string(step.kernel);
            file.add(name + ".weight", channels + ", " + std::to_string(inputs) + ", " + kernel + ", " + kernel,
                     network.convolutions[convolution].weight);
            file.add(name + ".bias", channels, network.convolutions[convolution++].bias);
            inputs = static_cast<std::size_t>(step.channels);
        }
        if (step.compared)
            file.add("lin" + std::to_string(slice) + ".model.1.weight", "1, " + std::to_string(inputs) + ", 1, 1",
                     network.lins[slice]),
                ++slice;
    }
    file.write(out.folder / "lpips.safetensors");
    const auto words = [&](const char* name) {
        return std::vector<std::string>{"--steps", "2", "--lpips", (out.folder / name).string()};
    };
    check_done(reconstruct(out, words("lpips.safetensors")));
    CHECK(out.metrics().at("lpips") > 0.0);
    CHECK(out.metrics().at("images")[1].at("lpips") > 0.0);
    CHECK(out.metrics().at("protocol").get<std::string>() == test::contains("LPIPS"));
    const Out table;
    auto as_in_tables = words("lpips.safetensors");
    as_in_tables.push_back("--lpips-table");
    check_done(reconstruct(table, as_in_tables));
    CHECK(table.metrics().at("psnr") == out.metrics().at("psnr"));
    CHECK(table.metrics().at("lpips") != out.metrics().at("lpips"));
    CHECK(table.metrics().at("protocol") != out.metrics().at("protocol"));

    const Out none;
    write_file(out.folder / "broken.safetensors", "no weights");
    check_refused(reconstruct(none, words("missing.safetensors")), "gsh-reconstruct", {"missing.safetensors"});
    check_refused(reconstruct(none, words("broken.safetensors")), "gsh-reconstruct", {"broken.safetensors"});
    CHECK(!fs::exists(none.path));
}

TEST_CASE("static: one frame as a scene of its own, without a body or poses") {
    const test::SmallCapture& s = studio();
    const Out out, again;
    const fs::path capture = out.folder / "capture";
    fs::copy(s.path, capture, fs::copy_options::recursive);
    fs::remove(capture / "poses.npz");
    const auto words = [&](const Out& to, std::vector<std::string> more) {
        more.insert(more.begin(), {"gsh-reconstruct", "--capture", capture.string(), "--config", "static", "--out",
                                   to.path.string(), "--gaussians", "1500"});
        return more;
    };
    check_done(run(words(out, {"--steps", "40", "--frame", "1"})));
    const auto metrics = out.metrics();
    CHECK(metrics.at("configuration") == "static");
    CHECK(metrics.at("steps") == 40);
    CHECK(metrics.at("gaussians") <= 1500);
    CHECK(metrics.at("psnr") > 10.0);
    CHECK(metrics.at("protocol").get<std::string>() == test::contains("capture, frame 1 (1 images, 2 in training)"));
    REQUIRE(metrics.at("images").size() == 1);
    CHECK(fs::exists(out.path / "test" / "test00.png"));
    CHECK(read_gaussian_ply(out / "scene.ply").size() == metrics.at("gaussians"));
    CHECK(test::files_below(out.path) == 3);
    check_done(run({"gsh-render", (out / "scene.ply").string(), "--camera", s.camera.string(), "--out",
                    (out.folder / "a.png").string()}));
    check_done(run(words(again, {"--steps", "40", "--frame", "1", "--threads", "1"})));
    CHECK(read_file(again / "scene.ply") == read_file(out / "scene.ply"));
    for (const char* key : {"peak_memory_bytes", "threads", "seconds"}) CHECK(metrics.at(key) > 0);
    CHECK(metrics.at("backend") == "threads");
    CHECK(metrics.at("ms_per_stage").at("all") > 0);
    CHECK(metrics.at("settings").at("sh_degree") == "3");

    // Settings given on the command line and in a file.
    const Out set, file;
    check_done(run(words(set, {"--steps", "40", "--frame", "1", "--set", "density.stop=0", "--set", "sh_degree=1"})));
    CHECK(set.metrics().at("cloned") == 0);
    CHECK(set.metrics().at("split") == 0);
    CHECK(read_file(set / "scene.ply") != read_file(out / "scene.ply"));
    write_file(file.folder / "sparse.json", R"({"configuration": "static", "density.stop": 0, "sh_degree": 1})");
    std::vector<std::string> by_file = words(file, {"--steps", "40", "--frame", "1"});
    *std::find(by_file.begin(), by_file.end(), "static") = (file.folder / "sparse.json").string();
    check_done(run(by_file));
    CHECK(read_file(file / "scene.ply") == read_file(set / "scene.ply"));

    const Out none;
    check_refused(run(words(none, {"--frame", "2"})), "gsh-reconstruct", {"images of 2 frames", "frame 2"});
    check_refused(run(words(none, {"--resume"})), "gsh-reconstruct", {"static", "--resume"});
    check_refused(run(words(none, {"--refine"})), "gsh-reconstruct", {"static", "--refine"});
    check_refused(run(words(none, {"--seconds", "3"})), "gsh-reconstruct", {"static", "--steps"});
    check_refused(run(words(none, {"--set", "ao=none"})), "gsh-reconstruct", {"no setting 'ao'"});
    for (const char* option : {"--lpips", "--regions", "--poses"})
        check_refused(run(words(none, {option, "file"})), "gsh-reconstruct", {"static", option});
    check_refused(run({"gsh-reconstruct", "--synthetic", "--config", "static", "--out", none.path.string()}),
                  "gsh-reconstruct", {"static"});
    fs::remove(capture / "cameras.json");
    check_refused(run(words(none, {})), "gsh-reconstruct", {"sparse"}); // the folder should then be COLMAP's
    CHECK(!fs::exists(none.path));
}

TEST_CASE("static: COLMAP's points are trained on its images, every eighth of which is left to judge by") {
    const ColmapProject project;
    const Out out;
    check_done(run({"gsh-reconstruct", "--capture", project.path.string(), "--config", "static", "--out",
                    out.path.string(), "--steps", "4", "--gaussians", "1500"}));
    const auto metrics = out.metrics();
    CHECK(metrics.at("protocol").get<std::string>().starts_with("Test views of project (2 images, 8 in training)"));
    for (const char* figure : {"psnr", "ssim", "psnr_person"}) CHECK(metrics.at(figure).is_number());
    REQUIRE(metrics.at("images").size() == 2);
    CHECK(test::files_below(out.path) == 4); // two pictures, the scene, the figures
    for (const std::size_t held : {0, 8}) {
        const std::string name = held == 0 ? "left_0" : "right_8";
        const auto& figures = metrics.at("images")[held / 8];
        CHECK(figures.at("name") == name);
        CHECK(figures.at("psnr") > 5.0);
        // The photograph, in the middle of the picture, is white outside the mask.
        const PixelImage picture = read_image(out.path / "test" / (name + ".png")),
                         &photo = project.capture.images[held];
        REQUIRE(picture.width == 3 * 48);
        int wrong = 0;
        for (int y = 0; y < 48; ++y)
            for (int x = 0; x < 48; ++x)
                for (int c = 0; c < 3; ++c)
                    wrong += picture.pixel(y, 48 + x)[c] != (photo.pixel(y, x)[3] > 127 ? photo.pixel(y, x)[c] : 255);
        CHECK(wrong == 0);
    }
    // After four steps all Gaussians are near the points that they started from.
    const auto scene = read_gaussian_ply(out / "scene.ply");
    REQUIRE(scene.size() == project.points.size());
    CHECK(metrics.at("gaussians") == scene.size());
    double farthest = 0;
    for (std::size_t i = 0; i < scene.size(); ++i)
        farthest = std::max(farthest, length(vec3<double>(scene.means[i]) - project.points[i]));
    CHECK(farthest < 0.02);
}

TEST_CASE("configurations, settings and lists that cannot be are refused before any work") {
    const Out none;
    const auto refuse = [&](std::vector<std::string> more, std::initializer_list<std::string_view> said) {
        INFO(more.back());
        more.insert(more.end(), {"--steps", "1"});
        check_refused(reconstruct(none, more), "gsh-reconstruct", said);
        CHECK(!fs::exists(none.path));
    };
    refuse({"--config", "papper"}, {"no configuration 'papper'", "paper, baseline"});
    refuse({"--config", (none.folder / "none.json").string()}, {"none.json", "No such file"});
    const fs::path file = none.folder / "mine.json";
    const auto refuse_file = [&](const char* text, std::initializer_list<std::string_view> said) {
        write_file(file, text);
        refuse({"--config", file.string()}, said);
    };
    refuse_file("{\"ao\": \"time\",", {"mine.json"});
    refuse_file("[]", {"mine.json", "JSON object"});
    refuse_file(R"({"configuration": "papper"})", {"no configuration 'papper'"});
    refuse_file(R"({"aoo": "time"})", {"mine.json", "no setting 'aoo'"});
    refuse_file(R"({"ao": "space"})", {"mine.json", "ao is 'space'", "none, time, pose"});

    refuse({"--set", "fine_levels"}, {"--set fine_levels", "key=value"});
    refuse({"--set", "=3"}, {"--set", "no setting ''"});
    refuse({"--set", "rate.shh=1"}, {"--set", "no setting 'rate.shh'"});
    refuse({"--set", "rate.sh="}, {"rate.sh", "expected a number"});
    refuse({"--set", "rate.sh=fast"}, {"rate.sh is 'fast'", "expected a number"});
    refuse({"--set", "rate.sh=inf"}, {"rate.sh", "finite"});
    refuse({"--set", "hash_sh=1"}, {"hash_sh is '1'", "true or false"});
    // Numbers without a meaning for the setting.
    for (const char* setting : {"mlp.width=0",        "mlp.width=-8",       "mlp.hidden_layers=-1",
                                "hash.base=0",        "hash.growth=0.5",    "hash.table_size=1000",
                                "hash.table_size=0",  "hash.fine_level=17", "ao.table_size=3",
                                "ao.initial=0",       "ao.initial=7",       "ao.largest=0.5",
                                "ao.start=-1",        "initial_opacity=1",  "bounds_margin=0",
                                "rate.sh=-1",         "rate.final=-1",      "ssim_weight=2",
                                "filter.dilation=-1", "region.sigma=0",     "region.samples_base=-1",
                                "prior.depth_unit=0"})
        refuse({"--set", setting}, {});
    for (const char* setting :
         {"refine.pose.rate=-1", "refine.betas.start=-1", "refine.test_mask_weight=-1", "refine.final=0"})
        refuse({"--refine", "--set", setting}, {});
    refuse({"--refine-cameras"}, {"--refine-cameras needs --refine"});
    refuse({"--regions", (none.folder / "regions.json").string()}, {"regions.json", "No such file"});
    write_file(none.folder / "regions.json", R"({"high": [99999999]})");
    refuse({"--regions", (none.folder / "regions.json").string()}, {"regions.json", "high"});
}
