// SPDX-License-Identifier: Apache-2.0
/// @file  The ambient occlusion of an avatar's motions for a page, as a low-rank product.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/math/low_rank.hpp>

#include <vector>

namespace gsh {
struct AvatarData;
}

namespace gsh::programs {

struct ViewMotion;

/// The error of a page's ambient occlusion that is allowed: root mean square over the person's surface, in colours from
/// 0 to 1. This is half a step of an 8-bit picture, or 54 dB. An avatar that is 40 dB from its photographs loses
/// 0.16 dB by it, one that is 35 dB from them 0.05 dB.
inline constexpr double occlusion_tolerance = 0.5 / 255;

/// Evaluates the occlusion field of an avatar in all frames of its motions, one motion after the other. The result's
/// base is the avatar's mean (AvatarData::ao), its error one of colours. A Gaussian counts by its area, opacity and
/// colour. Stops early if the program is interrupted.
///
/// Errors  ShapeError for motions of another skeleton.
[[nodiscard]] LowRank occlusion_of_motions(cpu::Threads& backend, const AvatarData& avatar,
                                           const std::vector<ViewMotion>& motions);

} // namespace gsh::programs
