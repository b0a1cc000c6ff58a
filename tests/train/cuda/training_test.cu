// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars are trained and shown on the CUDA backend as on cpu::Serial.
#include <gsh/cuda.cuh>
#include <gsh/train/memory.hpp>
#include <gsh/train/stage.hpp>

#include "support/cuda_device.hpp"
#include "support/cuda_outcomes.hpp"
#include "support/device_arrays.hpp"
#include "support/serial_runs.hpp"
#include "support/small_runs.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cuda_training { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;
using cuda::Device;

// Sums of the gradients of a network's weights, which an estimate of memory counts.
static_assert(device_costs.networks == cuda::detail::mlp_most_blocks);

TEST_CASE("an avatar trains on the device as on the CPU, with the same bits each time and in each order") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const Outcome found = train_avatar<Device>(scene, {.ao = AmbientOcclusion::time}, 50);
    check_near(found, train_avatar<cpu::Serial>(scene, {.ao = AmbientOcclusion::time}, 50));
    check_same(found, train_avatar<Device>(scene, {.ao = AmbientOcclusion::time}, 50));
#if defined(GSH_CUDA_EMULATION)
    auto& machine = CudaEmulation::instance();
    machine.order = Order::random, machine.fill = 0x5A;
    check_same(found, train_avatar<Device>(scene, {.ao = AmbientOcclusion::time}, 50));
    machine.order = Order::forward, machine.fill = 0xA5;
#endif
}

TEST_CASE("an avatar trains in mixed precision nearly as in float, with the same bits each time and in each order") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const auto train = [&](int steps) { return train_paper_network<Device>(scene, Precision::mixed, steps); };
    const Outcome found = train(50), expected = train_paper_network<cpu::Serial>(scene, Precision::fp32, 50);
    const double psnr = psnr_of(found.pictures[0], expected.pictures[0]);
    CAPTURE(psnr);
    CHECK(psnr >= 40);
    REQUIRE(found.losses.size() == expected.losses.size());
    for (std::size_t i = 0; i < found.losses.size(); ++i) {
        CAPTURE(i);
        CHECK(found.losses[i] == doctest::Approx(expected.losses[i]).epsilon(0.01).scale(1));
    }
    const Outcome first = train(8); // directly, captured, repeated
    CHECK(first.learned != train_paper_network<Device>(scene, Precision::fp32, 8).learned);
#if defined(GSH_CUDA_EMULATION)
    auto& machine = CudaEmulation::instance();
    machine.order = Order::random, machine.fill = 0x5A;
#endif
    check_same(first, train(8));
#if defined(GSH_CUDA_EMULATION)
    machine.order = Order::forward, machine.fill = 0xA5;
#endif
}

TEST_CASE("photographs beyond the budget are brought ahead of their steps, which stay the same") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const ConfiguredAvatarParams config{.ao = AmbientOcclusion::time};
    const Outcome expected = train_avatar<Device>(scene, config, 10);
    for (const std::uint64_t budget : {std::uint64_t(1), std::uint64_t(2 * scene.photos[0].rgba.size())}) {
        CAPTURE(budget);
        check_same(train_avatar<Device>(scene, config, 10, with_photo_memory(budget)), expected);
#if defined(GSH_CUDA_EMULATION)
        CudaEmulation::instance().eager_streams = true; // copies run as early as their events allow
        check_same(train_avatar<Device>(scene, config, 10, with_photo_memory(budget)), expected);
        CudaEmulation::instance().eager_streams = false;
#endif
    }
}

TEST_CASE("so do ambient occlusion over the pose, stored attributes, separate heads and other deformations") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const ConfiguredAvatarParams configs[] = {
        {.ao = AmbientOcclusion::pose},
        {.hash_displacement = false, .hash_sh = false, .model = {.deformation = Deformation::polar}},
        {.heads = Heads::separate, .head_time = true, .model = {.deformation = Deformation::dual_quaternion}}};
    for (const ConfiguredAvatarParams& config : configs) {
        CAPTURE(static_cast<int>(config.model.deformation));
        check_near(train_avatar<Device>(scene, config), train_avatar<cpu::Serial>(scene, config));
    }
}

TEST_CASE("so does an avatar in a light, with its poses, and so is it shown") {
    if (skip_without_device()) return;
    const SmallScene small;
    check_near(train_lit<Device>(small), train_lit<cpu::Serial>(small));
    const PosedScene scene;
    AvatarData avatar = scene.avatar;
    avatar.light = even_light(2, 3, {0, 0.8, 0}, 3);
    const Outcome found = show<Device>(scene, avatar), expected = show<cpu::Serial>(scene, avatar);
    // of the picture and of the pose's gradient
    CHECK(relative_distance(found.learned, expected.learned) < 1e-4);
}

TEST_CASE("events time the stages of steps, and change no result") {
    if (skip_without_device()) return;
    const SmallScene scene;
    SmallTraining<Device> timed(scene, [] { return Device(); }, 3, {}), plain(scene, [] { return Device(); }, 3, {});
    StageTimer<Device> timer(timed.backend);
    timer.sample();
    CHECK(timer.steps() == 0);    // no step yet
    for (int k = 0; k < 3; ++k) { // directly, captured, repeated
        timed.trainer.step(0.5, timer);
        timer.sample();
        plain.trainer.step(0.5);
    }
    CHECK(timer.steps() == 3);
    for (const double seconds : timer.seconds()) CHECK(seconds > 0);
    CHECK(timed.parameters() == plain.parameters());
    StageTimer<Device> second(timed.backend); // a recorded step must not keep the events of the first one
    timed.trainer.step(0.5, second);
    plain.trainer.step(0.5);
    second.sample();
    CHECK(second.steps() == 1);
    for (const double seconds : second.seconds()) CHECK(seconds > 0);
    const std::vector<cuda::KernelTime> kernels = timed.trainer.time_kernels(1);
    REQUIRE_FALSE(kernels.empty());
    CHECK(kernels.back().stage == "update");
    CHECK(kernels.back().kernel == "CountStep");
    CHECK(timed.trainer.step_count() == 4);
    timed.trainer.step(0.5);
    timed.trainer.settle();
    CHECK(timed.trainer.step_count() == 5); // the repeats were not counted as steps
}

} // namespace cuda_training
