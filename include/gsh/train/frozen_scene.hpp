// SPDX-License-Identifier: Apache-2.0
/// @file  A trained scene in which one person's pose may still move: what test-time refinement fits.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/train/avatar_model.hpp>

#include <cstddef>

namespace gsh {

/// All people of a trainer at one frame, fields queried, appearance as it is; `person` takes the pose that PoseFit asks
/// for, the others, if there are any, stand where the trainer has them and hide or are hidden as they do.
template <class TrainerType>
struct FrozenScene {
    using Model = typename TrainerType::ModelType;
    using Cache = typename Model::Cache;
    using T = typename TrainerType::Scalar;

    TrainerType* trainer;
    std::size_t frame;
    std::size_t person = 0;

    [[nodiscard]] std::size_t size() const { return trainer->splat_count(); }
    void pose(const auto& pose, const vec3<T>& center, const SplatView<T>& splats, Cache& cache) const {
        for (std::size_t other = 0; other < trainer->person_count(); ++other)
            if (other != person) trainer->pose_person(other, frame, center, splats);
        trainer->model(person).pose(pose, center, trainer->part(person, splats), cache,
                                    trainer->frame_code(frame, person));
    }
    void pose_backward(const auto& pose, const vec3<T>& center, const SplatView<const T>& dL_dsplats, Cache& cache,
                       const RigPoseGradient<T>& dL_dpose) const {
        trainer->model(person).pose_backward(pose, center, trainer->part(person, dL_dsplats), cache, dL_dpose);
    }
};

} // namespace gsh
