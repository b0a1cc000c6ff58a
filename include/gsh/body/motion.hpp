// SPDX-License-Identifier: Apache-2.0
/// @file  Poses over time, and the ways other programs write them down.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// What a body does over T frames, on the host and in double.
///
/// Shapes  stand at each member; J joints, E expression coefficients, S shape coefficients.
/// Units   radians (axis times angle, relative to the parent joint), metres, seconds.
struct Motion {
    std::size_t joint_count = 0;      ///< J
    std::size_t expression_count = 0; ///< E
    std::vector<double> betas;        // [S], one shape for all frames
    std::vector<vec3<double>> pose;   // [T, J] axis-angle, mean hand already added
    std::vector<double> expression;   // [T, E]
    std::vector<vec3<double>> transl; // [T]
    std::vector<double> timestamps;   // [T]

    [[nodiscard]] std::size_t frame_count() const { return transl.size(); }
    [[nodiscard]] Span<const vec3<double>> pose_at(std::size_t frame) const {
        return Span<const vec3<double>>(pose).subspan(frame * joint_count, joint_count);
    }
    [[nodiscard]] Span<const double> expression_at(std::size_t frame) const {
        return Span<const double>(expression).subspan(frame * expression_count, expression_count);
    }
};

} // namespace gsh
