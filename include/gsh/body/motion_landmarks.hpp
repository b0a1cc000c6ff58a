// SPDX-License-Identifier: Apache-2.0
/// @file  Where a motion's landmarks are in the world.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_bones.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <vector>

namespace gsh {

/// World positions of a motion's landmarks.
class MotionLandmarks {
public:
    /// marks are the body's (landmarks_of).
    MotionLandmarks(const BodyModel& model, const Motion& motion, const Landmarks& marks) : marks_(marks) {
        for_each_pose(model, motion, [&](std::size_t, Span<const Affine<double>> bones, Span<const vec3<double>> rest) {
            for (const Landmark& mark : marks_) {
                const auto j = static_cast<std::size_t>(mark.joint);
                places_.push_back(mark.joint < 0 ? vec3<double>(0) : bones[j](rest[j] + mark.offset));
            }
        });
    }

    /// Whether the body has a landmark.
    [[nodiscard]] bool has(int landmark) const { return marks_[static_cast<std::size_t>(landmark)].joint >= 0; }
    [[nodiscard]] const vec3<double>& at(std::size_t frame, int landmark) const {
        return places_[frame * marks_.size() + static_cast<std::size_t>(landmark)];
    }

private:
    Landmarks marks_;
    std::vector<vec3<double>> places_; // [T, landmarks]
};

} // namespace gsh
