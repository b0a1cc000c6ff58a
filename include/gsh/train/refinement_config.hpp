// SPDX-License-Identifier: Apache-2.0
/// @file  What of poses, shape, expressions and cameras is refined, how fast, and how freely.
#pragma once

#include <gsh/loss/motion_terms.hpp>
#include <gsh/optim/adam.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace gsh {

/// What can be refined. A row is a frame's, a camera's, or the one row that all share.
enum class RefinementGroup : std::size_t {
    pose,               ///< [T, 3 J] turns on top of the joints' rotations, radians
    transl,             ///< [T, 3] metres
    expression,         ///< [T, E]
    betas,              ///< [1, S]
    camera_rotation,    ///< [C, 3] about the subject, radians
    camera_translation, ///< [C, 3] along the camera's axes, metres
    camera_focal,       ///< [C, 1] logarithm of a factor on both focal lengths
    camera_center,      ///< [C, 2] of the principal point, pixels
};
inline constexpr std::array<std::string_view, 8> refinement_group_names{
    "pose", "transl", "expression", "betas", "camera_rotation", "camera_translation", "camera_focal", "camera_center"};
inline constexpr std::size_t refinement_group_count = refinement_group_names.size();

/// How a group learns.
struct RefinedGroup {
    double rate = 0;         ///< about the distance that one step of Adam goes, in the group's unit; 0: it stays
    double start = 0;        ///< share of the run before which it stays: first the avatar must look like someone
    SequenceWeights terms{}; ///< beside the photometric loss, a mean over the image; two of them for frames only
};

struct RefinementConfig {
    RefinedGroup pose{.rate = 2e-3, .start = 0.1, .terms = {.pull = 1e-3}};
    RefinedGroup transl{.rate = 5e-4, .start = 0.1, .terms = {.pull = 1e-3}};
    RefinedGroup expression{.rate = 5e-3, .start = 0.1, .terms = {.pull = 1e-5}};
    RefinedGroup betas{.start = 0.1, .terms = {.pull = 1e-4}}; ///< off: learned joints and displacements do the same
    RefinedGroup camera_rotation{.rate = 2e-4, .terms = {.pull = 1e-3}}; ///< where there are cameras to refine
    RefinedGroup camera_translation{.rate = 2e-4, .terms = {.pull = 1e-3}};
    RefinedGroup camera_focal{.terms = {.pull = 1e-3}};
    RefinedGroup camera_center{.terms = {.pull = 1e-9}};
    double final_rate = 0.1;                   ///< share of its rate that each group ends with
    std::vector<double> joint_rates = {};      ///< [J] factors on the pose's rate, or empty: all 1
    std::vector<std::size_t> left_out = {};    ///< frames that do not learn and are nobody's neighbours: kept for tests
    std::vector<std::size_t> fixed_cameras{0}; ///< cameras that stay as they are
    double longest_gap = 3.5;                  ///< typical intervals beyond which frames are not neighbours
    Adam adam{.beta1 = 0.9, .beta2 = 0.99}; ///< a row sees a hundred steps, not thousands: a shorter memory of squares

    [[nodiscard]] const RefinedGroup& operator[](RefinementGroup group) const {
        switch (group) {
        case RefinementGroup::pose: return pose;
        case RefinementGroup::transl: return transl;
        case RefinementGroup::expression: return expression;
        case RefinementGroup::betas: return betas;
        case RefinementGroup::camera_rotation: return camera_rotation;
        case RefinementGroup::camera_translation: return camera_translation;
        case RefinementGroup::camera_focal: return camera_focal;
        case RefinementGroup::camera_center: break;
        }
        return camera_center;
    }
};

/// The same for frames that training has not seen, refined one by one while the avatar stays as it is: the frame's own
/// numbers, from the first step on, and twice as fast, since nothing else moves.
[[nodiscard]] inline RefinementConfig test_time_config(RefinementConfig config = {}) {
    config.left_out.clear();
    config.betas.rate = 0;
    for (RefinedGroup* group : {&config.pose, &config.transl, &config.expression}) group->start = 0, group->rate *= 2;
    return config;
}

/// Factors for RefinementConfig::joint_rates: fingers, and jaw and eyes, apart from the body. Bodies of 55 joints
/// (SMPL-X) have both, bodies of 52 (SMPL-H) hands, all others neither.
[[nodiscard]] inline std::vector<double> joint_rates(std::size_t joint_count, double fingers, double face = 1) {
    std::vector<double> rates(joint_count, 1);
    const bool has_face = joint_count == 55, has_hands = has_face || joint_count == 52;
    for (std::size_t j = 22; has_hands && j < joint_count; ++j) rates[j] = has_face && j < 25 ? face : fingers;
    return rates;
}

/// A refinement's whole state on the host, for checkpoints: plain arrays, which fit refinements of the same input only.
template <class T>
struct RefinementState {
    std::uint64_t steps = 0;
    std::vector<std::uint64_t> updates;                     ///< steps of Adam that each row of each group has taken
    std::vector<T> increments, first_moment, second_moment; ///< all numbers of all groups
};

} // namespace gsh
