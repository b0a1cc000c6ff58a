// SPDX-License-Identifier: Apache-2.0
/// @file  A training of several people small enough for tests, on any backend.
#pragma once

#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/trainer.hpp>

#include "support/learned.hpp"
#include "support/small_training.hpp"

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

namespace gsh::test {

/// The small scene's motion at another place.
inline Motion moved(Motion motion, const vec3<double>& by) {
    for (auto& transl : motion.transl) transl += by;
    return motion;
}

/// Several people with the small scene's body in one training.
template <class B, class T = float>
struct Cast {
    using Model = SmallAvatar<B, T>;
    using SceneType = AvatarScene<B, Model, T>;
    using TrainerType = Trainer<B, SceneType, T>;
    static constexpr std::uint64_t seed = 3;

    B backend;
    std::vector<Motion> motions;
    std::deque<SurfaceSamples> samples;
    std::deque<RigData> rigs;
    std::deque<Model> models;
    SceneType people;
    TrainerType trainer;

    Cast(const SmallScene& scene, std::vector<Motion> poses, std::vector<Photo> photos, B where = B(),
         const ConfiguredAvatarParams& avatar = quick_avatar(), const TrainParams& config = small_training,
         double density = 12, const std::optional<LightData>& light = {})
        : Cast(
              scene, std::move(poses), std::move(photos), [&]() -> B { return std::move(where); }, avatar, config,
              density, light) {}
    /// On a backend that make() returns, which need not be movable.
    template <std::invocable Make>
    Cast(const SmallScene& scene, std::vector<Motion> poses, std::vector<Photo> photos, const Make& make,
         const ConfiguredAvatarParams& avatar, const TrainParams& config = small_training, double density = 12,
         const std::optional<LightData>& light = {})
        : backend(make()), motions(std::move(poses)), people(backend, members(scene, avatar, density, light)),
          trainer(backend, people, std::move(photos), seed, config) {}
    Cast(const Cast&) = delete;

    std::vector<T> parameters(std::size_t person) { return learned_values(backend, models[person]); }
    void steps(int count, double progress = 0) {
        for (int i = 0; i < count; ++i) trainer.step(progress);
    }
    Image<T> picture(const Camera<double>& camera, std::size_t frame, Image<T>* alpha = nullptr) {
        Image<T> color;
        trainer.render(camera, frame, color, alpha);
        return color;
    }

private:
    std::vector<CastMember<Model>> members(const SmallScene& scene, const ConfiguredAvatarParams& avatar,
                                           double density, const std::optional<LightData>& light) {
        const ModelLight<B, T> shared = lit_by<T>(backend, light);
        std::vector<CastMember<Model>> cast;
        for (std::size_t p = 0; p < motions.size(); ++p) {
            samples.push_back(sample_surface(scene.body, shaped_vertices(scene.body, scene.betas),
                                             std::vector<double>(scene.body.vertex_count(), density), seed));
            rigs.push_back(make_rig(scene.body, scene.betas, samples.back()));
            models.push_back(small_avatar<B, T>(backend, rigs.back(), samples.back(), motions[p].frame_count(), seed,
                                                avatar, {}, {shared.light, p == 0}));
            cast.push_back({&models.back(), &motions[p]});
        }
        return cast;
    }
};

} // namespace gsh::test
