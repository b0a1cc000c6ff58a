// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/easymocap_capture.hpp>

#include "io/easymocap_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"
#include "support/contains.hpp"

#include <gsh/backend/threads.hpp>

#include <functional>
#include <string>
#include <vector>

using namespace gsh;
using detail::Json;
using test::row;
using test::write_people;

namespace {

Json person(test::Rng& rng, int id, std::size_t poses, bool expression = false) {
    Json json;
    json["id"] = id;
    json["Rh"] = row(rng.numbers(3, -2, 2));
    json["Th"] = row(rng.numbers(3));
    std::vector<double> numbers = rng.numbers(poses, -0.3, 0.3);
    for (std::size_t k = 0; k < 3; ++k) numbers[k] = 0;
    json["poses"] = row(numbers);
    json["shapes"] = row(std::vector<double>{0.5, -0.25, 1});
    if (expression) json["expression"] = row(rng.numbers(2));
    return json;
}

/// The body in EasyMocap's convention: posed without root and translation, then rotated about the origin.
std::vector<vec3<double>> expected_points(const BodyModel& body, Motion motion, const Json& person) {
    motion.pose[0] = vec3<double>(0), motion.transl[0] = vec3<double>(0);
    auto points = test::posed_points(body, motion, 0);
    const auto v = [&](const char* key) {
        const Json& r = person[key][0];
        return vec3<double>(r[0].get<double>(), r[1].get<double>(), r[2].get<double>());
    };
    for (auto& p : points) p = rotation_from_axis_angle(v("Rh")) * p + v("Th");
    return points;
}

} // namespace

TEST_CASE("bodies stand where EasyMocap's do: SMPL, SMPL-X with components, whole poses") {
    const test::Temporary folder;
    test::Rng rng(3);
    for (const std::size_t width : {std::size_t(72), std::size_t(87), std::size_t(165)}) {
        const BodyModel body = test::small_body(width == 72 ? 24 : 55, 3, 2, true);
        const auto place = folder / std::to_string(width);
        const Json p = person(rng, 0, width, width != 72);
        write_people(place, 0, Json::array({p}));
        const Motion motion = load_easymocap_motion(place, body);
        REQUIRE(motion.frame_count() == 1);
        CHECK(motion.betas == std::vector<double>{0.5, -0.25, 1});
        CHECK(test::largest_distance(test::posed_points(body, motion, 0), expected_points(body, motion, p)) < 1e-12);
        const Json& poses = p["poses"][0];
        CHECK(motion.pose[21].y == poses[64].get<double>());
        if (width == 72) CHECK(motion.pose[23].z == poses[71].get<double>());
        if (width == 87) {
            CHECK(motion.pose[22].x == poses[78].get<double>());
            double x = body.hands_mean_right[2].x; // of joint 42
            for (std::size_t c = 0; c < 6; ++c)
                x += poses[72 + c].get<double>() * body.hands_components_right[45 * c + 6];
            CHECK(motion.pose[42].x == doctest::Approx(x));
            CHECK(motion.expression[1] == p["expression"][0][1].get<double>());
        }
        if (width == 165) CHECK(motion.pose[54].z == poses[164].get<double>());
    }
}

TEST_CASE("several frames of every width that EasyMocap writes, with and without the root") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 3, 2, true);
    for (const std::size_t width : {66, 72, 78, 87, 156, 165})
        for (const bool root : {true, false}) {
            test::Rng rng(width);
            const auto place = folder / (std::to_string(width) + (root ? "" : "_no_root"));
            std::vector<Json> people;
            for (int t = 0; t < 3; ++t) {
                people.push_back(person(rng, 0, width, width == 87 || width == 165));
                Json stored = people.back();
                if (!root) stored["poses"][0].erase(0), stored["poses"][0].erase(0), stored["poses"][0].erase(0);
                write_people(place, t, Json::array({stored}));
            }
            const Motion motion = load_easymocap_motion(place, body);
            REQUIRE(motion.frame_count() == 3);
            for (std::size_t t = 0; t < 3; ++t) {
                const Json& poses = people[t]["poses"][0];
                const auto joint = [&](std::size_t j, std::size_t first) {
                    return length(motion.pose_at(t)[j] - vec3<double>(poses[first].get<double>(),
                                                                      poses[first + 1].get<double>(),
                                                                      poses[first + 2].get<double>()));
                };
                CHECK(joint(1, 3) == 0);
                CHECK(joint(21, 63) == 0);
                if (width == 87) CHECK(joint(24, 84) == 0);
                if (width == 165) CHECK(joint(22, 66) == 0);
                if (width >= 156) {
                    CHECK(joint(25, width - 90) == 0);
                    CHECK(joint(54, width - 3) == 0);
                }
                if (width == 78 || width == 87)
                    for (const std::size_t k : {25, 54}) { // mean hand and six components
                        const std::size_t j = (k - 25) % 15, first = k == 25 ? 66 : 72;
                        double x = (k == 25 ? body.hands_mean_left : body.hands_mean_right)[j].x;
                        for (std::size_t c = 0; c < 6; ++c)
                            x += poses[first + c].get<double>() *
                                 (k == 25 ? body.hands_components_left : body.hands_components_right)[45 * c + 3 * j];
                        CHECK(motion.pose_at(t)[k].x == doctest::Approx(x));
                    }
            }
        }
}

TEST_CASE("hands beside the poses count if the first frame has them") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 3, 2, true);
    const auto write = [&](const std::string& name, const std::vector<bool>& with_hands) {
        test::Rng rng(3);
        for (std::size_t t = 0; t < with_hands.size(); ++t) {
            Json p = person(rng, 0, 66);
            if (with_hands[t]) p["handl"] = row(rng.numbers(6)), p["handr"] = row(rng.numbers(6));
            write_people(folder / name, static_cast<int>(t), Json::array({p}));
        }
        return folder / name;
    };
    const Motion both = load_easymocap_motion(write("both", {true, true}), body);
    CHECK(both.pose_at(1)[25] != both.pose_at(0)[25]);
    std::vector<std::string> warnings;
    const Motion late = load_easymocap_motion(write("late", {false, true, true}), body, {}, &warnings);
    CHECK(late.pose_at(1)[25] == late.pose_at(0)[25]);
    std::string text;
    for (const auto& warning : warnings) text += warning + "\n";
    CHECK(text == test::contains("handl is in 2 frames, but not in the first, 000000.json, and is left out"));
    test::check_throws<ShapeError>([&] { (void)load_easymocap_motion(write("lost", {true, false}), body); },
                                   {"lost/000001.json: handl has 0 numbers, expected 6 as in the first frame"});
}

TEST_CASE("poses are found in the folders that EasyMocap's programs leave") {
    const BodyModel body = test::small_body(55, 3, 2, true);
    for (const std::string inner : {"output/smplx/smpl", "output/smpl/smpl", "output/smplx", "output/smplx/smpl_full",
                                    "smpl", "output/smplh/smpl", "output"}) {
        const test::Temporary temporary;
        const auto folder = temporary / "capture";
        test::Rng rng(3);
        write_people(folder / inner, 2, Json::array({person(rng, 0, 66)}));
        write_people(folder / "output/smplx/keypoints3d", 2, Json::array()); // another result, which is not one
        CHECK(easymocap_pose_folder(folder) == folder / inner);
        CHECK(recognise_motion(folder) == MotionLayout::easymocap);
        CHECK(load_any_motion(folder, body).timestamps[0] == doctest::Approx(2 / 30.0));
    }
    const test::Temporary temporary;
    const auto folder = temporary / "capture";
    test::Rng rng(3);
    write_people(folder / "output/smpl/smpl", 0, Json::array({person(rng, 0, 72)}));
    write_people(folder / "output/smplx/smpl_full", 0, Json::array({person(rng, 0, 165)}));
    write_people(folder / "output/smplx/smpl", 0, Json::array({person(rng, 0, 87)}));
    CHECK(easymocap_pose_folder(folder) == folder / "output/smplx/smpl");
    CHECK(easymocap_pose_folder(folder / "output/smplx") == folder / "output/smplx/smpl");
    CHECK(easymocap_pose_folder(folder / "output/smplx/keypoints3d").empty());
}

TEST_CASE("newer files: without the root, hands on their own, people under annots") {
    const test::Temporary folder;
    test::Rng rng(5);
    const BodyModel smpl = test::small_body(24, 3, 2), smplx = test::small_body(55, 3, 2, true);
    Json a = person(rng, 4, 69), b = person(rng, 7, 69);
    write_people(folder / "smpl", 5, {{"annots", Json::array({a, b})}});
    write_people(folder / "smpl", 10, {{"annots", Json::array({b, a})}});
    MotionFileOptions options;
    options.person = 7;
    options.fps = 50;
    const Motion motion = load_easymocap_motion(folder / "smpl", smpl, options);
    CHECK(motion.timestamps == std::vector<double>{0.1, 0.2});
    CHECK(motion.pose[1].x == b["poses"][0][0].get<double>());
    CHECK(test::largest_distance(test::posed_points(smpl, motion, 0), expected_points(smpl, motion, b)) < 1e-12);
    CHECK(motion.pose[24] == motion.pose[0]);
    options.person = 5;
    test::check_throws<IoError>([&] { (void)load_easymocap_motion(folder / "smpl", smpl, options); },
                                {"000005.json", "person 5 is missing", "4, 7"});

    Json h = person(rng, 0, 66);
    h["handl"] = row(rng.numbers(12));
    h["handr"] = row(rng.numbers(12));
    write_people(folder / "smplx", 0, Json::array({h}));
    const Motion hands = load_easymocap_motion(folder / "smplx", smplx);
    double x = smplx.hands_mean_left[0].x;
    for (std::size_t c = 0; c < 12; ++c) x += h["handl"][0][c].get<double>() * smplx.hands_components_left[45 * c];
    CHECK(hands.pose[25].x == doctest::Approx(x));
}

TEST_CASE("bad EasyMocap files name the file and the field") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(24, 3, 2);
    const auto expect = [&](const std::function<void(Json&)>& change, std::initializer_list<std::string_view> words) {
        test::Rng rng(3);
        write_people(folder / "p", 0, Json::array({person(rng, 0, 72)}));
        Json second = Json::array({person(rng, 0, 72)});
        change(second);
        write_people(folder / "p", 1, second);
        test::check_throws<Error>([&] { (void)load_easymocap_motion(folder / "p", body); }, {"000001.json"});
        test::check_throws<Error>([&] { (void)load_easymocap_motion(folder / "p", body); }, words);
    };
    expect([](Json& j) { j[0].erase("Th"); }, {"Th is missing"});
    expect([](Json& j) { j[0].erase("poses"); }, {"poses is missing"});
    expect([](Json& j) { j[0]["poses"][0].erase(5); }, {"poses has 71 numbers, expected 72 as in the first frame"});
    expect([](Json& j) { j[0]["shapes"][0].erase(0); }, {"shapes has 2", "3"});
    expect([](Json& j) { j[0]["Rh"] = row({1, 2}); }, {"Rh has 2"});
    expect([](Json& j) { j = Json::array(); }, {"holds no person in this frame"});
    expect([](Json& j) { j = {{"annots", 3}}; }, {"no list of people"});
    expect([](Json& j) { j = 3; }, {"number"});
    expect([](Json& j) { j[0]["id"] = "a"; }, {"id is string"});
    test::Rng rng(3);
    write_people(folder / "q", 0, Json::array({person(rng, 0, 70)}));
    test::check_throws<ShapeError>([&] { (void)load_easymocap_motion(folder / "q", body); },
                                   {"000000.json", "poses has 70", "72"});
    std::filesystem::create_directories(folder / "empty");
    test::check_throws<IoError>([&] { (void)load_easymocap_motion(folder / "empty", body); }, {"empty", "NUMBER.json"});
}

namespace {

const char* intrinsics = R"(%YAML:1.0
---
names:
  - "01"
  - "02"
  - "3"
K_01: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [100.000000, 0.000000, 31.5, 0., 101.0,
    29.5, 0.000, 0.000000, 1.000000]
dist_01: !!opencv-matrix
  rows: 1
  cols: 5
  dt: d
  data: [0.000000, 0.000000, 0.000000, 0.000000, 0.000000]
K_02: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [100, 0, 31.5, 0, 101, 29.5, 0, 0, 1]
dist_02: !!opencv-matrix
  rows: 1
  cols: 5
  dt: d
  data: [-1.0e-01, 2e-2, 0.001, -0.001, 0]
H_02: 60
W_02: 64
K_3: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [100, 0, 31.5, 0, 101, 29.5, 0, 0, 1]
)";

const char* extrinsics = R"(%YAML:1.0
---
names:
  - "01"
  - "02"
R_01: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [3.14159265358979, 0, 0]
T_01: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [0.0, 1.3, 5.0]
Rot_02: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [1, 0, 0, 0, -1, 0, 0, 0, -1]
T_02: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [0.0, 1.3, 5.0]
Rot_3: !!opencv-matrix
  rows: 3
  cols: 3
  dt: d
  data: [1, 0, 0, 0, -1, 0, 0, 0, -1]
T_3: !!opencv-matrix
  rows: 3
  cols: 1
  dt: d
  data: [0.0, 1.3, 5.0]
)";

/// A person of 24 joints before three cameras.
struct Scene {
    test::Temporary folder;
    std::filesystem::path path = folder / "scene";
    BodyModel body = test::small_body(24, 3, 2);
    cpu::Serial serial;

    Scene() {
        test::Rng rng(8);
        std::filesystem::create_directories(path);
        test::write_text(path / "intri.yml", intrinsics);
        test::write_text(path / "extri.yml", extrinsics);
        for (int f = 3; f < 6; ++f) {
            Json p = person(rng, 0, 72);
            p["Rh"] = row({0, 0, 0}), p["Th"] = row({0, 0, 0});
            write_people(path / "output/smpl/smpl", f, Json::array({p}));
            const PixelImage photo =
                test::masked(test::numbered_image(64, 60, 1, f), [](int y, int) { return y >= 10 && y < 50; });
            for (const char* camera : {"01", "02", "3"}) test::write_view(path, camera, f, photo);
        }
    }
    [[nodiscard]] std::filesystem::path image(const std::string& camera, int f) const {
        return path / "images" / camera / (test::padded(f, 6) + ".png");
    }
    [[nodiscard]] Capture load(const CaptureOptions& options = {}) {
        return load_easymocap_capture(serial, path, body, options);
    }
};

} // namespace

TEST_CASE_FIXTURE(Scene, "OpenCV's YAML: cameras with rotation vectors or matrices") {
    const CameraList list = read_easymocap_cameras(path);
    REQUIRE(list.cameras.size() == 3);
    CHECK(list.cameras[0].name == "01");
    const Camera<double>& c = list.cameras[0].camera;
    CHECK(c.fx == 100);
    CHECK(c.fy == 101);
    CHECK(c.cx == 32);
    CHECK(c.cy == 30);
    CHECK(c.width == 0);
    CHECK(list.cameras[1].camera.width == 64);
    CHECK(!list.cameras[0].distortion);
    REQUIRE(list.cameras[1].distortion);
    CHECK(list.cameras[1].distortion->p2 == -0.001);
    CHECK(c.t == vec3<double>(0, 1.3, 5));
    for (int i = 0; i < 3; ++i) CHECK(length(c.R[i] - list.cameras[1].camera.R[i]) < 1e-14);

    const auto expect = [&](const char* file, std::string text, const std::string& from, const std::string& to,
                            std::initializer_list<std::string_view> words) {
        const std::string kept = text;
        text.replace(text.find(from), from.size(), to);
        test::write_text(path / file, text);
        test::check_throws<Error>([&] { (void)read_easymocap_cameras(path); }, words);
        test::write_text(path / file, kept);
    };
    expect("intri.yml", intrinsics, "K_02", "K_12", {"intri.yml: K_02 is missing"});
    expect("intri.yml", intrinsics, "100, 0, 31.5", "100, nan, 31.5", {"intri.yml: K_02", "finite"});
    expect("intri.yml", intrinsics, "100, 0, 31.5", "100, 31.5", {"intri.yml: K_02 has 8 numbers, expected 9"});
    expect("intri.yml", intrinsics, "100, 0, 31.5", "0, 0, 31.5", {"02", "singular"});
    expect("intri.yml", intrinsics, "W_02: 64", "W_02: 64.5", {"intri.yml: W_02", "64.5", "expected pixels"});
    expect("intri.yml", intrinsics, "W_02: 64", "W_02: 1e30", {"W_02", "pixels"});
    expect("intri.yml", intrinsics, "names:", "nomes:", {"names is missing"});
    const std::string distortion = "cols: 5\n  dt: d\n  data: [-1.0e-01, 2e-2, 0.001, -0.001, 0";
    expect("intri.yml", intrinsics, distortion, "cols: 5\n  dt: d\n  data: [1, 2, 3",
           {"dist_02 is 1 x 5 by its size, but has 3 numbers"});
    expect("intri.yml", intrinsics, distortion, "cols: 3\n  dt: d\n  data: [1, 2, 3",
           {"dist_02 has 3 numbers, expected k1"});
    expect("intri.yml", intrinsics, distortion, "cols: 8\n  dt: d\n  data: [0.1, 0, 0, 0, 0, 0.5, 0, 0",
           {"dist_02 has 6 numbers, expected k1"});
    expect("extri.yml", extrinsics, "T_01", "T_11", {"extri.yml: T_01 is missing"});
    expect("extri.yml", extrinsics, "[1, 0, 0, 0, -1", "[1, 0, 0, 0, 1", {"02", "rotation"});
    expect("extri.yml", extrinsics, "%YAML:1.0", "PK not yaml", {"extri.yml", "KEY: VALUE"});
    std::filesystem::remove(path / "extri.yml");
    test::check_throws<IoError>([&] { (void)read_easymocap_cameras(path); }, {"extri.yml"});
}

TEST_CASE_FIXTURE(Scene, "a capture in EasyMocap's folders") {
    const Capture capture = load();
    CHECK(capture.cameras[2].role == NamedCamera::Role::test);
    CHECK(capture.views(false).size() == 6);
    CHECK(capture.cameras[0].camera.width == 64);
    CHECK(!capture.cameras[1].distortion);
    REQUIRE(capture.images.size() == 9);
    CHECK(int(capture.image({0, 2}).pixel(20, 3)[2]) == 55);
    CHECK(int(capture.image({0, 2}).pixel(20, 3)[3]) == 255);
    CHECK(int(capture.image({0, 2}).pixel(5, 3)[3]) == 0);
    CHECK(capture.image({1, 2}).data != capture.image({0, 2}).data); // undistorted
    CHECK(capture.motion.timestamps[0] == doctest::Approx(0.1));

    CaptureOptions options;
    options.test_cameras = {"02"};
    options.test_frames = FrameRange{1, 1, 1};
    options.downscale = 2;
    options.poses = "output/smpl"; // the folder inside is found
    cpu::Threads threads(3);
    const Capture other = load_easymocap_capture(threads, path, body, options);
    CHECK(other.views(false).size() == 4);
    CHECK(other.cameras[0].camera.cx == 16);
    CHECK(other.images[0].width == 32);
    options.test_cameras = {"x"};
    test::check_throws<IoError>([&] { (void)load(options); }, {"no camera 'x'"});
    CaptureOptions ours; // poses without frame numbers belong to the images in order
    ours.poses = "ours.npz";
    save_motion(path / "ours.npz", capture.motion);
    CHECK(load(ours).motion.pose == capture.motion.pose);
    CHECK(load(ours).images[2].data == capture.images[2].data);
    Motion shorter = capture.motion;
    shorter.transl.pop_back(), shorter.timestamps.pop_back();
    shorter.pose.resize(2 * shorter.joint_count, vec3<double>(0)),
        shorter.expression.resize(2 * shorter.expression_count);
    save_motion(path / "ours.npz", shorter);
    test::check_throws<ShapeError>([&] { (void)load(ours); }, {"ours.npz", "2", "3"});
    std::filesystem::remove(image("02", 4));
    const Capture gap = load();
    for (std::size_t i = 0; i < 9; ++i)
        CHECK(gap.images[i].data == (i == 4 ? std::vector<std::uint8_t>() : capture.images[i].data));
    for (const int number : {3, 5}) std::filesystem::remove(image("02", number));
    test::check_throws<IoError>([&] { (void)load(); }, {"images/02", "no image of the frames 3 to 5", "output"});
    std::filesystem::remove_all(path / "output");
    test::check_throws<IoError>([&] { (void)load(); }, {"no folder of poses"});
}
