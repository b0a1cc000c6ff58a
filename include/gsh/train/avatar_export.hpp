// SPDX-License-Identifier: Apache-2.0
/// @file  Export of a trained model as AvatarData: fields are evaluated, and what depends on the time is averaged.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/pipeline/shadow.hpp>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// The frames of the photographs, each once, in the order of the photographs.
[[nodiscard]] inline std::vector<std::size_t> photographed_frames(const std::vector<Photo>& photos) {
    std::vector<std::size_t> frames;
    for (const Photo& photo : photos)
        if (std::find(frames.begin(), frames.end(), photo.frame) == frames.end()) frames.push_back(photo.frame);
    return frames;
}

/// The canonical Gaussians of a model's last update_canonical, on the host.
template <class B, class Model>
[[nodiscard]] GaussianCloud<typename Model::Scalar> canonical_gaussians(B& backend, const Model& model) {
    using T = typename Model::Scalar;
    const std::size_t N = model.size(), basis = sh_basis_count(Model::sh_degree);
    const std::size_t present = model.is_view_dependent() ? basis : 1; // the others are still what they began as
    const SkinnedView<const T> gaussians = model.gaussians();
    GaussianCloud<T> cloud(N, Model::sh_degree);
    typename B::template Buffer<vec3<T>> means(N);
    model.write_means(means);
    backend.download(Span<const vec3<T>>(means), Span<vec3<T>>(cloud.means));
    backend.download(gaussians.quats, Span<quat<T>>(cloud.quats));
    backend.download(gaussians.log_scales, Span<vec3<T>>(cloud.log_scales));
    backend.download(gaussians.opacity_logits, Span<T>(cloud.opacity_logits));
    std::vector<vec3<T>> sh(gaussians.sh.size());
    backend.download(gaussians.sh, Span<vec3<T>>(sh));
    for (std::size_t i = 0; i < N; ++i)
        std::copy_n(sh.begin() + static_cast<std::ptrdiff_t>(i * gaussians.sh_stride), present,
                    cloud.sh.begin() + static_cast<std::ptrdiff_t>(i * basis));
    return cloud;
}

/// Each Gaussian's mean ambient occlusion over `frames`, for new motions if the shadow does not follow the pose. Empty
/// without a shadow, or before it has joined.
template <class Scene>
[[nodiscard]] std::vector<typename Scene::Scalar> mean_ao(Scene& scene, const std::vector<std::size_t>& frames,
                                                          std::size_t person = 0) {
    using T = typename Scene::Scalar;
    auto& model = scene.model(person);
    if (!model.casts_shadow()) return {};
    std::vector<T> mean(model.size(), T(0)), of_frame(model.size());
    for (const std::size_t frame : frames) {
        scene.backend().download(model.ao(scene.pose(frame, person), frame), Span<T>(of_frame));
        for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += of_frame[i];
    }
    for (T& ao : mean) ao /= static_cast<T>(frames.size());
    return mean;
}

/// A person's canonical Gaussians. If colours and displacements depend on the time, each Gaussian has its mean over
/// `frames`, for new motions.
template <class Scene>
[[nodiscard]] GaussianCloud<typename Scene::Scalar> mean_gaussians(Scene& scene, std::vector<std::size_t> frames,
                                                                   std::size_t person = 0) {
    using T = typename Scene::Scalar;
    auto& model = scene.model(person);
    if (!model.appearance().reads_time()) frames.resize(1); // all frames are equal
    GaussianCloud<T> cloud;
    std::vector<vec3<double>> means, sh;
    const auto add = [](const std::vector<vec3<T>>& values, std::vector<vec3<double>>& sums) {
        sums.resize(values.size(), vec3<double>(0));
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += vec3<double>(values[i]);
    };
    for (const std::size_t frame : frames) {
        model.update_canonical(frame);
        cloud = canonical_gaussians(scene.backend(), model);
        add(cloud.means, means), add(cloud.sh, sh);
    }
    const auto count = static_cast<double>(frames.size());
    for (std::size_t i = 0; i < means.size(); ++i) cloud.means[i] = vec3<T>(means[i] / count);
    for (std::size_t i = 0; i < sh.size(); ++i) cloud.sh[i] = vec3<T>(sh[i] / count);
    return cloud;
}

/// Each Gaussian's mean irradiance over `frames`, for formats without light, with the shadows of all people. Of more
/// than 32 frames, 32 are read, evenly spread. Empty without a light.
template <class Scene>
[[nodiscard]] std::vector<typename Scene::Scalar> mean_irradiance(Scene& scene, const std::vector<std::size_t>& frames,
                                                                  std::size_t person = 0) {
    using T = typename Scene::Scalar;
    constexpr std::size_t most = 32;
    auto& model = scene.model(person);
    if (!model.light()) return {};
    Splats<typename Scene::BackendType, T> splats;
    splats.resize(scene.size());
    std::vector<T> mean(model.size(), T(0));
    std::vector<LitShading<T>> of_frame(model.size());
    const std::size_t count = std::min(frames.size(), most);
    for (std::size_t k = 0; k < count; ++k) {
        const std::size_t frame = frames[k * frames.size() / count];
        scene.prepare(frame);
        scene.forward(frame, vec3<T>(T(0)), splats.view()); // irradiance does not depend on the camera
        scene.backend().download(model.shading(), Span<LitShading<T>>(of_frame));
        for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += of_frame[i].x;
    }
    for (T& irradiance : mean) irradiance /= static_cast<T>(count);
    return mean;
}

/// A person's present avatar: `rig` with the learned joints, the canonical Gaussians, and the mean ao over `frames`.
/// A shadow that follows the pose is also exported as an occlusion field, and a light with its numbers and the mean
/// irradiance. `filter` is that of training.
template <class Scene>
[[nodiscard]] AvatarData export_avatar(Scene& scene, RigData rig, const std::vector<std::size_t>& frames,
                                       const PixelFilter& filter, std::size_t person = 0) {
    auto& model = scene.model(person);
    std::vector<vec3<float>> joints(rig.joint_count());
    AvatarData avatar{.rig = {},
                      .gaussians = mean_gaussians(scene, frames, person),
                      .clamping = model.params().clamping,
                      .filter = filter,
                      .deformation = model.params().deformation};
    scene.backend().download(model.joints(), Span<vec3<float>>(joints));
    for (std::size_t j = 0; j < joints.size(); ++j) rig.joints[j] = vec3<double>(joints[j]);
    if (model.light()) {
        avatar.light = model.light()->data();
        avatar.normal_offsets.resize(model.normal_offsets().size());
        scene.backend().download(model.normal_offsets(), Span<vec3<float>>(avatar.normal_offsets));
        avatar.light_place = place_of(scene.motion(person), rig.joints[0], frames);
    }
    avatar.rig = std::move(rig);
    avatar.ao = mean_ao(scene, frames, person);
    if (!avatar.ao.empty()) avatar.occlusion_field = baked_field(model.shadow());
    avatar.mean_irradiance = mean_irradiance(scene, frames, person);
    return avatar;
}

} // namespace gsh
