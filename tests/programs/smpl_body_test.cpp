// SPDX-License-Identifier: Apache-2.0
/// @file  Checks and reconstructs captures of data sets with SMPL poses, with a body of 24 joints.
#include "io/easymocap_files.hpp"
#include "io/people_snapshot_files.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <gsh/body/joint_merge.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/synthetic/actor_skeleton.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
using test::check_done;
using test::json_of;
using test::run;
using test::studio;
namespace fs = std::filesystem;

namespace {

constexpr std::size_t smpl_joints = 24;

/// SMPL's joints among SMPL-X's: trunk and limbs, and one joint per hand, here the index finger's first.
std::vector<int> smpl_kept() {
    std::vector<int> kept = trunk_and_limbs(studio().body);
    kept.insert(kept.end(), {smplx::left_index1, smplx::right_index1});
    return kept;
}

/// The actor with SMPL's joints and only the arrays of SMPL's files: no expression, no names, no lists of vertices.
BodyModel smpl_actor() {
    BodyModel body = merge_joints(studio().body, smpl_kept());
    body.joint_names.clear();
    for (auto* list : {&body.face_vertices, &body.left_hand_vertices, &body.right_hand_vertices}) list->clear();
    return body;
}

/// A small capture of the actor with 24 joints, and its body file.
struct Filmed {
    test::Temporary folder;
    BodyModel body = smpl_actor();
    fs::path body_file = folder / "smpl.npz", out = folder / "out";
    Capture capture;

    Filmed(int frames, int train_cameras, int test_cameras) {
        Motion motion = merge_joints(actor_motion(ActorMotion::talk, frames), smpl_kept());
        motion.betas.assign(static_cast<std::size_t>(body.shape_count), 0);
        StudioParams studio;
        studio.train_cameras = train_cameras, studio.test_cameras = test_cameras;
        studio.image_size = 64, studio.samples = 4;
        cpu::Threads backend;
        capture = film(backend, body, motion, studio);
        save_body_model(body_file, body);
    }
    [[nodiscard]] std::vector<double> pose(std::size_t frame) const {
        std::vector<double> numbers;
        for (const vec3<double>& v : capture.motion.pose_at(frame)) numbers.insert(numbers.end(), {v.x, v.y, v.z});
        return numbers;
    }
    [[nodiscard]] std::vector<double> shift(std::size_t frame) const {
        const vec3<double>& v = capture.motion.transl[frame];
        return {v.x, v.y, v.z};
    }
    /// Checks the folder, then trains on it. The results must be as good as with the capture in gsh's own layout.
    void check_and_reconstruct(const fs::path& path, std::size_t train_images,
                               const std::vector<std::string>& test_images) const {
        check_done(run({"gsh-check", path.string(), "--body", body_file.string(), "--out", (out / "check").string()}));
        const auto check = json_of(out / "check/check.json");
        CHECK(check.at("mean_iou") > 0.93); // images of 64 pixels
        CHECK(check.at("findings").empty());
        CHECK(check.at("images").size() == train_images + test_images.size());
        CHECK(test::files_below(out / "check/overlays") == train_images + test_images.size());

        check_done(run(studio().reconstruct(out, {"--steps", "2"}, path, body_file)));
        const AvatarData avatar = load_avatar(out / "avatar.gsh");
        CHECK(avatar.rig.joint_count() == smpl_joints);
        CHECK(avatar.rig.body.expression_count == 0);
        CHECK(avatar.gaussians.size() == 1500);
        const auto metrics = json_of(out / "metrics.json");
        for (const char* figure : {"psnr", "ssim", "psnr_person"}) CHECK(metrics.at(figure).is_number());
        REQUIRE(metrics.at("images").size() == test_images.size());
        for (std::size_t i = 0; i < test_images.size(); ++i) {
            CHECK(metrics.at("images")[i].at("name") == test_images[i]);
            CHECK(metrics.at("images")[i].at("psnr") > 5.0);
            CHECK(read_image(out / "test" / (test_images[i] + ".png")).width == 3 * 64);
        }
    }
};

} // namespace

TEST_CASE_FIXTURE(test::PeopleSnapshotFiles, "PeopleSnapshot is checked and reconstructed with a body of 24 joints") {
    const Filmed filmed(5, 1, 0);
    write_camera(filmed.capture.cameras[0].camera);
    for (std::size_t f = 0; f < 5; ++f) {
        write_photo(static_cast<int>(f), filmed.capture.image({0, f}));
        const std::vector<double> pose = filmed.pose(f), shift = filmed.shift(f);
        thetas.insert(thetas.end(), pose.begin(), pose.end());
        transl.insert(transl.end(), shift.begin(), shift.end());
    }
    write_split("anim_nerf_train.npz", {0, 2}, 0, 0);
    write_split("anim_nerf_test.npz", {3, 4}, 0, 0);
    test::write_text(path / "split.json", R"({"train": [0, 2, 2], "test": [3, 4, 1]})");
    filmed.check_and_reconstruct(path, 2, {"camera_0002", "camera_0003"});
}

TEST_CASE("EasyMocap is checked and reconstructed with a body of 24 joints") {
    const Filmed filmed(2, 2, 1);
    const fs::path path = filmed.folder / "scene";
    fs::create_directories(path);
    test::write_opencv_cameras(path, filmed.capture.cameras);
    for (std::size_t f = 0; f < 2; ++f) {
        std::vector<double> pose = filmed.pose(f);
        detail::Json person{{"id", 0}, {"Th", test::row(filmed.shift(f))}};
        person["Rh"] = test::row({pose[0], pose[1], pose[2]}); // about the origin, which is the actor's pelvis
        std::fill_n(pose.begin(), 3, 0);
        person["poses"] = test::row(pose), person["shapes"] = test::row(filmed.capture.motion.betas);
        const int frame = static_cast<int>(f);
        test::write_people(path / "output/smpl", frame, detail::Json::array({person}));
        for (std::size_t c = 0; c < filmed.capture.cameras.size(); ++c)
            test::write_view(path, filmed.capture.cameras[c].name, frame, filmed.capture.image({c, f}));
    }
    filmed.check_and_reconstruct(path, 4, {"test00_0000", "test00_0001"});
}
