// SPDX-License-Identifier: Apache-2.0
/// @file  Needles on the emulation of a GPU, against the dense renderer; their adjoint beside that of cpu::Serial, whose
///        vectors nvcc does not compile.
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/sum.cuh>
#include <gsh/backend/serial.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/cuda/rasterizer.cuh>

#include <doctest/doctest.h>

#include "render/needle_passes.hpp"
#include "support/cuda_device.hpp"
#include "support/gradient.hpp"
#include "support/needles.hpp"

namespace cuda_needles { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cpu::Serial;
using cuda::Device;
using test::NeedlePasses;

TEST_CASE("device: needles agree with a dense renderer in long double") {
    if (test::skip_without_device()) return;
    Device device;
    for (const bool compensate : {false, true})
        for (const float length : {4.0f, 6.0f, 9.0f}) {
            CAPTURE(compensate);
            CAPTURE(length);
            CHECK(test::NeedleComparison(length, compensate).error(device, true) < 1e-5);
        }
}

TEST_CASE("device: the adjoint of needles") {
    if (test::skip_without_device()) return;
    Serial serial;
    Device device;
    test::Rng rng(3);
    const Camera<double> camera = test::needle_camera();
    const GaussianCloud<float> cloud = test::needles(6, 6);
    Image<double> weights(3, camera.height, camera.width);
    for (double& w : weights.data) w = rng.uniform(-1, 1);
    Image<float> in_float(3, camera.height, camera.width);
    for (std::size_t i = 0; i < weights.data.size(); ++i) in_float.data[i] = static_cast<float>(weights.data[i]);
    for (const bool compensate : {false, true}) {
        CAPTURE(compensate);
        const auto exact = NeedlePasses<Serial, double>(serial, test::in_double(cloud), camera, true,
                                                        test::smooth_params<double>(compensate), &weights);
        const auto in_double = NeedlePasses<Device, double>(device, test::in_double(cloud), camera, true,
                                                            test::smooth_params<double>(compensate), &weights);
        const auto found = NeedlePasses<Device, float>(device, cloud, camera.cast<float>(), true,
                                                       test::smooth_params<float>(compensate), &in_float);
        CHECK(test::relative_error(in_double.gradient, exact.gradient) < 1e-9);
        CHECK(test::relative_error(found.gradient, exact.gradient) < 1e-3);
    }
}

} // namespace cuda_needles
