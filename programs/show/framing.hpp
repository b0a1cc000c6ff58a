// SPDX-License-Identifier: Apache-2.0
/// @file  Places a camera so that given points fill its image.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <limits>

namespace gsh::programs {

/// Finds the position of a camera with a given direction.
///
/// Let q be a point in the axes of the camera, and h the tangent of half the angle of the image part to be filled. The
/// point lies within that part if |q + t| <= h (q + t).z for x and for y. With the minima over all points
///     low = min(h q.z + q.x),  high = min(h q.z - q.x),
/// the condition for x is -h t.z - low <= t.x <= h t.z + high. The nearest position therefore has
/// t.z = -(low + high) / 2h, computed for the axis that needs the larger distance, and t.x = (high - low) / 2.
class Framing {
public:
    /// `camera` gives direction and lens. The points will fill the share `fill` of its width or of its height.
    explicit Framing(const Camera<double>& camera, double fill = 0.92)
        : camera_(camera), half_(fill * 0.5 * camera.width / camera.fx, fill * 0.5 * camera.height / camera.fy) {
        camera_.cx = 0.5 * camera.width, camera_.cy = 0.5 * camera.height;
    }

    void add(Span<const vec3<double>> points) {
        for (const vec3<double>& point : points) {
            const vec3<double> q = camera_.R * point;
            nearest_ = std::min(nearest_, q.z);
            for (int axis = 0; axis < 2; ++axis) {
                low_[axis] = std::min(low_[axis], half_[axis] * q.z + q[axis]);
                high_[axis] = std::min(high_[axis], half_[axis] * q.z - q[axis]);
            }
        }
    }

    [[nodiscard]] Camera<double> camera() const {
        Camera<double> result = camera_;
        result.t = {0.5 * (high_.x - low_.x), 0.5 * (high_.y - low_.y),
                    std::max(-0.5 * (low_.x + high_.x) / half_.x, -0.5 * (low_.y + high_.y) / half_.y)};
        check_value(nearest_ + result.t.z > 0, "Framing", "the points lie in one spot, or there are none");
        return result;
    }

private:
    Camera<double> camera_;
    vec2<double> half_; // tangents of half the angle to fill
    vec2<double> low_ = vec2<double>(std::numeric_limits<double>::infinity()), high_ = low_;
    double nearest_ = std::numeric_limits<double>::infinity();
};

} // namespace gsh::programs
