// SPDX-License-Identifier: Apache-2.0
/// @file  Pose fits on the CUDA backend: steps that do not wait for the device, and steps that are taken again.
#include <gsh/avatar/avatar.hpp>
#include <gsh/cuda.cuh>
#include <gsh/refine/refinement.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>

#include "support/cuda_device.hpp"
#include "support/posed_scene.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace cuda_pose_fit { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;
using cuda::Device;

constexpr std::size_t frame = 2;

struct Enlarge {
    Span<sym3<float>> covariances;
    GSH_HD void operator()(std::size_t i) const {
        sym3<float>& s = covariances[i];
        s = {s.xx * 30, s.xy * 30, s.xz * 30, s.yy * 30, s.yz * 30, s.zz * 30};
    }
};

/// An avatar whose Gaussians are larger from step `from` on: then they cover more tiles than in all steps before.
class GrowingAvatar : public FrozenAvatar<Device> {
public:
    GrowingAvatar(Device& device, Avatar<Device>& avatar, MotionRefinement<Device>& motion, std::uint64_t from)
        : FrozenAvatar<Device>(avatar, motion), device_(&device), from_(from) {}

    int takes_back = 0; // calls

    void set_progress(std::uint64_t step, double progress) {
        FrozenAvatar<Device>::set_progress(step, progress);
        step_ = step;
    }
    void forward(std::size_t shown, const Deferred<vec3<float>>& center, const SplatView<float>& splats) {
        FrozenAvatar<Device>::forward(shown, center, splats);
        if (step_ >= from_) device_->for_each(splats.covariances.size(), Enlarge{splats.covariances});
    }
    void take_back(std::uint64_t steps) {
        FrozenAvatar<Device>::take_back(steps);
        ++takes_back;
    }

private:
    Device* device_;
    std::uint64_t from_, step_ = 0;
};

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("the steps of a fit do not wait for the device") {
    const PosedScene scene;
    const auto waits = [&](std::size_t steps) {
        Device device;
        Avatar<Device> avatar(device, scene.avatar);
        PoseFit<Device> fit(device, scene.avatar.filter, {.steps = steps, .mask_weight = 0.3});
        MotionRefinement<Device> motion(device, scene.avatar.rig, scene.estimate(), {}, test_time_params());
        FrozenAvatar<Device> frozen(avatar, motion);
        const std::uint64_t before = CudaEmulation::instance().waits;
        CHECK(fit.fit(frozen, frame, scene.observe(frame)).steps == steps);
        return CudaEmulation::instance().waits - before;
    };
    CHECK(waits(12) == waits(6));
}
#endif

TEST_CASE("a fit whose buffers overflow takes the failed steps again, with the bits of large buffers") {
    if (skip_without_device()) return;
    const PosedScene scene;
    const std::uint64_t from = 4, steps = 10;
    const auto fitted = [&](bool large_from_the_start) {
        Device device;
        Avatar<Device> avatar(device, scene.avatar);
        PoseFit<Device> fit(device, scene.avatar.filter, {.steps = steps});
        MotionRefinement<Device> motion(device, scene.avatar.rig, scene.estimate(), {}, test_time_params());
        GrowingAvatar growing(device, avatar, motion, from);
        growing.set_progress(large_from_the_start ? from : 0, 0);
        (void)fit.mean_loss(growing, frame, scene.observe(frame));
        const PoseFitReport report = fit.fit(growing, frame, scene.observe(frame));
        CHECK(report.steps == steps);
        CHECK(growing.takes_back == (large_from_the_start ? 0 : 1));
        std::vector<double> result{report.loss_before, report.loss_after};
        for (const auto& angle : motion.motion().pose) result.insert(result.end(), {angle.x, angle.y, angle.z});
        return result;
    };
    CHECK(fitted(false) == fitted(true));
}

} // namespace cuda_pose_fit
