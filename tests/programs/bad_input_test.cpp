// SPDX-License-Identifier: Apache-2.0
/// @file  Bad input: programs print one clear line, exit with 2 and leave no partial output.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/splat/ply.hpp>

#include <nlohmann/json.hpp>

#include <unistd.h>

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_refused;
using test::NpzEdit;
using test::run;
namespace fs = std::filesystem;

namespace {

/// One capture, one avatar and one scene for all tests here.
struct Unspoilt : test::SmallCapture {
    fs::path avatar = folder / "avatar.gsh", scene = folder / "scene.ply";

    Unspoilt() {
        const test::Temporary out;
        const test::Outcome outcome = run(reconstruct(out / "out", {"--steps", "1"}));
        REQUIRE(outcome.code == 0);
        fs::rename(out / "out" / fs::path("avatar.gsh"), avatar);
        fs::rename(out / "out" / fs::path("avatar.ply"), scene);
    }
};
Unspoilt& unspoilt() {
    static Unspoilt instance;
    return instance;
}

using Words = std::initializer_list<std::string_view>;
using Edit = std::function<void(const fs::path&)>;

/// Damages a copy of the capture's folder. The reconstruction must be refused and leave no files.
void refuse_capture(Words words, const Edit& spoil) {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    fs::copy(s.path, folder / "capture", fs::copy_options::recursive);
    spoil(folder / "capture");
    check_refused(run(s.reconstruct(folder / "out", {"--steps", "1"}, folder / "capture")), "gsh-reconstruct", words);
    CHECK(!fs::exists(folder / "out"));
}

/// The same with a copy of the body file.
void refuse_body(Words words, const Edit& spoil) {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    fs::copy(s.body_file, folder / "body.npz");
    spoil(folder / "body.npz");
    check_refused(run(s.reconstruct(folder / "out", {"--steps", "1"}, {}, folder / "body.npz")), "gsh-reconstruct",
                  words);
    CHECK(!fs::exists(folder / "out"));
}

/// The same with a copy of one of gsh-render's inputs.
void refuse_render(const fs::path& input, Words words, const Edit& spoil, std::vector<std::string> more = {}) {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    const fs::path copy = folder / input.filename().string();
    fs::copy(input, copy);
    spoil(copy);
    std::vector<std::string> arguments{"gsh-render", (input == s.camera ? s.scene : copy).string(),
                                       "--camera",   (input == s.camera ? copy : s.camera).string(),
                                       "--out",      (folder / "a.png").string(),
                                       "--npy",      (folder / "a.npy").string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    check_refused(run(arguments), "gsh-render", words);
    CHECK(folder.file_count() <= 1); // the input
}

/// The same with a copy of gsh-animate's motion.
void refuse_animate(Words words, const Edit& spoil) {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    fs::copy(s.dance, folder / "dance.npz");
    spoil(folder / "dance.npz");
    check_refused(run({"gsh-animate", s.avatar.string(), "--poses", (folder / "dance.npz").string(), "--out",
                       (folder / "out").string()}),
                  "gsh-animate", words);
    CHECK(!fs::exists(folder / "out"));
}

Edit truncate(std::size_t bytes) {
    return [bytes](const fs::path& path) { test::truncate_file(path, bytes); };
}
Edit write(const std::string& text) {
    return [text](const fs::path& path) { write_file(path, text); };
}
const auto missing = [](const fs::path& path) { fs::remove(path); };

/// Changes cameras.json, or one camera's file, as JSON.
Edit json(const std::function<void(nlohmann::ordered_json&)>& change) {
    return [change](const fs::path& path) {
        auto content = nlohmann::ordered_json::parse(read_file(path));
        change(content);
        write_file(path, content.dump());
    };
}
/// Changes the JSON of the capture's second camera.
Edit second_camera(const std::function<void(nlohmann::ordered_json&)>& change) {
    const Edit edit = json([change](auto& content) { change(content["cameras"][1]); });
    return [edit](const fs::path& capture) { edit(capture / "cameras.json"); };
}
Edit member(const std::string& key, const std::string& npy, bool deflate = false) {
    return [=](const fs::path& path) { NpzEdit(path).replace(key, npy, deflate); };
}
Edit poses(const Edit& edit) {
    return [edit](const fs::path& capture) { edit(capture / "poses.npz"); };
}
Edit image(const Edit& edit) {
    return [edit](const fs::path& capture) { edit(capture / "images/cam01/0001.png"); };
}

std::string doubles(const std::string& shape, const std::vector<double>& numbers) {
    return test::npy_bytes("<f8", shape, test::bytes_of(numbers));
}

} // namespace

TEST_CASE("options that make no sense") {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](std::vector<std::string> words, Words said) {
        check_refused(run(words), words[0], said);
        CHECK(!fs::exists(out));
    };
    refuse({"gsh-reconstruct"}, {"--out", "--help"});
    refuse({"gsh-reconstruct", "--out", out, "--frobnicate"}, {"--frobnicate"});
    refuse({"gsh-reconstruct", "--out", out}, {"--capture and --body"});
    refuse({"gsh-reconstruct", "--out", out, "--capture", s.path}, {"--capture and --body"});
    refuse({"gsh-reconstruct", "--out", out, "--capture", s.path, "--body"}, {"--body"});
    refuse({"gsh-reconstruct", "--out", out, "--synthetic", "--body", s.body_file}, {"--synthetic"});
    refuse({"gsh-reconstruct", "--out", out, "--synthetic", "--poses", "poses_noisy.npz"}, {"--poses"});
    const auto refuse_with = [&](std::vector<std::string> more, Words said) { refuse(s.reconstruct(out, more), said); };
    refuse_with({"--steps", "3", "--seconds", "3"}, {"--steps", "--seconds"});
    refuse_with({"--steps", "many"}, {"--steps", "many"});
    refuse_with({"--steps", "-3"}, {"--steps"});
    refuse_with({"--steps", "0"}, {"--steps", "above 0"});
    refuse_with({"--steps", "2.5"}, {"--steps", "2.5"});
    refuse_with({"--seconds", "-1"}, {"--seconds"});
    refuse_with({"--seconds", "nan"}, {"--seconds"});
    refuse_with({"--threads", "-1"}, {"--threads"});
    refuse_with({"--threads", "1000000000"}, {"--threads"});
    refuse_with({"--seed", "-1"}, {"--seed"});
    refuse_with({"--max-memory", "-1"}, {"--max-memory"});
    refuse_with({"--frame", "1"}, {"--frame", "static"});
    refuse_with({"--resume"}, {"checkpoint.gsh", "nothing to resume"});
    refuse_with({"--poses", "poses_noisy.npz"}, {"poses_noisy.npz", "No such file"});

    refuse({"gsh-render", s.scene, "--out", out}, {"--camera"});
    refuse({"gsh-render", s.scene, "--camera", s.camera, "--out", out, "--background", "1", "nan", "0"},
           {"--background", "'nan'"});
    refuse({"gsh-render", s.scene, "--camera", s.camera, "--out", out, "--poses", s.dance}, {"--poses", ".gsh"});
    refuse({"gsh-render", s.scene, "--camera", s.camera, "--out", out, "--camera-name", "cam07"},
           {"camera.json", "cam07"});
    refuse({"gsh-render", s.scene, "--camera", s.camera, "--out", out / "a.png"}, {"out/a.png", "No such file"});
    refuse({"gsh-render", s.avatar, "--camera", s.camera, "--out", out, "--frame", "1"}, {"--frame 1", "--poses"});
    refuse({"gsh-render", s.avatar, "--camera", s.camera, "--out", out, "--poses", s.dance, "--frame", "3"},
           {"--frame 3", "dance.npz", "3 frames"});
    refuse({"gsh-render", s.scene, "--camera", s.camera, "--out", out / "a.jpg"}, {"a.jpg", "PNG"});
    refuse({"gsh-animate", s.avatar, "--out", out}, {"--poses"});
    refuse({"gsh-animate", s.scene, "--poses", s.dance, "--out", out}, {"scene.ply", "not an avatar"});
    refuse({"gsh-animate", s.avatar, "--poses", s.dance, "--out", out, "--size", "0"}, {"--size"});

    write_file(folder / "file", "in the way");
    refuse(s.reconstruct(folder / "file", {"--steps", "1"}), {"file", "cannot be created"});
    refuse(s.reconstruct(folder / "file/out", {"--steps", "1"}), {"file/out", "cannot be created"});
    refuse({"gsh-animate", s.avatar, "--poses", s.dance, "--out", folder / "file"}, {"file", "cannot be created"});
}

TEST_CASE("bodies that are none") {
    const Unspoilt& s = unspoilt();
    const std::size_t V = s.body.vertex_count(), J = s.body.joint_count();
    const std::string rows = std::to_string(V), joints = std::to_string(J);
    refuse_body({"body.npz", "No such file"}, missing);
    refuse_body({"body.npz"}, truncate(5000));
    refuse_body({"body.npz"}, write("no archive"));
    refuse_body({"body.npz", "v_template", "missing"},
                [](const fs::path& path) { NpzEdit(path).remove("v_template"); });
    refuse_body(
        {"body.npz", "weights", "<i8"},
        member("weights", test::npy_bytes("<i8", "(" + rows + ", " + joints + ")", std::string(8 * V * J, '\0'))));
    refuse_body({"body.npz", "weights", "pickled"}, member("weights", test::npy_bytes("|O", "(1,)", "\x80\x04N.")));
    std::vector<double> weights(s.body.weights);
    refuse_body({"body.npz", "weights", "expected (" + rows + ", " + joints + ")"},
                member("weights", doubles("(" + joints + ", " + rows + ")", weights)));
    weights[7 * J] += 0.25;
    refuse_body({"body.npz", "weights", "7"}, member("weights", doubles("(" + rows + ", " + joints + ")", weights)));
    std::vector<std::int64_t> tree(2 * J);
    for (std::size_t j = 0; j < J; ++j) tree[j] = s.body.parents[j], tree[J + j] = static_cast<std::int64_t>(j);
    tree[1] = 4, tree[4] = 1;
    refuse_body({"body.npz", "cycle"},
                member("kintree_table", test::npy_bytes("<i8", "(2, " + joints + ")", test::bytes_of(tree))));
    std::vector<double> vertices(3 * V, 0.5);
    vertices[3 * 11 + 2] = std::numeric_limits<double>::quiet_NaN();
    refuse_body({"body.npz", "v_template[11, 2]", "NaN"}, member("v_template", doubles("(" + rows + ", 3)", vertices)));
    // Archive bombs: a header that claims more than there is, and zeros that inflate a thousandfold.
    refuse_body({"body.npz", "v_template"}, member("v_template", doubles("(4000000000, 3)", {1, 2, 3})));
    const std::size_t directions = (std::size_t(80) << 20) / (24 * V);
    refuse_body({"body.npz", "shapedirs"},
                member("shapedirs",
                       test::npy_bytes("<f8", "(" + rows + ", 3, " + std::to_string(directions) + ")",
                                       std::string(24 * V * directions, '\0')),
                       true));
}

TEST_CASE("captures whose parts do not belong together") {
    const Unspoilt& s = unspoilt();
    refuse_capture({"capture", "not a folder"}, [](const fs::path& path) { fs::remove_all(path); });
    refuse_capture({"cameras.json", "is missing"}, [](const fs::path& path) { fs::remove(path / "cameras.json"); });
    refuse_capture({"cameras.json", "truncated"},
                   [](const fs::path& path) { test::truncate_file(path / "cameras.json", 300); });
    refuse_capture({"cameras.json", "cam01", "K is missing"}, second_camera([](auto& camera) { camera.erase("K"); }));
    refuse_capture({"cameras.json", "cam01", "width"}, second_camera([](auto& camera) { camera["width"] = "64"; }));
    refuse_capture({"cameras.json", "cam01", "K", "singular"},
                   second_camera([](auto& camera) { camera["K"][1][1] = 0; }));
    refuse_capture({"cameras.json", "cam01", "R"}, second_camera([](auto& camera) { camera["R"][0][0] = 3; }));
    refuse_capture({"cam01/0000.png", "64 x 64", "64 x 65"},
                   second_camera([](auto& camera) { camera["height"] = 65; }));

    refuse_capture({"poses.npz", "No such file"}, poses(missing));
    refuse_capture({"poses.npz"}, poses(truncate(200)));
    refuse_capture({"poses.npz", "transl", "missing"},
                   poses([](const fs::path& path) { NpzEdit(path).remove("transl"); }));
    refuse_capture({"poses.npz", "transl", "<i4"},
                   poses(member("transl", test::npy_bytes("<i4", "(2, 3)", std::string(24, '\0')))));
    refuse_capture({"poses.npz", "body_pose has 60 numbers"}, poses([](const fs::path& path) {
                       NpzEdit(path).replace("body_pose", doubles("(2, 60)", std::vector<double>(120)));
                   }));
    refuse_capture(
        {"poses.npz", "transl[1, 0]", "NaN"},
        poses(member("transl", doubles("(2, 3)", {0, 0, 0, std::numeric_limits<double>::quiet_NaN(), 0, 0}))));
    refuse_capture({"images/cam00", "2 images", "expected 3", "poses.npz"}, [&](const fs::path& path) {
        fs::copy(s.dance, path / "poses.npz", fs::copy_options::overwrite_existing);
    });

    refuse_capture({"images/cam01", "2 images with a gap", "go from 0 to 5"},
                   image([](const fs::path& path) { fs::rename(path, path.parent_path() / "0005.png"); }));
    refuse_capture({"cam01/0001.png", "truncated"}, image(truncate(100)));
    refuse_capture({"cam01/0001.png", "not a PNG"}, image(write("no picture")));
    refuse_capture({"cam01/0001.png", "48 x 64"},
                   image([](const fs::path& path) { write_png(path, PixelImage(4, 64, 48)); }));
    // Photographs without a person are left out; a capture without any other is refused.
    refuse_capture({"cam00/0000.png", "mask (alpha) is empty", "all photographs"}, [](const fs::path& path) {
        for (const auto& entry : fs::recursive_directory_iterator(path / "images"))
            if (entry.path().extension() == ".png") write_png(entry.path(), PixelImage(4, 64, 64));
    });
}

TEST_CASE("cameras and scenes that cannot be rendered") {
    const Unspoilt& s = unspoilt();
    refuse_render(s.camera, {"camera.json", "No such file"}, missing);
    refuse_render(s.camera, {"camera.json", "truncated"}, truncate(30));
    refuse_render(s.camera, {"camera.json", "K", "singular"}, json([](auto& camera) { camera["K"][0][0] = 0; }));
    refuse_render(s.camera, {"camera.json", "t has 2 numbers"}, json([](auto& camera) { camera["t"].erase(0); }));
    refuse_render(s.camera, {"camera.json", "width x height"},
                  json([](auto& camera) { camera["width"] = camera["height"] = 60000; }));

    const auto header = [](const char* from, const std::string& to) {
        return [=](const fs::path& path) {
            std::string text = read_file(path);
            const std::size_t place = text.find(from);
            REQUIRE(place != std::string::npos);
            write_file(path, text.replace(place, std::string_view(from).size(), to));
        };
    };
    refuse_render(s.scene, {"scene.ply", "No such file"}, missing);
    refuse_render(s.scene, {"scene.ply", "truncated"}, truncate(100));
    refuse_render(s.scene, {"scene.ply", "not a PLY"}, write("no scene"));
    refuse_render(s.scene, {"scene.ply", "rot_2"}, header("float rot_2", "float rotten"));
    refuse_render(s.scene, {"scene.ply", "absurd"}, header("vertex 1500", "vertex 4000000000000000000"));
    refuse_render(s.scene, {"scene.ply", "f_rest"}, header("float f_rest_44", "float last"));
    // The file's last number is NaN.
    refuse_render(s.scene, {"scene.ply", "vertex 1499", "nan"}, [](const fs::path& path) {
        const float nan = std::numeric_limits<float>::quiet_NaN();
        write_file(path, read_file(path).replace(fs::file_size(path) - 4, 4, reinterpret_cast<const char*>(&nan), 4));
    });

    refuse_render(s.avatar, {"avatar.gsh", "No such file"}, missing);
    refuse_render(s.avatar, {"avatar.gsh"}, truncate(1000));
    refuse_render(s.avatar, {"avatar.gsh", "gsh_format"},
                  [](const fs::path& path) { NpzEdit(path).remove("gsh_format"); });
    refuse_render(s.avatar, {"avatar.gsh", "sh"}, [](const fs::path& path) { NpzEdit(path).remove("sh"); });
    const std::string expected = "avatar " + std::to_string(avatar_file_version);
    refuse_render(s.avatar, {"avatar.gsh", expected},
                  [&](const fs::path& path) { fs::copy(s.body_file, path, fs::copy_options::overwrite_existing); });
}

TEST_CASE("motions that do not fit the avatar") {
    const Unspoilt& s = unspoilt();
    refuse_animate({"dance.npz", "No such file"}, missing);
    refuse_animate({"dance.npz"}, truncate(50));
    refuse_animate({"dance.npz", "global_orient", "missing"},
                   [](const fs::path& path) { NpzEdit(path).remove("global_orient"); });
    refuse_animate({"dance.npz", "jaw_pose", "(2, 3)"}, member("jaw_pose", doubles("(2, 3)", std::vector<double>(6))));
    refuse_animate(
        {"dance.npz", "transl"},
        member("transl", doubles("(3, 3)", std::vector<double>(9, std::numeric_limits<double>::infinity()))));
    refuse_animate({"dance.npz"},
                   [&](const fs::path& path) { fs::copy(s.camera, path, fs::copy_options::overwrite_existing); });
}

TEST_CASE("a PLY is read by name") {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    const GaussianCloud<float> cloud = read_gaussian_ply(s.scene);
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    std::vector<std::string> names{"opacity", "rot_3", "rot_2", "rot_1", "rot_0", "z", "confidence"};
    for (std::size_t i = 3 * (basis - 1); i-- > 0;) names.push_back("f_rest_" + std::to_string(i));
    for (const char* name : {"scale_2", "f_dc_2", "y", "scale_0", "f_dc_0", "x", "scale_1", "f_dc_1"})
        names.emplace_back(name);
    std::string text = "ply\nformat binary_little_endian 1.0\ncomment gsh.filter dilation 0.1 compensated\n"
                       "element vertex " +
                       std::to_string(cloud.size()) + "\n"; // the filter of the avatar's own file
    for (const std::string& name : names) text += "property double " + name + "\n";
    text += "end_header\n";
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        std::vector<double> row{cloud.opacity_logits[i],
                                cloud.quats[i].z,
                                cloud.quats[i].y,
                                cloud.quats[i].x,
                                cloud.quats[i].w,
                                cloud.means[i].z,
                                0.5};
        const vec3<float>* sh = &cloud.sh[i * basis];
        for (int channel = 3; channel-- > 0;)
            for (std::size_t k = basis; k-- > 1;) row.push_back(sh[k][channel]);
        for (const float x : {cloud.log_scales[i].z, sh[0].z, cloud.means[i].y, cloud.log_scales[i].x, sh[0].x,
                              cloud.means[i].x, cloud.log_scales[i].y, sh[0].y})
            row.push_back(x);
        text += test::bytes_of(row);
    }
    write_file(folder / "reordered.ply", text);
    const auto picture = [&](const fs::path& scene) {
        const fs::path npy = folder / "a.npy";
        test::check_done(run({"gsh-render", scene, "--camera", s.camera, "--out", folder / "a.png", "--npy", npy}));
        return read_file(npy);
    };
    CHECK(picture(folder / "reordered.ply") == picture(s.scene));
}

TEST_CASE("a folder that another program writes is refused, and nothing in it changes") {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const LockedFolder held(out);
    fs::create_directories(out / "results.partial");
    write_file(out / "results.partial/metrics.json", "of the first");
    const std::string process = out.string() + ": process " + std::to_string(::getpid());
    check_refused(run(s.reconstruct(out, {"--steps", "1"})), "gsh-reconstruct", {process, "is writing there"});
    check_refused(run({"gsh-animate", s.avatar, "--poses", s.dance, "--out", out}), "gsh-animate", {process});
    check_refused(run({"gsh-check", s.path, "--body", s.body_file, "--out", out}), "gsh-check", {process});
    check_refused(run({"gsh-evaluate", "--capture", s.path, "--body", s.body_file, "--configs", "paper", "--steps", "1",
                       "--out", out}),
                  "gsh-evaluate", {process});
    CHECK(test::files_below(out) == 2);
    CHECK(read_file(out / "results.partial/metrics.json") == "of the first");
    const AtomicFile picture(folder / "a.png");
    check_refused(run({"gsh-render", s.scene, "--camera", s.camera, "--out", folder / "a.png"}), "gsh-render",
                  {(folder / "a.png").string() + ": another process"});
}

TEST_CASE("a disk that fills up leaves what was there, and nothing else") {
    const Unspoilt& s = unspoilt();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto last_line = [](const std::string& text) {
        return text.substr(text.size() < 2 ? 0 : text.rfind('\n', text.size() - 2) + 1);
    };
    const auto large = s.reconstruct(out, {"--steps", "1", "--set", "schedule.stored=1"}); // a checkpoint with tables
    test::Outcome outcome = run(large, "ulimit -f 2000 && exec");
    CHECK(outcome.code == 2);
    CHECK(last_line(outcome.err).starts_with("gsh-reconstruct: " + (out / "checkpoint.gsh").string()));
    CHECK(outcome.err == test::contains("File too large"));
    CHECK(!fs::exists(out));

    // The results of an earlier run stay unchanged.
    fs::create_directories(out);
    write_file(out / "metrics.json", "{}");
    outcome = run(large, "ulimit -f 2000 && exec");
    CHECK(outcome.code == 2);
    CHECK(test::files_below(out) == 1);
    CHECK(read_file(out / "metrics.json") == "{}");

    // If one result cannot be written, none is. The checkpoint is kept.
    write_file(out / "test", "in the way of test/*.png");
    outcome = run(s.reconstruct(out, {"--steps", "1"}));
    CHECK(outcome.code == 2);
    CHECK(last_line(outcome.err).starts_with("gsh-reconstruct: " + (out / "test").string() + ": cannot be created"));
    CHECK(test::files_below(out) == 3);
    CHECK(fs::exists(out / "checkpoint.gsh"));
    CHECK(read_file(out / "metrics.json") == "{}");

    outcome =
        run({"gsh-render", s.scene, "--camera", s.camera, "--out", folder / "a.png", "--npy", folder / "a.npy"},
            "ulimit -f 20 && exec");
    check_refused(outcome, "gsh-render", {"a.npy", "File too large"});
    CHECK(folder.file_count() == 0);
    outcome = run({"gsh-render", s.scene, "--camera", s.camera, "--out", folder / "a.png"}, "ulimit -f 1 && exec");
    check_refused(outcome, "gsh-render", {"a.png", "File too large"});
    CHECK(folder.file_count() == 0);
    outcome = run({"gsh-animate", s.avatar, "--poses", s.dance, "--out", folder / "frames"}, "ulimit -f 2 && exec");
    CHECK(outcome.code == 2);
    CHECK(last_line(outcome.err).starts_with("gsh-animate: "));
    CHECK(!fs::exists(folder / "frames"));
}
