// SPDX-License-Identifier: Apache-2.0
/// @file  Scenes in which only one person's pose learns, for test-time refinement.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/splat_scene.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>

namespace gsh {

/// A scene in which only a motion learns. The motion takes its own steps, in after_step, so learned() is empty.
template <class S, class B, class T>
concept FrozenScene = SplatScene<S, B, T> && requires(S& scene, std::uint64_t steps) {
    { scene.motion() } -> std::same_as<MotionRefinement<B, T>&>;
    scene.take_back(steps);
};

/// The common part of frozen scenes: the motion that learns. It must outlive the scene.
template <Backend B, std::floating_point T>
class FrozenSceneBase : public PlainScene<B, T> {
public:
    explicit FrozenSceneBase(MotionRefinement<B, T>& motion) : motion_(&motion) {}

    [[nodiscard]] MotionRefinement<B, T>& motion() { return *motion_; }
    [[nodiscard]] std::size_t frame_count() const { return motion_->frame_count(); }
    void set_progress(std::uint64_t /*step*/, double progress) { motion_->set_progress(progress); }
    [[nodiscard]] LearnedArrays<T> learned() { return {}; }
    void take_back(std::uint64_t steps) { motion_->take_back(steps); }
    void after_step(const RasterCache<B, T>&) { motion_->step(); }

private:
    MotionRefinement<B, T>* motion_;
};

/// A finished avatar in the poses of `motion`. Both must outlive it.
template <Backend B, std::floating_point T = float>
class FrozenAvatar : public FrozenSceneBase<B, T> {
public:
    FrozenAvatar(Avatar<B, T>& avatar, MotionRefinement<B, T>& motion)
        : FrozenSceneBase<B, T>(motion), avatar_(&avatar) {}

    [[nodiscard]] std::size_t size() const { return avatar_->size(); }
    void forward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<T>& splats) {
        this->motion().pose(frame, pose_);
        avatar_->pose(pose_, center, splats, cache_);
    }
    void backward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<const T>& dL_dsplats,
                  Span<vec3<T>>) {
        const RigPoseGradient<T> dL_dpose = this->motion().pose_gradient();
        avatar_->backward_to_pose(pose_, center, dL_dsplats, cache_, dL_dpose);
        this->motion().accumulate(frame, dL_dpose);
    }

private:
    Avatar<B, T>* avatar_;
    RigPose<B, T> pose_;
    typename Avatar<B, T>::Cache cache_;
};

/// One person of an AvatarScene. Only the motion of this person learns, which is the person's refinement in the scene.
/// The other people stay in their poses, and hide or are hidden. The AvatarScene must outlive it.
template <class Scene, Backend B = typename Scene::BackendType, std::floating_point T = typename Scene::Scalar>
class FrozenPerson : public FrozenSceneBase<B, T> {
public:
    /// Errors  ValueError if the person's poses are not refined.
    FrozenPerson(Scene& scene, std::size_t person)
        : FrozenSceneBase<B, T>(refinement_of(scene, person)), scene_(&scene), person_(person) {}

    [[nodiscard]] std::size_t size() const { return scene_->size(); }
    void prepare(std::size_t frame) { scene_->prepare(frame); }
    void forward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<T>& splats) {
        scene_->forward(frame, center, splats);
    }
    void backward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<const T>& dL_dsplats,
                  Span<vec3<T>>) {
        scene_->backward_to_pose(person_, frame, center, dL_dsplats);
    }

private:
    [[nodiscard]] static MotionRefinement<B, T>& refinement_of(Scene& scene, std::size_t person) {
        MotionRefinement<B, T>* motion = scene.refinement(person);
        check_value(motion != nullptr, "FrozenPerson",
                    "person " + std::to_string(person) + " has no refinement; call AvatarScene::refine first");
        return *motion;
    }

    Scene* scene_;
    std::size_t person_;
};

} // namespace gsh
