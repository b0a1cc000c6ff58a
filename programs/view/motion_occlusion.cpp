// SPDX-License-Identifier: Apache-2.0
#include "view/motion_occlusion.hpp"

#include "common/interrupts.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::programs {

namespace {

/// How much the ao of each Gaussian counts in a picture, and the factor from errors of ao to errors of colour.
struct OcclusionWeights {
    std::vector<float> weights; // area, opacity and square of the colour
    double colour = 0;          // root mean square over the surface
};

OcclusionWeights weights_of(const AvatarData& avatar) {
    const GaussianCloud<float>& cloud = avatar.gaussians;
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    OcclusionWeights result;
    double covered = 0, counted = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const vec3<float>& s = cloud.log_scales[i];
        const float area = std::exp(s.x + s.y + s.z - std::min({s.x, s.y, s.z})) * sigmoid(cloud.opacity_logits[i]);
        const vec3<float> color = shade<0>(cloud.sh.data() + i * basis, vec3<float>(0, 0, 1), 1.0f, avatar.clamping);
        result.weights.push_back(area * dot(color, color) / 3);
        covered += static_cast<double>(area), counted += static_cast<double>(result.weights.back());
    }
    result.colour = covered > 0 ? std::sqrt(counted / covered) : 0;
    return result;
}

} // namespace

LowRank occlusion_of_motions(cpu::Threads& backend, const AvatarData& avatar, const std::vector<ViewMotion>& motions) {
    const Rig<cpu::Threads> rig(backend, avatar.rig);
    const OcclusionField<cpu::Threads> field(backend, avatar.occlusion_field.value(), avatar.rig.point_count(),
                                             avatar.rig.joint_count());
    RigPose<cpu::Threads, float> pose;
    OcclusionField<cpu::Threads>::Cache cache;
    std::vector<mat3<float>> rotations(avatar.rig.joint_count());
    std::vector<float> ao(field.size());
    const OcclusionWeights counts = weights_of(avatar);
    LowRankRows rows(avatar.ao, counts.weights, {.tolerance = occlusion_tolerance / std::max(counts.colour, 1e-3)});
    for (const ViewMotion& motion : motions)
        for (std::size_t f = 0; f < motion.motion.frame_count() && !interrupted; ++f) {
            rig.upload_pose(motion.motion, f, pose);
            rig.skeleton().rotations(pose.pose, rotations);
            field.forward(rig.skeleton(), rotations, ao, cache);
            rows.add(ao);
        }
    LowRank result = rows.finish();
    result.error *= counts.colour;
    return result;
}

} // namespace gsh::programs
