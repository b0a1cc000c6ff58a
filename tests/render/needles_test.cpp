// SPDX-License-Identifier: Apache-2.0
/// @file  Needles: Gaussians thousands of times longer than wide, from their parameters to pixels and back, against a
///        dense renderer in long double.
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/render/cpu/rasterizer.hpp>

#include "render/needle_passes.hpp"
#include "support/gradient.hpp"
#include "support/needles.hpp"

#include <cstddef>

using namespace gsh;
using cpu::Serial;
using test::NeedlePasses;

TEST_CASE("needles agree with a dense renderer in long double") {
    Serial backend;
    for (const bool compensate : {false, true})
        for (const float length : {4.0f, 5.0f, 6.0f, 9.0f}) {
            CAPTURE(compensate);
            CAPTURE(length);
            const test::NeedleComparison comparison(length, compensate);
            CHECK(comparison.error(backend, true) < 1e-5);
            // In single precision, a covariance has no room for the thin axis.
            if (length >= 6) CHECK(comparison.error(backend, false) > 1e-3);
        }
}

TEST_CASE("the adjoint of needles: by central differences in double, and in float near to that") {
    Serial backend;
    for (const bool compensate : {false, true}) {
        CAPTURE(compensate);
        test::Rng rng(3);
        const Camera<double> camera = test::needle_camera();
        const GaussianCloud<float> narrow = test::needles(6, 6);
        GaussianCloud<double> cloud = test::in_double(narrow);
        Image<double> weights(3, camera.height, camera.width);
        for (double& w : weights.data) w = rng.uniform(-1, 1);
        const auto loss = [&] {
            const Image<double> image =
                NeedlePasses<Serial, double>(backend, cloud, camera, true, test::smooth_params<double>(compensate))
                    .picture;
            double sum = 0;
            for (std::size_t i = 0; i < image.data.size(); ++i) sum += image.data[i] * weights.data[i];
            return sum;
        };
        GaussianCloud<double> gradient = NeedlePasses<Serial, double>(backend, cloud, camera, true,
                                                                      test::smooth_params<double>(compensate), &weights)
                                             .gradient;
        test::GradientCheck check;
        check.tolerance = 1e-5;
        test::check_gradient(loss, test::scalars(cloud.log_scales), test::scalars(gradient.log_scales), check);
        test::check_gradient(loss, test::scalars(cloud.opacity_logits), test::scalars(gradient.opacity_logits), check);
        check.step = 1e-6; // a turn of a needle of 400 m
        test::check_gradient(loss, test::scalars(cloud.quats), test::scalars(gradient.quats), check);

        Image<float> in_float(3, camera.height, camera.width);
        for (std::size_t i = 0; i < weights.data.size(); ++i) in_float.data[i] = static_cast<float>(weights.data[i]);
        const GaussianCloud<float> found =
            NeedlePasses<Serial, float>(backend, narrow, camera.cast<float>(), true,
                                        test::smooth_params<float>(compensate), &in_float)
                .gradient;
        CHECK(test::relative_error(found, gradient) < 2e-4);
    }
}
