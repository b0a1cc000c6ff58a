// SPDX-License-Identifier: Apache-2.0
/// @file  Finds feet of a retargeted body that slide over the ground while those of the source stand.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_map.hpp>
#include <gsh/body/rest_pose.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh {

/// Finds how far a body's feet move while those of the rig stand.
class FootSlide {
public:
    /// `joints` are the body's rest positions, `leg` the height of its hips above the ankles, `scale` the factor from
    /// the rig's positions to the body's. rig, body and joints must outlive this object.
    FootSlide(const RigMotion& rig, const BodyModel& body, const MatchedJoints& source, const MatchedJoints& target,
              const std::vector<vec3<double>>& joints, double leg, double scale);
    /// Frames in order: the body's world rotations [J], and the position of its root.
    void add(std::size_t frame, const std::vector<mat3<double>>& world, const vec3<double>& root);
    /// The longest way in metres, along the ground.
    [[nodiscard]] double longest() const { return longest_; }
    /// Height of the body's lower ankle in the frame that was added last; infinite without ankles.
    [[nodiscard]] double lower_ankle() const { return lower_ankle_; }

private:
    struct Foot {
        int source = -1, target = -1;
        double ground = 0;           ///< lowest height of the rig's joint
        bool stands = false;         ///< in the frame before
        vec3<double> before{0.0};    ///< the rig's joint in the frame before
        vec3<double> start{0.0};     ///< the body's joint when the foot began to stand
        vec3<double> own_start{0.0}; ///< the rig's
    };
    const RigMotion& rig_;
    const BodyModel& body_;
    const std::vector<vec3<double>>& joints_;
    double scale_, leg_, longest_ = 0, lower_ankle_ = 0;
    std::vector<Foot> feet_;
};

// -------------------------------------------------------------------------------------------------------------

inline FootSlide::FootSlide(const RigMotion& rig, const BodyModel& body, const MatchedJoints& source,
                            const MatchedJoints& target, const std::vector<vec3<double>>& joints, double leg,
                            double scale)
    : rig_(rig), body_(body), joints_(joints), scale_(scale), leg_(leg) {
    for (const char* name : {"left_ankle", "right_ankle"}) {
        Foot foot{detail::matched_joint(source, name), detail::matched_joint(target, name)};
        if (foot.source < 0 || foot.target < 0) continue;
        foot.ground = std::numeric_limits<double>::infinity();
        for (std::size_t t = 0; t < rig.frame_count(); ++t)
            foot.ground = std::min(foot.ground, rig.joint(t, foot.source).y * scale);
        feet_.push_back(foot);
    }
}

inline void FootSlide::add(std::size_t frame, const std::vector<mat3<double>>& world, const vec3<double>& root) {
    const double elapsed = frame > 0 ? rig_.timestamps[frame] - rig_.timestamps[frame - 1] : 0;
    lower_ankle_ = std::numeric_limits<double>::infinity();
    for (Foot& foot : feet_) {
        const vec3<double> own = rig_.joint(frame, foot.source) * scale_;
        vec3<double> here = root;
        for (auto j = static_cast<std::size_t>(foot.target); body_.parents[j] >= 0;
             j = static_cast<std::size_t>(body_.parents[j])) {
            const auto p = static_cast<std::size_t>(body_.parents[j]);
            here += world[p] * (joints_[j] - joints_[p]);
        }
        lower_ankle_ = std::min(lower_ankle_, here.y);
        const bool slow = elapsed > 0 && length(own - foot.before) < 0.15 * leg_ * elapsed;
        const bool stands = slow && own.y < foot.ground + 0.06 * leg_;
        if (stands && !foot.stands) foot.start = here, foot.own_start = own;
        if (stands) {
            vec3<double> way = (here - foot.start) - (own - foot.own_start);
            way.y = 0;
            longest_ = std::max(longest_, length(way));
        }
        foot.stands = stands;
        foot.before = own;
    }
}

} // namespace gsh
