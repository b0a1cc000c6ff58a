// SPDX-License-Identifier: Apache-2.0
/// @file  Export of a trained model as AvatarData: fields are evaluated, and what depends on the time is averaged.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/occlusion.hpp>
#include <gsh/photo/photo.hpp>

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

namespace detail {

/// Calls f(first, values) for an array in a backend's memory, piece by piece on the host. `first` is the index of a
/// piece's first element. The copy of a piece is small, where that of all coefficients takes tens of megabytes.
template <Backend B, class Element, class F>
void for_each_piece(B& backend, Span<const Element> array, const F& f) {
    constexpr std::size_t size = 1 << 14;
    std::vector<Element> host(std::min(size, array.size()));
    for (std::size_t first = 0; first < array.size(); first += size) {
        const Span<const Element> piece = array.subspan(first, std::min(size, array.size() - first));
        backend.download(piece, Span<Element>(host).subspan(0, piece.size()));
        f(first, Span<const Element>(host).subspan(0, piece.size()));
    }
}

/// Finds a model's coefficients of spherical harmonics in a cloud, whose rows have no padding.
struct ShRows {
    std::size_t stride; ///< of the model's rows
    std::size_t used;   ///< coefficients of a row; further bands are still what they began as
    std::size_t basis;  ///< of the cloud's rows

    template <class Model>
    explicit ShRows(const Model& model)
        : stride(model.gaussians().sh_stride), used(model.is_view_dependent() ? sh_basis_count(Model::sh_degree) : 1),
          basis(sh_basis_count(Model::sh_degree)) {}

    /// The model's coefficient `index` in the cloud; nullptr for one that the cloud does not have.
    template <class T>
    [[nodiscard]] vec3<T>* find(GaussianCloud<T>& cloud, std::size_t index) const {
        const std::size_t column = index % stride;
        return column < used ? &cloud.sh[index / stride * basis + column] : nullptr;
    }
};

} // namespace detail

/// The canonical Gaussians of a model's last update_canonical, on the host.
template <class B, class Model>
[[nodiscard]] GaussianCloud<typename Model::Scalar> canonical_gaussians(B& backend, const Model& model) {
    using T = typename Model::Scalar;
    const std::size_t N = model.size();
    const SkinnedView<const T> gaussians = model.gaussians();
    GaussianCloud<T> cloud(N, Model::sh_degree);
    typename B::template Buffer<vec3<T>> means(N);
    model.write_means(means);
    backend.download(Span<const vec3<T>>(means), Span<vec3<T>>(cloud.means));
    backend.download(gaussians.quats, Span<quat<T>>(cloud.quats));
    backend.download(gaussians.log_scales, Span<vec3<T>>(cloud.log_scales));
    backend.download(gaussians.opacity_logits, Span<T>(cloud.opacity_logits));
    const detail::ShRows rows(model);
    detail::for_each_piece(backend, gaussians.sh, [&](std::size_t first, Span<const vec3<T>> sh) {
        for (std::size_t i = 0; i < sh.size(); ++i)
            if (vec3<T>* to = rows.find(cloud, first + i)) *to = sh[i];
    });
    return cloud;
}

/// Each Gaussian's mean ambient occlusion over `frames`, for new motions if it does not follow the pose. Empty without
/// ambient occlusion, or before it has joined.
template <class Scene>
[[nodiscard]] std::vector<typename Scene::Scalar> mean_ao(Scene& scene, const std::vector<std::size_t>& frames,
                                                          std::size_t person = 0) {
    using T = typename Scene::Scalar;
    auto& model = scene.model(person);
    if (!model.occludes()) return {};
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
    using B = typename Scene::BackendType;
    auto& model = scene.model(person);
    if (!model.appearance().reads_time()) frames.resize(1); // all frames are equal
    B& backend = scene.backend();
    std::vector<vec3<double>> means, sh; // sums
    const auto add = [&](Span<const vec3<T>> values, std::vector<vec3<double>>& sums) {
        sums.resize(values.size(), vec3<double>(0));
        detail::for_each_piece(backend, values, [&](std::size_t first, Span<const vec3<T>> piece) {
            for (std::size_t i = 0; i < piece.size(); ++i) sums[first + i] += vec3<double>(piece[i]);
        });
    };
    typename B::template Buffer<vec3<T>> of_frame(model.size());
    for (const std::size_t frame : frames) {
        model.update_canonical(frame);
        model.write_means(of_frame);
        add(Span<const vec3<T>>(of_frame), means), add(model.gaussians().sh, sh);
    }
    GaussianCloud<T> cloud = canonical_gaussians(backend, model); // what does not depend on the time
    const detail::ShRows rows(model);
    const auto count = static_cast<double>(frames.size());
    for (std::size_t i = 0; i < means.size(); ++i) cloud.means[i] = vec3<T>(means[i] / count);
    for (std::size_t i = 0; i < sh.size(); ++i)
        if (vec3<T>* to = rows.find(cloud, i)) *to = vec3<T>(sh[i] / count);
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
/// Ambient occlusion that follows the pose is also exported as an occlusion field, and a light with its numbers and the
/// mean irradiance. `filter` is that of training.
template <class Scene>
[[nodiscard]] AvatarData export_avatar(Scene& scene, const RigData& rig, const std::vector<std::size_t>& frames,
                                       const PixelFilter& filter, std::size_t person = 0) {
    auto& model = scene.model(person);
    std::vector<vec3<float>> joints(rig.joint_count());
    GaussianCloud<float> gaussians = mean_gaussians(scene, frames, person); // takes most memory, so it comes first
    AvatarData avatar{.rig = rig,
                      .gaussians = std::move(gaussians),
                      .clamping = model.params().clamping,
                      .filter = filter,
                      .deformation = model.params().deformation};
    scene.backend().download(model.joints(), Span<vec3<float>>(joints));
    for (std::size_t j = 0; j < joints.size(); ++j) avatar.rig.joints[j] = vec3<double>(joints[j]);
    if (model.light()) {
        avatar.light = model.light()->data();
        avatar.normal_offsets = downloaded(scene.backend(), model.normal_offsets());
        avatar.light_place = place_of(scene.motion(person), avatar.rig.joints[0], frames);
    }
    avatar.ao = mean_ao(scene, frames, person);
    if (!avatar.ao.empty()) avatar.occlusion_field = baked_field(model.occlusion());
    avatar.mean_irradiance = mean_irradiance(scene, frames, person);
    return avatar;
}

} // namespace gsh
