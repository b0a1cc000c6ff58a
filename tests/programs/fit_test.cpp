// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-fit makes a detector's folder a capture that gsh-check accepts, and refuses what it cannot read.
#include "programs/filmed_turn.hpp"
#include "programs/process.hpp"
#include "support/contains.hpp"

#include <gsh/body/joint_error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/bvh_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <nlohmann/json.hpp>

#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

using test::FilmedTurn;

FilmedTurn& filmed() {
    static FilmedTurn instance;
    return instance;
}

} // namespace

TEST_CASE("a turn becomes a capture in an upright world, with a report; gsh-check reads it") {
    FilmedTurn& turn = filmed();
    const auto outcome = run(turn.fit({"--height", "1.7", "--test-every", "5", "--to", turn.folder / "turn.bvh"}));
    check_done(outcome);
    CHECK(outcome.out == test::contains("nobody was found in frames 5"));
    CHECK(outcome.out == test::contains("next: gsh-check "));
    const Motion found = load_motion(turn.detections / "poses.npz", turn.body);
    REQUIRE(found.frame_count() == 12);
    CHECK(joint_errors(turn.body, found, turn.motion, RootAlignment::rotation).mean_mm < 25);
    const CameraList list = read_cameras(turn.detections / "cameras.json");
    REQUIRE(list.cameras.size() == 1);
    CHECK(list.cameras[0].camera.fx == doctest::Approx(turn.camera.fx)); // it was known
    CHECK(list.fps == doctest::Approx(10));
    CHECK(list.floor_y == 0.0);
    CHECK(list.test_frames == std::vector<int>{2, 7});
    CHECK(std::abs(list.cameras[0].camera.R[1].y + 1) < 0.1); // y is up, and the camera level
    for (std::size_t t = 0; t < 12; ++t) CHECK(rotation_from_axis_angle(found.pose_at(t)[0])[1].y > 0.98);
    const Json report = Json::parse(read_file(turn.detections / "fit.json"));
    CHECK(report["frames_without_person"] == Json{5});
    CHECK(report["frame_median_mm"][5].is_null());
    CHECK(report["turn_degrees"].get<double>() > 300);
    CHECK(report["pose_held"] == true);
    CHECK(report["height_m"].get<double>() == doctest::Approx(1.7).epsilon(0.02));
    CHECK(fs::file_size(turn.folder / "turn.bvh") > 1000);

    const auto checked =
        run({"gsh-check", turn.detections.string(), "--body", turn.body_file.string(), "--out", turn.folder / "check"});
    CAPTURE(checked.out);
    CHECK(checked.code >= 0);
    CHECK(checked.out == test::contains("0.9")); // masks and bodies overlap

    // Once more: the result does not depend on what it wrote.
    const std::string before = read_file(turn.detections / "poses.npz");
    check_done(run(turn.fit({"--height", "1.7", "--test-every", "5"})));
    CHECK(read_file(turn.detections / "poses.npz") == before);
}

TEST_CASE("every refusal is one line and code 2, and writes nothing") {
    const FilmedTurn turn;
    const auto refused = [&](const std::vector<std::string>& words, const char* expected) {
        check_refused(run(words), "gsh-fit", {expected});
        CHECK(!fs::exists(turn.detections / "poses.npz"));
    };
    refused({"gsh-fit", turn.folder / "none", "--body", turn.body_file.string(), "--to", turn.folder / "a.bvh"},
            "none: does not exist");
    refused({"gsh-fit", turn.detections / "images/front", "--body", turn.body_file.string()}, "--out: is required");
    refused(turn.fit({"--fps", "5"}), "--fps: is for videos");
    refused(turn.fit({"--height", "17"}), "--height");
    refused(turn.fit({"--turn", "maybe"}), "--turn");
    refused(turn.fit({"--to", turn.folder / "a.fbx"}), "--to ");
    fs::rename(turn.detections / "masks/front/0003.png", turn.detections / "masks/front/third.png");
    refused(turn.fit(),
            "masks/front: holds 12 images with a gap in their numbers, expected 12, one for each of the times");
    fs::remove_all(turn.detections / "masks");
    write_file(turn.detections / "keypoints.json", R"({"images": [], "annotations": []})");
    refused(turn.fit(), "nobody was found in any photograph");
}
