// SPDX-License-Identifier: Apache-2.0
/// @file  A training small enough for tests: a coloured tube of a body, filmed by two cameras in two poses.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/pipeline/configured_avatar.hpp>
#include <gsh/train/avatar_export.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include "support/bodies.hpp"
#include "support/learned.hpp"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::test {

/// Photographs of small trainings have gains, so that these are tested, too.
inline const TrainConfig small_training{.gain = {.rate = 0.03}};

/// The same with a limit on the photographs in a device's memory, in bytes.
inline TrainConfig with_photo_memory(std::uint64_t bytes) {
    TrainConfig config = small_training;
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
    std::vector<PixelImage> images;
    std::vector<Photo> photos;

    SmallScene() {
        Rng rng(21);
        motion.joint_count = 4;
        motion.expression_count = 2;
        motion.betas = betas;
        for (int frame = 0; frame < 2; ++frame) {
            for (const auto& angle : rng.vecs(4, -0.4, 0.4)) motion.pose.push_back(angle);
            motion.expression.insert(motion.expression.end(), {0.2 * frame, 0.5});
            motion.transl.push_back(vec3<double>(0.0));
            motion.timestamps.push_back(frame);
        }
        for (const double side : {-0.7, 0.8})
            cameras.push_back(look_at<double>({side, 1.0, 3.5}, {0, 0.8, 0}, {0, 1, 0}, 0.5, size, size));
        const auto samples =
            sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 400.0), 4);
        const RigData rig = make_rig(body, betas, samples);
        cpu::Serial backend;
        Rig<cpu::Serial, double> mover(backend, rig);
        RigPose<cpu::Serial, double> pose;
        typename Rig<cpu::Serial, double>::Cache cache;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t f = 0; f < 2; ++f) {
                mover.upload_pose(motion, f, pose);
                mover.forward(pose, rig.joints, cache);
                auto points = samples.positions;
                mover.add_offsets(cache, points);
                images.push_back(photograph(cameras[c], points, samples, mover, cache));
            }
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t f = 0; f < 2; ++f)
                photos.push_back(
                    {"cam" + std::to_string(c) + "_" + std::to_string(f), cameras[c], f, images[2 * c + f].data, c});
    }

private:
    template <class RigType>
    PixelImage photograph(const Camera<double>& camera, const std::vector<vec3<double>>& canonical,
                          const SurfaceSamples& samples, const RigType& mover,
                          const typename RigType::Cache& cache) const {
        PixelImage image(4, size, size);
        std::vector<double> depth(size * size, 1e9);
        for (std::size_t i = 0; i < canonical.size(); ++i) {
            const auto p =
                to_camera(camera, blend(mover.skin(), i, Span<const Affine<double>>(cache.bones))(canonical[i]));
            const auto at = to_pixel(camera, p);
            const int x = static_cast<int>(std::floor(at.x)), y = static_cast<int>(std::floor(at.y));
            if (x < 0 || y < 0 || x >= size || y >= size) continue;
            double& nearest = depth[static_cast<std::size_t>(y * size + x)];
            if (p.z >= nearest) continue;
            nearest = p.z;
            const double stripe = 0.5 + 0.4 * std::sin(20 * samples.positions[i].y);
            std::uint8_t* pixel = image.pixel(y, x);
            pixel[0] = static_cast<std::uint8_t>(255 * stripe);
            pixel[1] = static_cast<std::uint8_t>(120);
            pixel[2] = static_cast<std::uint8_t>(255 * (1 - stripe));
            pixel[3] = 255;
        }
        return image;
    }
};

/// Learning rates with which the small scene is learned quickly.
inline constexpr LearningRates small_rates{.quats = 0, .sh = 5e-3};

/// Networks of fields at the size of tests, or the paper's.
struct SmallNetwork {
    int width = 16, hidden_layers = 1;
};
inline constexpr SmallNetwork paper_network{64, 2};

/// The same configuration with fields at the size of tests.
inline AvatarConfig small(AvatarConfig config, const SmallNetwork& network = {}) {
    config.hash_base = 4, config.hash_growth = 2, config.hash_table_size = 1024, config.ao_table_size = 1024;
    config.mlp_width = network.width, config.mlp_hidden_layers = network.hidden_layers;
    return config;
}

/// The avatar of a configuration, with fields at the size of tests.
template <class B, class T = float>
using SmallAvatar = ConfiguredAvatar<B, T, 1>;

template <class B, class T = float>
[[nodiscard]] SmallAvatar<B, T> small_avatar(B& backend, const RigData& rig, const SurfaceSamples& samples,
                                             std::size_t frame_count, std::uint64_t seed, const AvatarConfig& config,
                                             const SmallNetwork& network = {}) {
    return make_avatar<B, T, 4, 2, 1>(backend, rig, samples, frame_count, seed, small(config, network));
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
                           const AvatarConfig& avatar = {.rates = small_rates},
                           const TrainConfig& config = small_training)
        : SmallTraining(small_scene, [&]() -> B { return std::move(where); }, seed, avatar, config) {}
    /// On a backend that make() returns, which need not be movable.
    template <std::invocable Make>
    SmallTraining(const SmallScene& small_scene, const Make& make, std::uint64_t seed, const AvatarConfig& avatar,
                  const TrainConfig& config = small_training, const SmallNetwork& network = {})
        : scene(&small_scene), backend(make()),
          samples(sample_surface(scene->body, shaped_vertices(scene->body, scene->betas),
                                 std::vector<double>(scene->body.vertex_count(), 12.0), seed)),
          rig(make_rig(scene->body, scene->betas, samples)),
          model(small_avatar(backend, rig, samples, scene->motion.frame_count(), seed, avatar, network)),
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
