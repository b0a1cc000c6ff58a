// SPDX-License-Identifier: Apache-2.0
/// @file  Small avatars for tests of gsh-view, made without training, and the pictures of gsh's own renderer.
#pragma once

#include "io/temporary.hpp"
#include "support/bodies.hpp"

#include "common/machine.hpp"
#include "show/light_option.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"
#include "view/view_request.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/light/light.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// An avatar of about `count` patterned Gaussians on a body, without light.
inline AvatarData patterned_avatar(const BodyModel& body, const std::vector<double>& betas, double count, int degree) {
    Rng rng(5);
    const auto vertices = shaped_vertices(body, betas);
    const std::vector<double> each(body.vertex_count(), count / static_cast<double>(body.vertex_count()));
    const SurfaceSamples samples = sample_surface(body, vertices, each, 4);
    AvatarData avatar;
    avatar.rig = make_rig(body, betas, samples);
    avatar.gaussians.sh_degree = degree;
    for (std::size_t i = 0; i < samples.size(); ++i) {
        const vec3<double>& p = samples.positions[i];
        const auto number = [&](double low, double high) { return static_cast<float>(rng.uniform(low, high)); };
        avatar.gaussians.means.push_back(vec3<float>(p));
        avatar.gaussians.quats.push_back({number(-1, 1), number(-1, 1), number(-1, 1), 1});
        const double size = std::log(0.8 * samples.scales[i]);
        avatar.gaussians.log_scales.push_back(
            {number(size - 0.7, size + 0.3), number(size - 0.7, size + 0.3), number(size - 0.7, size + 0.3)});
        avatar.gaussians.opacity_logits.push_back(number(0, 3));
        avatar.gaussians.sh.push_back(sh_of_color(vec3<float>(static_cast<float>(0.5 + 0.35 * std::sin(19 * p.y)),
                                                              static_cast<float>(0.5 + 0.35 * std::sin(17 * p.x)),
                                                              static_cast<float>(0.6 + 0.3 * std::sin(9 * p.z)))));
        for (int k = 1; k < (degree + 1) * (degree + 1); ++k)
            avatar.gaussians.sh.push_back({number(-0.1, 0.1), number(-0.1, 0.1), number(-0.1, 0.1)});
    }
    return avatar;
}

/// The coarse actor in a light with shadows and gloss, blended linearly.
inline AvatarData lit_actor(double count = 5000) {
    Rng rng(6);
    const BodyModel body = make_actor({.edge_scale = 1.5});
    std::vector<double> betas(static_cast<std::size_t>(body.shape_count), 0.3);
    AvatarData avatar = patterned_avatar(body, betas, count, 2);
    LightData light = even_light(0, 6, {0, 0, 0}, 1);
    light.points = {{1.5, 1.6, 1.5}, {-2.0, 1.0, 1.0}};
    light.log_intensities.insert(light.log_intensities.begin(), {1.5, 0.8});
    for (std::size_t k = 2; k < light.log_intensities.size(); ++k) light.log_intensities[k] -= 1.2;
    light.gloss = {std::log(0.05), std::log(15.0)};
    avatar.light = light;
    for (std::size_t v = 0; v < body.vertex_count(); ++v)
        avatar.normal_offsets.push_back(vec3<float>(rng.vec(-0.15, 0.15)));
    avatar.light_place = place_of(actor_motion(ActorMotion::stride, 4), avatar.rig.joints[0]);
    return avatar;
}

/// A tube with blend shapes of the pose, bands of degree 3 and ambient occlusion.
inline AvatarData bending_tube(Deformation deformation) {
    AvatarData avatar = patterned_avatar(tube(4, 16, 12), {0.2, -0.3}, 1500, 3);
    avatar.deformation = deformation;
    avatar.filter = {.dilation = 0.1, .compensate_opacity = true};
    for (std::size_t i = 0; i < avatar.gaussians.size(); ++i)
        avatar.ao.push_back(0.6f + 0.4f * static_cast<float>(i % 7) / 6.0f);
    return avatar;
}

/// A tube whose ambient occlusion follows the pose, by a network of random weights.
inline AvatarData occluded_tube() {
    Rng rng(41);
    AvatarData avatar = patterned_avatar(tube(4, 16, 12), {0.2, -0.3}, 1500, 1);
    OcclusionFieldData field{.width = 16, .hidden_layers = 2, .bias = 0.5, .largest = 1.2};
    const auto fill = [&](std::vector<float>& numbers, std::size_t count, double most) {
        for (std::size_t k = 0; k < count; ++k) numbers.push_back(static_cast<float>(rng.uniform(-most, most)));
    };
    fill(field.neurons, avatar.gaussians.size() * 16, 1);
    fill(field.pose_weights, 16 * 27, 0.8);
    fill(field.weights, field.network().parameter_count(), 0.6);
    avatar.occlusion_field = field;
    avatar.ao.assign(avatar.gaussians.size(), 0.8f);
    return avatar;
}

/// A motion of the tube.
inline Motion tube_motion(double side) {
    Rng rng(31);
    Motion motion;
    motion.joint_count = 4, motion.expression_count = 2, motion.betas = {0.5, 0.1};
    for (std::size_t t = 0; t < 3; ++t) {
        for (std::size_t j = 0; j < 4; ++j) motion.pose.push_back(rng.vec(-0.5, 0.5));
        motion.expression.insert(motion.expression.end(), {0.4 * static_cast<double>(t), 0.5});
        motion.transl.push_back({side, 0, 0.1 * static_cast<double>(t)});
        motion.timestamps.push_back(0.1 * static_cast<double>(t));
    }
    return motion;
}

/// Files of all scenes in a folder of their own.
struct ViewFiles {
    Temporary folder;
    std::filesystem::path actor = folder / "actor.gsh", stride = folder / "stride.npz", reach = folder / "reach.npz",
                          polar = folder / "polar.gsh", dual = folder / "dual.gsh", left = folder / "left.npz",
                          right = folder / "right.npz", cloud = folder / "cloud.ply",
                          occluded = folder / "occluded.gsh";

    ViewFiles() {
        save_avatar(actor, lit_actor());
        save_motion(stride, actor_motion(ActorMotion::stride, 4));
        save_motion(reach, actor_motion(ActorMotion::reach, 3));
        save_avatar(polar, bending_tube(Deformation::polar));
        save_avatar(dual, bending_tube(Deformation::dual_quaternion));
        save_avatar(occluded, occluded_tube());
        save_motion(left, tube_motion(-0.5));
        save_motion(right, tube_motion(0.5));
        write_gaussian_ply(cloud, bending_tube(Deformation::linear).gaussians);
    }
};
inline const ViewFiles& view_files() {
    static const ViewFiles instance;
    return instance;
}

[[nodiscard]] inline programs::ViewScene view_scene(const std::vector<std::filesystem::path>& files,
                                                    const std::vector<std::filesystem::path>& poses = {}) {
    std::vector<std::string> warnings;
    return programs::load_view_scene(files, poses, {}, {}, warnings);
}

/// The picture that gsh-animate would write of the people of a request.
[[nodiscard]] inline Image<float> rendered(const programs::ViewScene& scene, const programs::ViewRequest& request) {
    programs::BackendOption option;
    option.threads = 2;
    programs::Machine machine(option);
    if (!scene.people) return make_renderer(machine, scene.cloud)->render(0, request.camera, request.background);
    programs::ShownPeople people = *scene.people;
    people.motions = request.people;
    return make_renderer(machine, people)->render(0, request.camera, request.background);
}

} // namespace gsh::test
