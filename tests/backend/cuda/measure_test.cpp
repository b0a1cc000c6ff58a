// SPDX-License-Identifier: Apache-2.0
/// @file  bench/device/measure.cuh on the emulation: a case whose device halts fails, instead of looking fast.
#include "../../../bench/device/measure.cuh"
#include "../../../bench/render/capsule_load.hpp"

#include <gsh/cuda.cuh>
#include <gsh/gaussian/splats.hpp>
#include <gsh/render/rasterizer.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace {

using namespace gsh;
using cuda::Device;

/// A person that is larger than the image, or so small that each splat is in one tile.
struct MeasuredPerson {
    static constexpr int size = 64;

    Device& device;
    bench::CapsuleLoad load = bench::make_person(100);
    cuda::Buffer<vec3<float>> means = bench::uploaded(device, load.means);
    cuda::Buffer<vec3<float>> colors = bench::uploaded(device, load.colors);
    cuda::Buffer<sym3<float>> covariances = bench::uploaded(device, load.covariances);
    cuda::Buffer<float> opacities = bench::uploaded(device, load.opacities), color{3 * size * size};
    Rasterizer<Device> rasterizer{device};
    Rasterizer<Device>::Cache cache;

    explicit MeasuredPerson(Device& on) : device(on) {}
    void draw(bool large) {
        Camera<float> camera = bench::make_camera(size);
        camera.fx = camera.fy = (large ? 2.0f : 0.02f) * camera.fx;
        camera.cx = camera.cy = 40; // the middle of a tile
        const SplatView<const float> splats{means, covariances, opacities, colors};
        rasterizer.forward(camera, splats, {}, {.color = ImageView<float>{color, 3, size, size}}, cache);
    }
};

struct MeasureArguments {
    std::vector<std::string> texts{"bench", "--kernels", "--runs", "3"};
    std::vector<char*> pointers;
    MeasureArguments() {
        for (std::string& text : texts) pointers.push_back(text.data());
    }
    bench::Bench parsed() { return {static_cast<int>(pointers.size()), pointers.data()}; }
};

struct HaltAtThird {
    Span<std::uint32_t> runs, halted;
    __device__ void operator()(std::size_t) const {
        if (++runs[0] == 3) halted[0] = 1;
    }
};

const char* const measure_error = "person: the device has halted, so times are too short: a run needs larger buffers "
                                  "than those before it, or has a number that is not finite";

} // namespace

TEST_CASE("Buffers of a measured case grow to what each of its inputs needs") {
    MeasureArguments arguments;
    bench::Bench bench = arguments.parsed();
    MeasuredPerson person(bench.device());
    CHECK_NOTHROW(bench.measure("person", {}, [&](int k) { person.draw(k % 2 == 1); }));
}

TEST_CASE("A measured case fails if buffers are too small for a run") {
    MeasureArguments arguments;
    bench::Bench bench = arguments.parsed();
    MeasuredPerson person(bench.device());
    // 6 runs are direct, 3 warm up, 3 are for the host's time, 3 are timed, and 3 are for the kernels' times.
    for (const int first_large : {13, 17}) {
        CAPTURE(first_large);
        bench.device().resume();
        person.cache = {};
        int runs = 0;
        const auto draw = [&](int) { person.draw(++runs >= first_large); };
        CHECK_THROWS_WITH_AS(bench.measure("person", {}, draw), measure_error, bench::Halted);
    }
}

TEST_CASE("Times of kernels are refused if a repeat of their step halts the device") {
    Device device;
    RepeatedStep<Device> repeated(device);
    cuda::Buffer<std::uint32_t> runs(1);
    device.fill(Span<std::uint32_t>(runs), 0u);
    const auto step = [&] { device.for_each(1, HaltAtThird{runs, device.halted()}); };
    repeated.run(0, step);
    repeated.run(0, step);
    CHECK_THROWS_AS((void)repeated.time_kernels(1), ValueError);
    CHECK_FALSE(has_halted(device));
}
