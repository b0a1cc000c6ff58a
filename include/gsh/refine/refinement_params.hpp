// SPDX-License-Identifier: Apache-2.0
/// @file  Settings of refinement: which of poses, shape, expressions and cameras learn, and their rates and terms.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/loss/motion_terms.hpp>
#include <gsh/optim/adam.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// The groups that can be refined. A row belongs to a frame, to a camera, or to all frames. A bias is added to the
/// increments of every frame: errors that an estimator makes in all frames alike are then learned from all of them.
enum class RefinementGroup : std::size_t {
    pose,                   ///< [T, 3 J] rotations after those of the joints, radians
    transl,                 ///< [T, 3] metres
    expression,             ///< [T, E]
    betas,                  ///< [1, S]
    pose_bias,              ///< [1, 3 J] radians
    transl_bias,            ///< [1, 3] metres
    camera_rotation,        ///< [C, 3] about the subject, radians
    camera_translation,     ///< [C, 3] along the camera's axes, metres
    camera_focal,           ///< [C, 1] logarithm of a factor on both focal lengths
    camera_principal_point, ///< [C, 2] pixels
};
inline constexpr std::array<std::string_view, 10> refinement_group_names{
    "pose",        "transl",          "expression",         "betas",        "pose_bias",
    "transl_bias", "camera_rotation", "camera_translation", "camera_focal", "camera_principal_point"};
inline constexpr std::size_t refinement_group_count = refinement_group_names.size();

/// Settings of a group.
struct RefinedGroup {
    double rate = 0;         ///< about the change per step of Adam, in the group's unit; 0: the group is fixed
    double start = 0;        ///< share of the run before which it is fixed; the avatar learns a rough look first
    SequenceWeights terms{}; ///< beside the photometric loss, a mean over the image; of frames also drift, acceleration
};

/// Settings of a refinement.
struct RefinementParams {
    RefinedGroup pose{.rate = 2e-3, .start = 0.1, .terms = {.pull = 1e-3}};
    RefinedGroup transl{.rate = 5e-4, .start = 0.1, .terms = {.pull = 1e-3}};
    RefinedGroup expression{.rate = 5e-3, .start = 0.1, .terms = {.pull = 1e-5}};
    RefinedGroup betas{.start = 0.1, .terms = {.pull = 1e-4}}; ///< off: learned joints and displacements act alike
    RefinedGroup pose_bias{}, transl_bias{}; ///< off: registration finds them before training
    RefinedGroup camera_rotation{.rate = 2e-4, .terms = {.pull = 1e-3}}; ///< if there are cameras to refine
    RefinedGroup camera_translation{.rate = 2e-4, .terms = {.pull = 1e-3}};
    RefinedGroup camera_focal{.terms = {.pull = 1e-3}};
    RefinedGroup camera_principal_point{.terms = {.pull = 1e-9}};
    double final_rate = 0.1;                   ///< final share of each group's rate
    double finger_rate = 1;                    ///< of runs, which make joint_rates of it: a factor at fingers
    double face_rate = 1;                      ///< the same at jaw and eyes
    std::vector<double> joint_rates = {};      ///< [J] factors on the pose's rate; empty: all 1
    std::vector<std::size_t> left_out = {};    ///< test frames: they do not learn, and terms between frames skip them
    std::vector<std::size_t> fixed_cameras{0}; ///< cameras that do not learn
    double longest_gap = 3.5;                  ///< in typical intervals; frames further apart are not neighbours
    Adam adam{.beta1 = 0.9, .beta2 = 0.99}; ///< a row takes about a hundred steps: a shorter memory of squares

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        const auto group = [&](const std::string& name, auto& how, bool in_time) {
            f(name + ".rate", how.rate, SettingRange::at_least(0));
            f(name + ".start", how.start, SettingRange::at_least(0));
            f(name + ".pull", how.terms.pull, SettingRange::at_least(0));
            if (!in_time) return;
            f(name + ".drift", how.terms.drift, SettingRange::at_least(0));
            f(name + ".acceleration", how.terms.acceleration, SettingRange::at_least(0));
        };
        group("refine.pose", self.pose, true);
        group("refine.transl", self.transl, true);
        group("refine.expression", self.expression, true);
        group("refine.betas", self.betas, false);
        group("refine.camera_rotation", self.camera_rotation, false);
        group("refine.camera_translation", self.camera_translation, false);
        group("refine.camera_focal", self.camera_focal, false);
        group("refine.camera_principal_point", self.camera_principal_point, false);
        f("refine.fingers", self.finger_rate, SettingRange::at_least(0));
        f("refine.face", self.face_rate, SettingRange::at_least(0));
        f("refine.final", self.final_rate, SettingRange::above(0).up_to(1));
    }

    [[nodiscard]] const RefinedGroup& operator[](RefinementGroup group) const {
        switch (group) {
        case RefinementGroup::pose: return pose;
        case RefinementGroup::transl: return transl;
        case RefinementGroup::expression: return expression;
        case RefinementGroup::betas: return betas;
        case RefinementGroup::pose_bias: return pose_bias;
        case RefinementGroup::transl_bias: return transl_bias;
        case RefinementGroup::camera_rotation: return camera_rotation;
        case RefinementGroup::camera_translation: return camera_translation;
        case RefinementGroup::camera_focal: return camera_focal;
        case RefinementGroup::camera_principal_point: break;
        }
        return camera_principal_point;
    }
};
/// The former name of RefinementParams.
using RefinementConfig [[deprecated("use RefinementParams")]] = RefinementParams;

/// Throws ShapeError or ValueError unless rates, starts and weights are finite and not negative, final_rate is in
/// (0, 1], joint_rates has one factor per joint, and the fixed cameras exist. `left_out` is checked by link_frames.
/// `where` appears in the message.
inline void validate(const RefinementParams& config, std::size_t joint_count, std::size_t camera_count,
                     std::string_view where) {
    for (std::size_t g = 0; g < refinement_group_count; ++g) {
        const RefinedGroup& group = config[static_cast<RefinementGroup>(g)];
        const std::string name(refinement_group_names[g]);
        const SequenceWeights& w = group.terms;
        for (const double number : {group.rate, group.start, w.pull, w.drift, w.acceleration})
            check_value(number >= 0 && std::isfinite(number), where,
                        name + " has a rate, start or weight that is negative or not finite");
        check_value(g < static_cast<std::size_t>(RefinementGroup::betas) || (w.drift == 0 && w.acceleration == 0),
                    where,
                    name + " has a weight on drift or acceleration, but only frames follow each other in time; "
                           "give it a pull");
    }
    if (!config.joint_rates.empty())
        check_size(where, "joint_rates", config.joint_rates.size(), joint_count, "one factor per joint, or none");
    for (const double rate : config.joint_rates)
        check_value(rate >= 0 && std::isfinite(rate), where,
                    "joint_rates holds a factor that is negative or not finite");
    check_value(config.final_rate > 0 && config.final_rate <= 1, where, "final_rate must lie in (0, 1]");
    for (const std::size_t camera : config.fixed_cameras) // the default contains camera 0 even without cameras
        check_value(camera == 0 || camera < camera_count, where,
                    "fixed_cameras contains camera " + std::to_string(camera) + "; there are " +
                        std::to_string(camera_count) + " cameras");
}

/// Settings for frames that training has not used. Each is refined alone, with a fixed avatar. Only the frame's own
/// rows learn, from the first step on, at twice the rate, because nothing else moves.
[[nodiscard]] inline RefinementParams test_time_params(RefinementParams config = {}) {
    config.left_out.clear();
    config.betas.rate = config.pose_bias.rate = config.transl_bias.rate = 0;
    for (RefinedGroup* group : {&config.pose, &config.transl, &config.expression}) group->start = 0, group->rate *= 2;
    return config;
}

/// Factors for RefinementParams::joint_rates, with own factors for fingers and for jaw and eyes. Bodies of 55 joints
/// (SMPL-X) have both, bodies of 52 (SMPL-H) have fingers, all others have neither.
[[nodiscard]] inline std::vector<double> joint_rates(std::size_t joint_count, double fingers, double face = 1) {
    std::vector<double> rates(joint_count, 1);
    const bool has_face = joint_count == 55, has_hands = has_face || joint_count == 52;
    for (std::size_t j = 22; has_hands && j < joint_count; ++j) rates[j] = has_face && j < 25 ? face : fingers;
    return rates;
}

/// The whole state of a refinement on the host, for checkpoints. It fits only refinements of the same input.
template <class T>
struct RefinementState {
    std::uint64_t steps = 0;
    std::vector<std::uint64_t> updates;                     ///< steps of Adam that each row of each group has taken
    std::vector<T> increments, first_moment, second_moment; ///< all numbers of all groups
};

} // namespace gsh
