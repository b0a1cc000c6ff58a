// SPDX-License-Identifier: Apache-2.0
/// @file  Frequency encoding of a number: sines and cosines of doubling frequency, then the number itself.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

#include <numbers>

namespace gsh {

/// γ(t) = (sin πt, cos πt, sin 2πt, cos 2πt, …, sin 2^(O-1) πt, cos 2^(O-1) πt, t) and its adjoint.
///
/// Shapes  features [2 * Octaves + 1].
/// Units   t in [0, 1) is half a period of the slowest wave.
/// Errors  none, this is kernel code.
/// Source  Mildenhall et al., "NeRF", 2020, equation 4, with t itself appended.
template <int Octaves>
    requires(Octaves >= 0)
struct FrequencyEncoding {
    static constexpr int output_count = 2 * Octaves + 1;

    template <Lane T>
    GSH_HD static void forward(T t, T* features) {
        auto frequency = std::numbers::pi_v<ScalarOf<T>>;
        for (int i = 0; i < Octaves; ++i, frequency *= 2) {
            features[2 * i] = sin(T(frequency) * t);
            features[2 * i + 1] = cos(T(frequency) * t);
        }
        features[2 * Octaves] = t;
    }

    /// Adds to dL_dt.
    template <Lane T>
    GSH_HD static void backward(T t, const T* dL_dfeatures, T& dL_dt) {
        auto frequency = std::numbers::pi_v<ScalarOf<T>>;
        for (int i = 0; i < Octaves; ++i, frequency *= 2)
            dL_dt += T(frequency) * (dL_dfeatures[2 * i] * cos(T(frequency) * t) -
                                     dL_dfeatures[2 * i + 1] * sin(T(frequency) * t));
        dL_dt += dL_dfeatures[2 * Octaves];
    }
};

} // namespace gsh
