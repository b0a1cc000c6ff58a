// SPDX-License-Identifier: Apache-2.0
/// @file  A training small enough for tests: a coloured tube of a body, filmed by two cameras in two poses.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/light/light.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/setup/avatar_export.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include "support/bodies.hpp"
#include "support/learned.hpp"

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::test {

/// Photographs of small trainings have gains, so that these are tested, too.
inline const TrainParams small_training{.gain = {.rate = 0.03}};

/// The same with a limit on the photographs in a device's memory, in bytes.
inline TrainParams with_photo_memory(std::uint64_t bytes) {
    TrainParams config = small_training;
    config.photo_memory = bytes;
    return config;
}

/// Poses, cameras and photographs. The photographs show stripes on the body. They are made by projection of many
/// surface points, without a rasterizer.
struct SmallScene {
    static constexpr int size = 48;

    BodyModel body = tube(4, 8, 6);
    std::vector<double> betas{0.2, -0.3};
    Motion motion;
    std::vector<Camera<double>> cameras;
    std::vector<std::vector<std::uint8_t>> images; // [camera, frame] RGBA
    std::vector<Photo> photos;                     // they refer to the images

    /// In small_training.cpp, because it poses the body on cpu::Serial, whose kernels nvcc does not compile.
    SmallScene();
};

/// A rate of colours with which the small scene is learned quickly.
inline constexpr double small_sh_rate = 5e-3;
/// An avatar that learns so, and whose Gaussians do not turn.
[[nodiscard]] inline ConfiguredAvatarParams quick_avatar() {
    return {.appearance = {.sh_rate = small_sh_rate}, .model = {.quat_rate = 0}};
}

/// Networks of fields at the size of tests, or the paper's.
struct SmallNetwork {
    int width = 16, hidden_layers = 1;
};
inline constexpr SmallNetwork paper_network{64, 2};

/// The same configuration with fields at the size of tests.
inline ConfiguredAvatarParams small(ConfiguredAvatarParams config, const SmallNetwork& network = {}) {
    HashGridParams& grid = config.appearance.field.grid;
    grid.base = 4, grid.growth = 2, grid.table_size = 1024, config.occlusion.grid.table_size = 1024;
    config.appearance.field.width = network.width, config.appearance.field.hidden_layers = network.hidden_layers;
    return config;
}

/// The avatar of a configuration, with fields at the size of tests.
template <class B, class T = float>
using SmallAvatar = ConfiguredAvatar<B, T, 1>;

template <class B, class T = float>
[[nodiscard]] SmallAvatar<B, T>
small_avatar(B& backend, const RigData& rig, const SurfaceSamples& samples, std::size_t frame_count, std::uint64_t seed,
             const ConfiguredAvatarParams& config, const SmallNetwork& network = {}, ModelLight<B, T> light = {}) {
    return make_avatar<B, AvatarParts, T, 4, 2, 1>(backend, rig, samples, frame_count, seed, small(config, network), {},
                                                   std::move(light));
}

/// A model's own light, or none.
template <class T = float, class B>
[[nodiscard]] ModelLight<B, T> lit_by(B& backend, const std::optional<LightData>& light) {
    if (!light) return {};
    return {std::make_shared<LearnedLight<B, T>>(backend, *light)};
}

/// A model, a scene and a trainer on the small scene's photographs.
template <class B>
struct SmallTraining {
    using Model = SmallAvatar<B>;
    using SceneType = AvatarScene<B, Model>;
    using TrainerType = Trainer<B, SceneType>;

    const SmallScene* scene;
    B backend;
    SurfaceSamples samples;
    RigData rig;
    Model model;
    SceneType people;
    TrainerType trainer;

    explicit SmallTraining(const SmallScene& small_scene, B where = B(), std::uint64_t seed = 3,
                           const ConfiguredAvatarParams& avatar = quick_avatar(),
                           const TrainParams& config = small_training, const std::optional<LightData>& light = {})
        : SmallTraining(small_scene, [&]() -> B { return std::move(where); }, seed, avatar, config, {}, light) {}
    /// On a backend that make() returns, which need not be movable.
    template <std::invocable Make>
    SmallTraining(const SmallScene& small_scene, const Make& make, std::uint64_t seed,
                  const ConfiguredAvatarParams& avatar, const TrainParams& config = small_training,
                  const SmallNetwork& network = {}, const std::optional<LightData>& light = {})
        : scene(&small_scene), backend(make()),
          samples(sample_surface(scene->body, shaped_vertices(scene->body, scene->betas),
                                 std::vector<double>(scene->body.vertex_count(), 12.0), seed)),
          rig(make_rig(scene->body, scene->betas, samples)),
          model(small_avatar(backend, rig, samples, scene->motion.frame_count(), seed, avatar, network,
                             lit_by(backend, light))),
          people(backend, model, scene->motion), trainer(backend, people, scene->photos, seed, config) {}
    SmallTraining(const SmallTraining&) = delete;

    /// A learned array's numbers.
    std::vector<float> parameters(std::string_view name) { return learned_values(backend, model, name); }
    /// The numbers of all learned arrays, one after the other.
    std::vector<float> parameters() { return learned_values(backend, model); }
    void steps(int count, double progress = 0) {
        for (int i = 0; i < count; ++i) trainer.step(progress);
    }
    /// Each Gaussian's ambient occlusion, mean over the photographed frames.
    std::vector<float> mean_ao() { return gsh::mean_ao(people, photographed_frames(trainer.photos())); }
    /// The present avatar, in the form that files store.
    AvatarData exported() {
        return export_avatar(people, rig, photographed_frames(trainer.photos()), trainer.config().filter);
    }
};

} // namespace gsh::test
