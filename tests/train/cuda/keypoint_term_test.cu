// SPDX-License-Identifier: Apache-2.0
/// @file  Keypoints on the CUDA backend: a registration follows them, and its steps do not wait for the device.
#include <gsh/backend/serial.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/cuda.cuh>
#include <gsh/registration/registration.hpp>

#include "support/cuda_device.hpp"
#include "support/posed_scene.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cuda_keypoint_term { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;
using cuda::Device;

/// Landmark k lies beside joint k of the tube.
Landmarks tube_marks() {
    Landmarks marks{};
    for (Landmark& mark : marks) mark.joint = -1;
    for (int k = 0; k < 4; ++k) marks[static_cast<std::size_t>(k)] = {k, vec3<double>(0.05, 0.02 * k, -0.03), 0.02};
    return marks;
}

/// Keypoints of the true motion in all views of each frame but the last.
std::vector<std::vector<ViewKeypoints>> seen_of(const PosedScene& scene) {
    const MotionLandmarks places(scene.body, scene.truth, tube_marks());
    std::vector<std::vector<ViewKeypoints>> frames(PosedScene::frames);
    for (std::size_t t = 0; t + 1 < PosedScene::frames; ++t)
        for (const Camera<double>& camera : scene.cameras) {
            auto& view = frames[t].emplace_back(ViewKeypoints{.camera = camera, .points = {}});
            for (int k = 0; k < 4; ++k)
                view.points.push_back({k, to_pixel(camera, to_camera(camera, places.at(t, k))), 0.9});
        }
    return frames;
}

TEST_CASE("the gradient of keypoints on the device is the central difference of their cost there") {
    if (skip_without_device()) return;
    const PosedScene scene;
    Device device;
    const Rig<Device, double> rig(device, scene.avatar.rig);
    Motion motion = scene.estimate();
    RigPose<Device, double> pose;
    rig.upload_pose(motion, 1, pose);
    KeypointTerm<Device, double> term(device, scene.avatar.rig, seen_of(scene), tube_marks());
    Device::Buffer<vec3<double>> dL_dpose(4);
    device.fill(Span<vec3<double>>(dL_dpose), vec3<double>(0));
    term.backward(1, pose, {.pose = dL_dpose, .coefficients = {}, .transl = {}});
    std::vector<vec3<double>> found(4);
    device.download(Span<const vec3<double>>(dL_dpose), Span<vec3<double>>(found));
    for (std::size_t j = 0; j < 4; ++j)
        for (int c = 0; c < 3; ++c) {
            double& angle = motion.pose[4 + j][c];
            const double at = angle, step = 1e-5;
            double cost[2];
            for (int side = 0; side < 2; ++side) {
                angle = at + (side ? step : -step);
                rig.upload_pose(motion, 1, pose);
                cost[side] = term.value(1, pose);
            }
            angle = at;
            CHECK(found[j][c] == doctest::Approx((cost[1] - cost[0]) / (2 * step)).epsilon(1e-5));
        }
}

TEST_CASE("poses are registered on the device: keypoints and photographs bring the joints nearer") {
    if (skip_without_device()) return;
    const PosedScene scene;
    const Motion estimate = scene.estimate(0.2, 0.05);
    std::vector<Photo> photos;
    for (std::size_t t = 0; t < PosedScene::frames; ++t)
        for (const Photo& photo : scene.observe(t)) photos.push_back(photo);
    RegistrationParams params;
    params.levels = {{.pixels = 24, .gaussians = 300, .visits = 24}};
    Device device;
    cpu::Serial host;
    const RegisteredPerson person{&scene.body, &estimate, {}};
    const Registration found =
        register_motions(device, host, Span<const RegisteredPerson>(&person, 1), Span<const Photo>(photos), 1, params);
    const auto error = [&](const Motion& motion) {
        return joint_errors(scene.body, motion, scene.truth, RootAlignment::none).mean_mm;
    };
    MESSAGE("joints: " << error(estimate) << " mm before, " << error(found.motions[0]) << " mm after");
    CHECK(error(found.motions[0]) < 0.7 * error(estimate));
    CHECK(found.fits[0].psnr > 15);
    CHECK(found.frame_fit.size() == PosedScene::frames);
}

} // namespace cuda_keypoint_term
