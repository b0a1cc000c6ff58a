// SPDX-License-Identifier: Apache-2.0
/// Steps and frames in a steady state allocate no arrays, since these were allocated in the first ones. What remains is
/// the list of learned arrays with their names.
#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>

#include "support/small_training.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <new>
#include <vector>

using namespace gsh;

namespace {
struct Allocations {
    std::size_t count = 0, bytes = 0, largest = 0;
};
thread_local Allocations allocations; // these tests compute on one thread; others in the same program on several

void* count_allocation(std::size_t bytes, std::size_t alignment) {
    ++allocations.count;
    allocations.bytes += bytes;
    allocations.largest = std::max(allocations.largest, bytes);
    void* memory = nullptr;
    if (::posix_memalign(&memory, alignment, bytes ? bytes : 1) != 0) throw std::bad_alloc();
    return memory;
}
} // namespace

// Not inlined: GCC would warn that new and free do not match.
[[gnu::noinline]] void* operator new(std::size_t bytes) { return count_allocation(bytes, alignof(std::max_align_t)); }
[[gnu::noinline]] void* operator new(std::size_t bytes, std::align_val_t alignment) {
    return count_allocation(bytes, static_cast<std::size_t>(alignment));
}
[[gnu::noinline]] void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
    return count_allocation(bytes, alignof(std::max_align_t));
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, const std::nothrow_t&) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

namespace {

template <class Work>
Allocations allocations_of(const Work& work) {
    allocations = {};
    work();
    return allocations;
}

/// The smallest array with a number for each Gaussian or pixel of the small scene has more bytes.
constexpr std::size_t no_array = 2048;

} // namespace

TEST_CASE("a steady step of training allocates no arrays") {
    const test::SmallScene scene;
    ConfiguredAvatarParams light = test::quick_avatar(), time = light, pose = light;
    light.light = true, light.lights.points = 1, light.lights.directions = 2;
    time.ao = AmbientOcclusion::time, time.model.occlusion_start = 0;
    pose.ao = AmbientOcclusion::pose, pose.model.occlusion_start = 0;
    for (const ConfiguredAvatarParams& config : {test::quick_avatar(), light, time, pose}) {
        CAPTURE(config.ao);
        test::SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3, config);
        training.steps(8); // each photograph twice
        REQUIRE(training.model.size() * sizeof(float) > no_array);
        const Allocations found = allocations_of([&] { training.steps(8); });
        CHECK(found.largest < no_array);
        CHECK(found.count / 8 < 32); // the list of learned arrays
        CHECK(found.bytes / 8 < 8192);
    }
}

TEST_CASE("a steady frame of an avatar allocates no arrays") {
    const test::SmallScene scene;
    test::SmallTraining<cpu::Serial> training(scene);
    training.steps(1);
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, training.exported());
    const Rasterizer<cpu::Serial> rasterizer(backend);
    const Camera<float> camera = scene.cameras[0].cast<float>();
    Avatar<cpu::Serial>::Cache cache;
    Rasterizer<cpu::Serial>::Cache raster_cache;
    RigPose<cpu::Serial, float> pose;
    Splats<cpu::Serial> splats;
    Image<float> image(3, camera.height, camera.width);
    const auto frame = [&](std::size_t f) {
        avatar.rig().upload_pose(scene.motion, f, pose);
        splats.resize(avatar.size());
        avatar.pose(pose, camera.center(), splats.view(), cache);
        rasterizer.forward(camera, splats.view(), {.color = vec3<float>(1)}, {.color = image.view()}, raster_cache);
    };
    for (const std::size_t f : {0, 1, 0, 1}) frame(f);
    const Allocations found = allocations_of([&] { frame(0), frame(1); });
    CHECK(found.largest < no_array);
    CHECK(found.bytes / 2 < 4096);
}
