// SPDX-License-Identifier: Apache-2.0
/// @file  Training, refinement, pose fitting and rendering on the CUDA backend, beside cpu::Serial.
#include <gsh/backend/serial.hpp>
#include <gsh/cuda.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/small_runs.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace cuda_training { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;
using cuda::Device;

namespace {

/// PSNR of two pictures in [0, 1], and the largest difference of two lists of numbers relative to the list's largest.
double psnr_of(const Image<float>& a, const Image<float>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.data.size(); ++i) {
        const double d = static_cast<double>(a.data[i]) - static_cast<double>(b.data[i]);
        sum += d * d;
    }
    return -10 * std::log10(sum / static_cast<double>(a.data.size()) + 1e-20);
}

void check_near(const Outcome& found, const Outcome& expected, double least_psnr = 60) {
    REQUIRE(found.pictures.size() == expected.pictures.size());
    for (std::size_t i = 0; i < found.pictures.size(); ++i) {
        CAPTURE(i);
        CHECK(psnr_of(found.pictures[i], expected.pictures[i]) >= least_psnr);
    }
    REQUIRE(found.losses.size() == expected.losses.size());
    for (std::size_t i = 0; i < found.losses.size(); ++i) {
        CAPTURE(i);
        CHECK(found.losses[i] == doctest::Approx(expected.losses[i]).epsilon(2e-3).scale(1));
    }
    CHECK(found.learned.size() == expected.learned.size());
}

void check_same(const Outcome& a, const Outcome& b) {
    REQUIRE(a.pictures.size() == b.pictures.size());
    for (std::size_t i = 0; i < a.pictures.size(); ++i) CHECK(a.pictures[i].data == b.pictures[i].data);
    CHECK(a.losses == b.losses);
    CHECK(a.learned == b.learned);
}

} // namespace

TEST_CASE("an avatar trains on the device as on the CPU, and with the same bits each time") {
    if (skip_without_device()) return;
    const SmallScene scene;
    for (const AmbientOcclusion ao : {AmbientOcclusion::time, AmbientOcclusion::pose}) {
        CAPTURE(static_cast<int>(ao));
        const Outcome found = train_avatar<Device>(scene, {.ao = ao});
        check_near(found, train_avatar<cpu::Serial>(scene, {.ao = ao}));
        if (ao == AmbientOcclusion::time) check_same(found, train_avatar<Device>(scene, {.ao = ao}));
    }
}

} // namespace cuda_training
