// SPDX-License-Identifier: Apache-2.0
/// gsh-export as a user runs it: each format drawn again against the avatar, sequences, moving files, refused input.
#include "io/glb_json.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"
#include "support/skip.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/any_splats.hpp>

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::Outcome;
using test::run;
namespace fs = std::filesystem;

namespace {

/// A lit avatar and its motion of three frames.
struct ExportedActor {
    test::Temporary folder;
    fs::path avatar = folder / "out/avatar.gsh", scene = folder / "scene.ply", dance = test::studio().dance;

    ExportedActor() {
        check_done(run(test::studio().reconstruct(folder / "out", {"--steps", "20"})));
        check_done(make(avatar, "scene.ply"));
    }

    [[nodiscard]] Outcome make(const fs::path& input, const std::string& to, std::vector<std::string> more = {}) const {
        std::vector<std::string> words{"gsh-export", input.string(), "--to", (folder / to).string()};
        words.insert(words.end(), more.begin(), more.end());
        return run(words);
    }
    [[nodiscard]] NpyArray<float> draw(const fs::path& what, std::vector<std::string> more = {}) const {
        std::vector<std::string> words{"gsh-render",
                                       what.string(),
                                       "--camera",
                                       test::studio().camera.string(),
                                       "--background",
                                       "1",
                                       "1",
                                       "1",
                                       "--out",
                                       (folder / "a.png").string(),
                                       "--npy",
                                       (folder / "a.npy").string()};
        words.insert(words.end(), more.begin(), more.end());
        check_done(run(words));
        return read_npy<float>(folder / "a.npy");
    }
    [[nodiscard]] GaussianCloud<float> cloud() const { return load_any_splats(scene).cloud; }
    /// Decibels between two pictures, with colours up to 1.
    [[nodiscard]] static double psnr(const NpyArray<float>& a, const NpyArray<float>& b) {
        REQUIRE(a.size() == b.size());
        double sum = 0;
        for (std::size_t i = 0; i < a.size(); ++i) {
            const double d = std::min(a[i], 1.0f) - std::min(b[i], 1.0f);
            sum += d * d;
        }
        return -10 * std::log10(sum / static_cast<double>(a.size()));
    }
};
const ExportedActor& exported_actor() {
    static const ExportedActor instance;
    return instance;
}

/// Python with a module, or an empty text.
std::string python_with(const std::string& module) {
    return std::system(("python3 -c 'import " + module + "' >/dev/null 2>&1").c_str()) == 0 ? "python3" : "";
}

} // namespace

TEST_CASE("a file is written through a link, into a pipe and into a device") {
    const ExportedActor& s = exported_actor();
    const std::string expected = read_file(s.scene);
    write_file(s.folder / "linked.ply", "old");
    fs::create_symlink("linked.ply", s.folder / "link.ply");
    const Outcome linked = s.make(s.avatar, "link.ply");
    check_done(linked);
    CHECK(linked.out == test::contains(" MB\n"));
    CHECK(fs::is_symlink(s.folder / "link.ply"));
    CHECK(read_file(s.folder / "linked.ply") == expected);
    CHECK(!fs::is_symlink(s.folder / "linked.ply"));

    // Neither of these has a size, and both stay what they are.
    const fs::path pipe = s.folder / "pipe.ply", copy = s.folder / "copy.ply", nothing = s.folder / "nothing.ply";
    REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
    const Outcome piped = run({"gsh-export", s.avatar.string(), "--to", pipe.string()},
                              "timeout 20 cat '" + pipe.string() + "' >'" + copy.string() + "' & timeout 20");
    check_done(piped);
    CHECK(piped.out == pipe.string() + ": 1500 Gaussians\n");
    for (int tries = 0; tries < 100 && fs::file_size(copy) < expected.size(); ++tries) // cat ends by itself
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    CHECK(read_file(copy) == expected);
    CHECK(fs::is_fifo(pipe));
    fs::create_symlink("/dev/null", nothing);
    const Outcome lost = s.make(s.avatar, "nothing.ply");
    check_done(lost);
    CHECK(lost.out == nothing.string() + ": 1500 Gaussians\n");
    CHECK(fs::is_character_file(nothing));

    fs::create_symlink("missing/a.ply", s.folder / "nowhere.ply");
    check_refused(s.make(s.avatar, "nowhere.ply"), "gsh-export", {"nowhere.ply", "cannot be created"});
    CHECK(fs::is_symlink(s.folder / "nowhere.ply"));
}

TEST_CASE("each still format of a posed frame is drawn like the avatar itself") {
    const ExportedActor& s = exported_actor();
    const std::vector<std::string> posed{"--poses", s.dance.string(), "--frame", "1"};
    const auto truth = s.draw(s.avatar, posed);
    struct Case {
        const char* file;
        double least; // decibels
        std::vector<std::string> more = {};
    };
    // SPZ names a filter only roughly, and .splat none; the pictures differ by that.
    for (const Case& c : {Case{"a.ply", 45},
                          {"b.ply", 45, {"--up", "y"}},
                          {"a.glb", 45},
                          {"a.compressed.ply", 38},
                          {"a.spz", 30},
                          {"b.spz", 30, {"--spz", "4"}},
                          {"c.ply", 30, {"--sh", "0"}}}) {
        INFO(std::string(c.file));
        std::vector<std::string> words = posed;
        words.insert(words.end(), c.more.begin(), c.more.end());
        const Outcome outcome = s.make(s.avatar, c.file, words);
        check_done(outcome);
        CHECK(outcome.out == test::contains("1500 Gaussians"));
        CHECK(s.psnr(s.draw(s.folder / c.file), truth) > c.least);
    }
    // What the pose changes is seen.
    check_done(s.make(s.avatar, "rest.ply"));
    CHECK(s.psnr(s.draw(s.folder / "rest.ply"), truth) < 30);
    CHECK(s.psnr(s.draw(s.folder / "rest.ply"), s.draw(s.avatar)) > 45);
    // A .splat file says what it loses, and is y down.
    Outcome outcome = s.make(s.avatar, "a.splat", posed);
    CHECK(outcome.code == 0);
    CHECK(outcome.err.find("warning: ") == 0);
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
    const StillSplats splat = load_any_splats(s.folder / "a.splat"), ply = load_any_splats(s.folder / "a.ply");
    double height_splat = 0, height_ply = 0;
    for (const auto& mean : splat.cloud.means) height_splat += mean.y;
    for (const auto& mean : ply.cloud.means) height_ply += mean.y;
    CHECK(height_splat == doctest::Approx(-height_ply).epsilon(1e-3));
    // USD text is complete.
    check_done(s.make(s.avatar, "a.usda", posed));
    CHECK(read_file(s.folder / "a.usda").ends_with("    }\n}\n"));
}

TEST_CASE("the PLY that gsh-reconstruct writes is y down for others and upright for gsh") {
    const ExportedActor& s = exported_actor();
    const fs::path scene = s.folder / "out/avatar.ply";
    const std::string bytes = read_file(scene);
    CHECK(bytes == test::contains("comment gsh.up -y\n"));
    CHECK(bytes == test::contains("comment gsh.filter dilation 0.1 compensated\n"));
    CHECK(s.psnr(s.draw(scene), s.draw(s.avatar)) > 25); // the mean light is not that of the pose
}

TEST_CASE("scenes are converted, in the frame of their format") {
    const ExportedActor& s = exported_actor();
    const auto truth = s.draw(s.scene);
    for (const char* to : {"s.glb", "s.spz", "s.compressed.ply", "s2.ply"}) {
        INFO(std::string(to));
        check_done(s.make(s.scene, to));
        CHECK(s.psnr(s.draw(s.folder / to), truth) > 30);
    }
    check_done(s.make(s.folder / "s.glb", "s3.ply"));
    CHECK(s.psnr(s.draw(s.folder / "s3.ply"), truth) > 60);
    // A PLY that states nothing is y down by custom: a .glb of it stands upright, a PLY of it is as it was.
    std::string bytes = read_file(s.scene);
    bytes.replace(bytes.find("gsh.up"), 6, "xxx.up");
    write_file(s.folder / "plain.ply", bytes);
    bytes.replace(bytes.find("gsh.axes"), 8, "xxx.axes");
    write_file(s.folder / "plain.ply", bytes);
    check_done(s.make(s.folder / "plain.ply", "plain.glb"));
    const vec3<float> there = load_any_splats(s.folder / "plain.glb").cloud.means[0],
                      here = load_any_splats(s.folder / "plain.ply").cloud.means[0];
    CHECK(there == vec3<float>(here.x, -here.y, -here.z)); // half a turn about x
    check_done(s.make(s.scene, "few.ply", {"--largest", "100", "--sh", "1"}));
    CHECK(load_any_splats(s.folder / "few.ply").cloud.size() == 100);
    CHECK(load_any_splats(s.folder / "few.ply").cloud.sh_degree == 1);
    check_done(s.make(s.scene, "merged.ply", {"--gaussians", "100"}));
    CHECK(load_any_splats(s.folder / "merged.ply").cloud.size() == 100);
    check_done(s.make(s.avatar, "merged.gsh", {"--gaussians", "120"}));
    check_done(s.make(s.folder / "merged.gsh", "all.ply"));
    CHECK(load_any_splats(s.folder / "all.ply").cloud.size() == 120);
}

namespace {

/// Five Gaussians in a PLY that states nothing but the comment, and the first mean of what becomes of it.
GaussianCloud<float> five_gaussians() {
    GaussianCloud<float> cloud(5, 0);
    for (std::size_t i = 0; i < 5; ++i) {
        cloud.means[i] = {static_cast<float>(i), 2, 3};
        cloud.log_scales[i] = vec3<float>(-3);
        cloud.opacity_logits[i] = 2;
    }
    return cloud;
}
void write_with_comment(const fs::path& path, const GaussianCloud<float>& cloud, const std::string& comment) {
    write_gaussian_ply(path, cloud, {.pad_to_degree = 0});
    std::string bytes = read_file(path);
    write_file(path, bytes.insert(bytes.find("element"), "comment " + comment + "\n"));
}

} // namespace

TEST_CASE("a scene's vertical is the one that is given, else the one that it states, else that of the custom") {
    const test::Temporary folder;
    const fs::path scene = folder / "scene.ply";
    const auto mean_of = [&](const std::string& to, std::vector<std::string> more = {}) {
        std::vector<std::string> words{"gsh-export", scene.string(), "--to", (folder / to).string()};
        words.insert(words.end(), more.begin(), more.end());
        check_done(run(words));
        return load_any_splats(folder / to).cloud.means[1];
    };
    const auto cloud = five_gaussians();
    write_with_comment(scene, cloud, "nothing");
    for (const char* to : {"a.spz", "a.glb", "b.ply"}) CHECK(mean_of(to) == vec3<float>(1, -2, -3));
    CHECK(mean_of("a.splat") == vec3<float>(1, 2, 3)); // stored with y down, and read as stored
    CHECK(mean_of("a.glb", {"--input-up", "y"}) == vec3<float>(1, 2, 3));
    CHECK(mean_of("a.glb", {"--input-up", "z"}) == vec3<float>(1, 3, -2));
    CHECK(mean_of("a.glb", {"--input-up", "-x"}) == vec3<float>(2, -1, 3));
    write_with_comment(scene, cloud, "Vertical Axis: z");
    CHECK(mean_of("a.glb") == vec3<float>(1, 3, -2));
    CHECK(mean_of("a.glb", {"--input-up", "-y"}) == vec3<float>(1, -2, -3));
    check_refused(run({"gsh-export", scene.string(), "--to", (folder / "a.spz").string(), "--input-up", "up"}),
                  "gsh-export", {"--input-up"});
    check_refused(
        run({"gsh-export", exported_actor().avatar.string(), "--to", (folder / "a.spz").string(), "--input-up", "z"}),
        "gsh-export", {"--input-up", "avatar"});
    // gsh-render draws a given vertical in the same way as a file that states it.
    const auto picture = [&](const fs::path& what, std::vector<std::string> more) {
        std::vector<std::string> words{"gsh-render", what.string(),
                                       "--camera",   test::studio().camera.string(),
                                       "--out",      (folder / "a.png").string(),
                                       "--npy",      (folder / "a.npy").string()};
        words.insert(words.end(), more.begin(), more.end());
        CHECK(run(words).code == 0);
        return read_npy<float>(folder / "a.npy");
    };
    write_with_comment(scene, exported_actor().cloud(), "nothing");
    write_gaussian_ply(folder / "stated.ply", exported_actor().cloud(), {.pad_to_degree = 0, .up = UpAxis::y});
    CHECK(exported_actor().psnr(picture(scene, {"--input-up", "y"}), picture(folder / "stated.ply", {})) > 100);
}

TEST_CASE("what a format cannot hold is told with numbers") {
    const test::Temporary folder;
    const fs::path scene = folder / "scene.ply";
    const auto warning_of = [&](const GaussianCloud<float>& cloud, const std::string& to) {
        write_gaussian_ply(scene, cloud, {.pad_to_degree = 0, .up = UpAxis::y});
        const Outcome outcome = run({"gsh-export", scene.string(), "--to", (folder / to).string()});
        CHECK(outcome.code == 0);
        return outcome.err;
    };
    auto cloud = five_gaussians();
    CHECK(warning_of(cloud, "a.spz").empty());
    CHECK(warning_of(cloud, "a.compressed.ply").empty());
    cloud.means[1] = {3000, 0, -9000}, cloud.log_scales[2] = {8, -12, 7}, cloud.sh[3].x = 5;
    const std::string spz = warning_of(cloud, "a.spz");
    for (const char* words : {"in steps of 0.00195312", "1 of 5 Gaussians have a scale beyond e^-10 to e^5.94",
                              "1 of 5 Gaussians have a colour beyond -0.44 to 1.44"})
        CHECK(spz == test::contains(words));
    double least = 1e30; // in any order
    for (const vec3<float>& mean : load_any_splats(folder / "a.spz").cloud.means)
        least = std::min<double>(least, length(mean - vec3<float>(3000, 0, -9000)));
    CHECK(least < 1e-2);
    CHECK(warning_of(cloud, "a.splat") == test::contains("1 of 5 Gaussians have a colour beyond 0 to 1"));
    cloud.means[1].x = 3e8f;
    CHECK(warning_of(cloud, "a.spz") == test::contains("1 of 5 Gaussians lie farther out"));
    CHECK(warning_of(cloud, "a.compressed.ply") == test::contains("invisible Gaussians"));
}

TEST_CASE("scenes that cannot be used are refused with their names") {
    const test::Temporary folder;
    const fs::path scene = folder / "scene.ply";
    write_gaussian_ply(scene, GaussianCloud<float>(0, 0));
    for (const char* to : {"a.ply", "a.compressed.ply", "a.spz", "a.splat", "a.glb", "a.usda", "a.html"})
        check_refused(run({"gsh-export", scene.string(), "--to", (folder / to).string()}), "gsh-export",
                      {"scene.ply: holds no Gaussians"});
    const auto render = [&] {
        return run({"gsh-render", scene.string(), "--camera", test::studio().camera.string(), "--out",
                    (folder / "a.png").string()});
    };
    check_refused(render(), "gsh-render", {"scene.ply: holds no Gaussians"});
    write_gaussian_ply(scene, five_gaussians(), {.up = UpAxis::y});
    std::string bytes = read_file(scene);
    const float large = 90;
    std::memcpy(bytes.data() + bytes.find("end_header\n") + 11 + 2 * 62 * 4 + 55 * 4, &large, 4);
    write_file(scene, bytes);
    const Outcome outcome = render();
    check_refused(outcome, "gsh-render", {"scene.ply: scale_0 of vertex 2 is 90"});
    CHECK(outcome.err != test::contains("learning"));
}

TEST_CASE("frames become a folder of numbered files, whole or not at all") {
    const ExportedActor& s = exported_actor();
    for (const char* ending : {".ply", ".compressed.ply", ".spz", ".splat"}) {
        INFO(std::string(ending));
        const std::string name = std::string("walk") + ending;
        const Outcome outcome = s.make(s.avatar, name, {"--poses", s.dance.string(), "--frames", "0:2:2"});
        CHECK(outcome.code == 0);
        CHECK(outcome.out == test::contains("2 files"));
        CHECK(test::files_below(s.folder / "walk") == 2); // the files of the format before are replaced
        for (const char* number : {"0000", "0001"})
            CHECK(fs::exists(s.folder / ("walk/frame_" + std::string(number) + ending)));
        CHECK(!fs::exists(s.folder / "walk.partial"));
    }
    // One order of Gaussians: each moves little from frame to frame.
    check_done(s.make(s.avatar, "order.compressed.ply", {"--poses", s.dance.string(), "--frames", "0:1"}));
    const auto first = load_any_splats(s.folder / "order/frame_0000.compressed.ply").cloud,
               second = load_any_splats(s.folder / "order/frame_0001.compressed.ply").cloud;
    double far = 0;
    for (std::size_t i = 0; i < first.size(); ++i) far += length(first.means[i] - second.means[i]) > 0.8f;
    CHECK(far < 0.01 * static_cast<double>(first.size()));

    write_file(s.folder / "order/notes.txt", "mine");
    check_refused(s.make(s.avatar, "order.ply", {"--poses", s.dance.string(), "--frames", "0:1"}), "gsh-export",
                  {"order", "notes.txt"});
    CHECK(test::files_below(s.folder / "order") == 3);
    // On a full disk nothing remains.
    CHECK(run({"gsh-export", s.avatar.string(), "--to", (s.folder / "full.ply").string(), "--poses", s.dance.string(),
               "--frames", "0:2"},
              "ulimit -f 200 && exec")
              .code == 2);
    CHECK(!fs::exists(s.folder / "full"));
    CHECK(!fs::exists(s.folder / "full.partial"));
}

TEST_CASE("a moving .glb shows each frame at its time; a mesh has bones") {
    const ExportedActor& s = exported_actor();
    const Motion motion = load_motion(s.dance, test::studio().body);
    check_done(s.make(s.avatar, "m.glb", {"--poses", s.dance.string(), "--frames", "0:2", "--clusters", "128"}));
    for (std::size_t f = 0; f < 3; ++f)
        CHECK(
            s.psnr(s.draw(s.folder / "m.glb", {"--time", std::to_string(motion.timestamps[f] - motion.timestamps[0])}),
                   s.draw(s.avatar, {"--poses", s.dance.string(), "--frame", std::to_string(f)})) > 28);
    check_done(s.make(s.avatar, "mesh.glb", {"--mesh", "--poses", s.dance.string(), "--frames", "0:2"}));
    const auto mesh = test::json_of_glb(s.folder / "mesh.glb");
    CHECK(mesh["skins"].size() == 1);
    CHECK(mesh["animations"].size() == 1);
    CHECK(mesh["meshes"][0]["primitives"][0]["targets"].size() == 10);
    check_done(s.make(s.avatar, "m.usda", {"--poses", s.dance.string(), "--frames", "0:2"}));
    CHECK(read_file(s.folder / "m.usda") == test::contains("endTimeCode = 2"));
}

TEST_CASE("a compact avatar is small and moves like the exact one") {
    const ExportedActor& s = exported_actor();
    check_done(s.make(s.avatar, "compact.gsh"));
    CHECK(fs::file_size(s.folder / "compact.gsh") < fs::file_size(s.avatar) / 2);
    const std::vector<std::string> posed{"--poses", s.dance.string(), "--frame", "2"};
    CHECK(s.psnr(s.draw(s.folder / "compact.gsh", posed), s.draw(s.avatar, posed)) > 45);
    check_done(s.make(s.folder / "compact.gsh", "again.ply", posed));
}

TEST_CASE("options that do not fit are refused with one line") {
    const ExportedActor& s = exported_actor();
    const std::size_t before = test::files_below(s.folder / "");
    const auto refuse = [&](const fs::path& input, const std::string& to, std::vector<std::string> more,
                            std::initializer_list<std::string_view> words) {
        check_refused(s.make(input, to, std::move(more)), "gsh-export", words);
    };
    const std::string dance = s.dance.string();
    refuse(s.avatar, "x.obj", {}, {"x.obj", "unknown ending", ".spz"});
    refuse(s.folder / "none.gsh", "x.ply", {}, {"none.gsh", "No such file"});
    refuse(s.folder / "none.ply", "x.glb", {}, {"none.ply", "No such file"});
    refuse(s.avatar, "x.ply", {"--frame", "1"}, {"--frame", "--poses"});
    refuse(s.avatar, "x.ply", {"--poses", dance, "--frame", "3"}, {"--frame 3", "3 frames"});
    refuse(s.avatar, "x.ply", {"--poses", dance, "--frame", "0", "--frames", "0:1"}, {"--frames", "excludes"});
    for (const char* frames : {"1", "a:b", "0:", "0:1:0", "2:1", "0:3", "0:1:1:1", "-1:2"})
        refuse(s.avatar, "x.ply", {"--poses", dance, "--frames=" + std::string(frames)}, {"--frames"});
    refuse(s.avatar, "x.ply", {"--joint-map", "map.json"}, {"--joint-map", "--poses"});
    refuse(s.avatar, "x.ply", {"--poses", dance, "--joint-map", "none.json"}, {"none.json", "No such file"});
    refuse(s.avatar, "x.spz", {"--up", "y"}, {"--up", "y up"});
    refuse(s.avatar, "x.ply", {"--spz", "3"}, {"--spz", ".spz"});
    refuse(s.avatar, "x.spz", {"--spz", "2"}, {"--spz"});
    refuse(s.avatar, "x.ply", {"--sh", "4"}, {"--sh"});
    refuse(s.avatar, "x.ply", {"--largest", "0"}, {"--largest"});
    refuse(s.avatar, "x.ply", {"--gaussians", "0"}, {"--gaussians"});
    refuse(s.avatar, "x.ply", {"--gaussians", "9", "--largest", "9"}, {"--gaussians", "--largest"});
    refuse(s.avatar, "x.glb", {"--clusters", "9"}, {"--clusters", "--frames"});
    refuse(s.avatar, "x.ply", {"--mesh"}, {"--mesh", ".glb"});
    refuse(s.avatar, "x.gsh", {"--poses", dance}, {"no pose"});
    refuse(s.scene, "x.gsh", {}, {"avatar (.gsh)"});
    refuse(s.scene, "x.glb", {"--poses", dance}, {"--poses", "avatar"});
    refuse(s.scene, "x.glb", {"--mesh"}, {"--mesh", "avatar"});
    refuse(s.scene, "scene.ply", {}, {"input itself"});
    refuse(s.avatar, "no/such/x.ply", {}, {"x.ply", "No such file"});
    CHECK(test::files_below(s.folder / "") == before);
}

TEST_CASE("other libraries read the files, where they are installed") {
    const ExportedActor& s = exported_actor();
    const auto check = [&](const char* module, const std::string& program) {
        const std::string python = python_with(module);
        if (python.empty()) {
            test::skip(std::string("there is no python3 with ") + module);
            return;
        }
        write_file(s.folder / "check.py", program);
        INFO(std::string(module));
        CHECK(std::system((python + " " + (s.folder / "check.py").string()).c_str()) == 0);
    };
    const auto path = [&](const char* name) { return "'" + (s.folder / name).string() + "'"; };
    check_done(s.make(s.avatar, "o.usda"));
    check("pxr", "from pxr import Usd\nstage = Usd.Stage.Open(" + path("o.usda") +
                     ")\np = stage.GetPrimAtPath('/Avatar/Splats')\n"
                     "assert p.GetTypeName() == 'ParticleField3DGaussianSplat'\n"
                     "assert len(p.GetAttribute('positions').Get()) == 1500\n");
    check_done(s.make(s.avatar, "o.glb", {"--mesh"}));
    check("pygltflib", "import pygltflib\ng = pygltflib.GLTF2().load(" + path("o.glb") +
                           ")\nassert len(g.skins) == 1\nassert g.accessors[0].type == 'VEC3'\n");
    check_done(s.make(s.avatar, "o.ply"));
    check("gsply", "import gsply\nassert len(gsply.plyread(" + path("o.ply") + ").means) == 1500\n");
}
