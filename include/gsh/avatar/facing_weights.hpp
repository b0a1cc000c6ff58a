// SPDX-License-Identifier: Apache-2.0
/// @file  Sums over photographs of numbers of a body's points, and of those that a camera does not see from behind.
#pragma once

#include <gsh/body/skinning.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>

namespace gsh::detail {

/// Adds a photograph's weights of a body's Gaussians: all of them, and those whose surface it does not show from
/// behind. Gaussians without a normal have no back.
template <class T>
struct AddFacingWeights {
    SkinWeights<T> skin;
    Span<const Affine<T>> bones;
    Span<const vec3<T>> normals, means, weights; // canonical; posed; the red channel counts
    vec3<T> camera_center;
    T behind; // cosine of the angle between normal and camera below which the camera is behind
    Span<T> all, front;

    GSH_HD void operator()(std::size_t i) const {
        if (weights[i].x == T(0)) return;
        all[i] += weights[i].x;
        const vec3<T> normal = blend(skin, i, bones).linear * normals[i], towards = camera_center - means[i];
        const T squared = dot(normal, normal);
        if (squared > T(0) && dot(normal, towards) < behind * sqrt(squared * dot(towards, towards))) return;
        front[i] += weights[i].x;
    }
};

} // namespace gsh::detail
