// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/motion/any_motion.hpp>

#include "io/bvh_files.hpp"
#include "io/gltf_files.hpp"
#include "io/npz_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"
#include "support/skeleton_body.hpp"

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

TEST_CASE("motions are known by their members or their folder") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(24, 3, 0), smplx = test::small_body(55, 3, 2);
    const auto write = [&](const char* name, const std::vector<std::pair<const char*, std::size_t>>& members) {
        NpzWriter file(folder / name);
        for (const auto& [key, width] : members) file.add(key, std::vector<double>(2 * width, 0.125), {2, width});
        file.add("betas", std::vector<double>(3, 0.0));
        file.commit();
        return folder / name;
    };
    const auto amass = write("amass.npz", {{"poses", 72}, {"trans", 3}});
    CHECK(recognise_motion(amass) == MotionLayout::amass);
    CHECK(load_any_motion(amass, body).pose[3].x == 0.125);
    const auto split = write("split.npz", {{"root_orient", 3}, {"pose_body", 63}, {"trans", 3}});
    CHECK(recognise_motion(split) == MotionLayout::amass);
    CHECK(load_any_motion(split, smplx).pose[3].x == 0.125);
    const auto snapshot = write("snapshot.npz", {{"thetas", 72}, {"transl", 3}});
    CHECK(recognise_motion(snapshot) == MotionLayout::snapshot);
    CHECK(load_any_motion(snapshot, body).timestamps[1] == doctest::Approx(1 / 30.0));
    const auto fits = write("fits.npz", {{"global_orient", 3}, {"body_pose", 63}, {"camera_translation", 3}});
    CHECK(recognise_motion(fits) == MotionLayout::smplifyx);
    CHECK(load_any_motion(fits, smplx).transl[0].x == doctest::Approx(0.125));
    save_motion(folder / "ours.npz", test::still_motion(body, 3));
    CHECK(recognise_motion(folder / "ours.npz") == MotionLayout::gsh);
    CHECK(load_any_motion(folder / "ours.npz", body).pose == test::still_motion(body, 3).pose);

    const detail::Json none = detail::Json::array({0, 0, 0}), person = {{"id", 0},
                                                                        {"Rh", none},
                                                                        {"Th", none},
                                                                        {"poses", std::vector<double>(72, 0.0)},
                                                                        {"shapes", none}};
    std::filesystem::create_directories(folder / "easymocap");
    test::write_text(folder / "easymocap/000000.json", detail::Json::array({person}).dump());
    CHECK(recognise_motion(folder / "easymocap") == MotionLayout::easymocap);
    CHECK(load_any_motion(folder / "easymocap", body).frame_count() == 1);
    std::filesystem::create_directories(folder / "lhm");
    const detail::Json frame = {
        {"root_pose", none}, {"body_pose", std::vector<double>(63, 0.0)}, {"trans", none}, {"betas", none}};
    test::write_text(folder / "lhm/00001.json", frame.dump());
    CHECK(recognise_motion(folder / "lhm") == MotionLayout::smplx_json);
    CHECK(load_any_motion(folder / "lhm", smplx).frame_count() == 1);
    std::filesystem::create_directories(folder / "gala/pose");
    test::write_text(folder / "gala/pose/0000.txt", "0,0,0\n");
    CHECK(recognise_motion(folder / "gala") == MotionLayout::gala);
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "gala", body); }, {"model/jointParent.txt"});
    std::filesystem::create_directories(folder / "empty");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "empty", body); }, {"empty", "no motion"});
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "none.npz", body); }, {"none.npz"});
}

TEST_CASE("motions of other rigs are known by their first bytes or their ending, and are retargeted") {
    const test::Temporary folder;
    const BodyModel& body = test::skeleton_body();
    const auto sample = test::sample_rig({.rest = test::Rest::A, .units = 100});
    write_file(folder / "walk.bvh", test::bvh_text(sample));
    fs::copy_file(folder / "walk.bvh", folder / "walk.txt");
    const auto files = test::gltf_of(test::sample_rig());
    write_file(folder / "walk.vrma", files.glb());
    write_file(folder / "walk.gltf", files.gltf());
    CHECK(recognise_motion(folder / "walk.bvh") == MotionLayout::bvh);
    CHECK(recognise_motion(folder / "walk.txt") == MotionLayout::bvh);
    CHECK(recognise_motion(folder / "walk.vrma") == MotionLayout::gltf);
    CHECK(recognise_motion(folder / "walk.gltf") == MotionLayout::gltf);

    MotionFileOptions options;
    options.betas = {2.0};
    std::vector<std::string> warnings;
    const Motion motion = load_any_motion(folder / "walk.bvh", body, options, &warnings);
    CHECK(motion.betas == options.betas);
    CHECK(warnings.size() == 2); // the unit, and joints without a source
    const Motion mean = load_any_motion(folder / "walk.bvh", body);
    CHECK(motion.transl[1].y > mean.transl[1].y); // taller, so higher
    options.joint_map.named = {{"mixamorig:Head", ""}};
    CHECK(load_any_motion(folder / "walk.bvh", body, options).pose_at(1)[15] == vec3<double>(0));
    CHECK(mean.pose_at(1)[15] != vec3<double>(0));
    options.animation = "run";
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "walk.gltf", body, options); },
                                {"no animation 'run'"});

    write_file(folder / "walk.fbx", "Kaydara FBX Binary  ");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "walk.fbx", body); }, {"FBX", "GLB"});
    write_file(folder / "fit.pkl", "\x80\x04}.");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "fit.pkl", body); },
                                {"fit.pkl: is a pickle of Python (protocol 4), expected a motion", "docs/captures.md"});
    write_file(folder / "000000.json", "{}");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "000000.json", body); }, {"give the folder"});
    write_file(folder / "text.bvh", "not a motion");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "text.bvh", body); }, {"HIERARCHY"});
    write_file(folder / "text.glb", "not a motion");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "text.glb", body); }, {"not glTF"});
}

TEST_CASE("folders of one .npz a frame, as SMPLer-X writes them") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 3, 2, true);
    const auto frame = [&](const std::string& name, double x, bool axes, const char* missing = "") {
        fs::create_directories((folder / name).parent_path());
        NpzWriter file(folder / name);
        const auto add = [&](const char* key, std::size_t joints) {
            if (std::string(key) != missing)
                file.add(key, std::vector<double>(3 * joints, x), axes ? Shape{joints, 3} : Shape{1, 3 * joints});
        };
        add("global_orient", 1), add("body_pose", 21), add("jaw_pose", 1), add("leye_pose", 1), add("reye_pose", 1);
        add("left_hand_pose", 15), add("right_hand_pose", 15), add("transl", 1);
        file.add("betas", std::vector<double>(3, x), {1, 3});
        file.add("expression", std::vector<double>(2, x), {1, 2});
        file.commit();
    };
    for (const bool axes : {true, false}) {
        const std::string place = axes ? "joints/" : "rows/";
        frame(place + "00003_0.npz", 0.5, axes), frame(place + "00002_0.npz", 0.25, axes);
        frame(place + "00002_1.npz", -0.125, axes), frame(place + "._00002_1.npz", 9, axes);
        CHECK(recognise_motion(folder / place) == MotionLayout::npz_frames);
        const Motion first = load_any_motion(folder / place, body);
        REQUIRE(first.frame_count() == 2);
        CHECK(first.timestamps == std::vector<double>{2 / 30.0, 0.1});
        CHECK(first.pose_at(0)[21] == vec3<double>(0.25));
        CHECK(first.pose_at(1)[21] == vec3<double>(0.5));
        CHECK(first.transl[1] == vec3<double>(0.5));
        CHECK(first.betas == std::vector<double>(3, 0.375)); // their mean
        CHECK(first.expression[2] == 0.5);
        CHECK(first.pose_at(1)[25] == vec3<double>(0.5) + body.hands_mean_left[0]);
        MotionFileOptions options;
        options.person = 1, options.fps = 10;
        CHECK(load_any_motion(folder / place, body, options).pose_at(0)[3] == vec3<double>(-0.125));
        CHECK(load_any_motion(folder / place, body, options).timestamps[0] == 0.2);
        options.person = 2;
        test::check_throws<IoError>([&] { (void)load_any_motion(folder / place, body, options); },
                                    {"person 2 is missing, there are 0, 1"});
    }
    frame("lost/frame_1.npz", 0, true), frame("lost/frame_2.npz", 0, true, "jaw_pose");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "lost", body); },
                                {"frame_2.npz: jaw_pose is missing"});
    for (int person = 1; person < 300; ++person) frame("crowd/1_" + std::to_string(person) + ".npz", 0, true);
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "crowd", body); },
                                {"person 0 is missing, there are 1, 2, 3, 4, 5, 6, 7, 8 and 291 more"});
    frame("twice/1.npz", 0, true), frame("twice/01.npz", 0, true);
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "twice", body); },
                                {"1.npz: its number is that of"});
    fs::create_directories(folder / "many");
    save_motion(folder / "many/1.npz", test::still_motion(body, 3));
    test::check_throws<ShapeError>([&] { (void)load_any_motion(folder / "many", body); },
                                   {"many/1.npz: global_orient has shape (3, 3), expected 3 numbers: one frame"});
}

TEST_CASE("a folder without a motion: the message says what it holds") {
    const test::Temporary folder;
    const BodyModel& body = test::skeleton_body();
    const auto refuse = [&](const std::string& name, std::initializer_list<std::string_view> words) {
        test::check_throws<IoError>([&] { (void)load_any_motion(folder / name, body); }, words);
    };
    for (const std::string frame : {"000", "001"}) {
        fs::create_directories(folder / "results" / frame);
        write_file(folder / "results" / frame / "000.pkl", "\x80\x02}.");
    }
    refuse("results", {"holds no motion", "it holds 2 files .pkl, such as 000/000.pkl, a pickle of Python (protocol 2)",
                       "docs/captures.md"});
    fs::create_directories(folder / "takes");
    write_file(folder / "takes/a.bvh", test::bvh_text(test::sample_rig()));
    refuse("takes", {"1 file .bvh, such as a.bvh, a BVH motion"});
    fs::create_directories(folder / "nothing");
    refuse("nothing", {"holds no motion", "it holds no files"});
}

TEST_CASE("a pose that is split, or a word on hands, counts for more than what AMASS also has") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 3, 2, true);
    const auto write = [&](const char* name, const auto& add) {
        NpzWriter file(folder / name);
        file.add("betas", std::vector<double>(3, 0.0));
        file.add("trans", std::vector<double>(6, 0.0), {2, 3});
        file.add("poses", std::vector<double>(330, 0.125), {2, 165});
        add(file);
        file.commit();
        return folder / name;
    };
    const auto both = write("both.npz", [](NpzWriter& file) {
        file.add("global_orient", std::vector<double>(6, 0.5), {2, 3});
        file.add("body_pose", std::vector<double>(126, 0.5), {2, 63});
    });
    CHECK(recognise_motion(both) == MotionLayout::gsh);
    CHECK(load_any_motion(both, body).pose[0].x == 0.5);
    const auto plain = write("plain.npz", [](NpzWriter&) {}),
               counted = write("counted.npz", [](NpzWriter& file) { file.add("flat_hand", std::uint8_t(0)); });
    CHECK(load_any_motion(plain, body).pose[25] == vec3<double>(0.125));
    CHECK(load_any_motion(counted, body).pose[25] == vec3<double>(0.125) + body.hands_mean_left[0]);
    CHECK(load_any_motion(counted, body).pose == load_motion(counted, body).pose);
}
