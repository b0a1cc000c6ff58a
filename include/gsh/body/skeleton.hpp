// SPDX-License-Identifier: Apache-2.0
/// @file  Forward kinematics: from joint rotations to bone transforms, and from poses to joint rotations.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

/// Bone transforms B_j = G_j(pose) G_j(rest)⁻¹. B_j carries canonical points attached to joint j into the pose.
///
/// A bone rotates about its joint's rest position and then follows its parent: B_j(x) = B_parent(R_j (x - J_j) + J_j).
/// The root's parent is the translation by transl. The recursion equals the quotient of the two chains of local
/// transforms [R_j | J_j - J_parent] but does not form them, so it needs no scratch memory.
///
/// Shapes  parents [J] (the root first, with -1; a parent before its children), rotations [J] relative to the parent,
///         joints [J], transl [3], bones [J].
/// Frame   joints are absolute rest positions in the canonical frame; they are free parameters.
/// Units   metres.
/// Errors  none, this is kernel code.
/// Source  Loper et al., "SMPL", 2015, equations 3 and 4.
template <Lane T>
GSH_HD void bone_transforms(Span<const int> parents, Span<const mat3<T>> rotations, Span<const vec3<T>> joints,
                            const vec3<T>& transl, Span<Affine<T>> bones) {
    for (std::size_t j = 0; j < parents.size(); ++j) {
        const Affine<T> about_joint{rotations[j], joints[j] - rotations[j] * joints[j]};
        if (parents[j] < 0)
            bones[j] = {about_joint.linear, about_joint.translation + transl};
        else
            bones[j] = bones[static_cast<std::size_t>(parents[j])] * about_joint;
    }
}

/// Adjoint of bone_transforms, given its bones: adds to dL_drotations, dL_djoints and dL_dtransl. The scratch array [J]
/// accumulates the gradients that children pass to their parents.
template <Lane T>
GSH_HD void bone_transforms_backward(Span<const int> parents, Span<const mat3<T>> rotations,
                                     Span<const vec3<T>> joints, Span<const Affine<T>> bones,
                                     Span<const Affine<T>> dL_dbones, Span<mat3<T>> dL_drotations,
                                     Span<vec3<T>> dL_djoints, vec3<T>& dL_dtransl, Span<Affine<T>> scratch) {
    for (std::size_t j = 0; j < parents.size(); ++j) scratch[j] = dL_dbones[j];
    for (std::size_t j = parents.size(); j-- > 0;) {
        const Affine<T> about_joint{rotations[j], joints[j] - rotations[j] * joints[j]};
        Affine<T> dL_dabout = Affine<T>::zero();
        if (parents[j] < 0) {
            dL_dabout = scratch[j];
            dL_dtransl += scratch[j].translation;
        } else {
            const std::size_t parent = static_cast<std::size_t>(parents[j]);
            product_backward(bones[parent], about_joint, scratch[j], scratch[parent], dL_dabout);
        }
        dL_drotations[j] += dL_dabout.linear - outer(dL_dabout.translation, joints[j]);
        dL_djoints[j] += dL_dabout.translation - transposed_times(rotations[j], dL_dabout.translation);
    }
}

/// The pose feature vec(R_j - I) of the non-root joints, row-major, nine numbers each: the input of the pose blend
/// shapes. A call for joint j >= 1 writes feature[9 (j - 1)] onwards.
template <Lane T>
GSH_HD void pose_feature(std::size_t joint, const mat3<T>& rotation, Span<T> feature) {
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            feature[9 * (joint - 1) + static_cast<std::size_t>(3 * row + column)] =
                rotation[column][row] - (row == column ? T(1) : T(0));
}

/// Adjoint of pose_feature: adds to dL_drotation.
template <Lane T>
GSH_HD void pose_feature_backward(std::size_t joint, Span<const T> dL_dfeature, mat3<T>& dL_drotation) {
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            dL_drotation[column][row] += dL_dfeature[9 * (joint - 1) + static_cast<std::size_t>(3 * row + column)];
}

// The same operations over a backend's arrays ---------------------------------------------------------------------

namespace detail {

template <class T>
struct PoseRotations {
    Span<const vec3<T>> pose;
    Span<mat3<T>> rotations;
    GSH_HD void operator()(std::size_t j) const { rotations[j] = rotation_from_axis_angle(pose[j]); }
};

template <class T>
struct PoseRotationsBackward {
    Span<const vec3<T>> pose;
    Span<const mat3<T>> dL_drotations;
    Span<vec3<T>> dL_dpose;
    GSH_HD void operator()(std::size_t j) const {
        rotation_from_axis_angle_backward(pose[j], dL_drotations[j], dL_dpose[j]);
    }
};

template <class T>
struct PoseFeature {
    Span<const mat3<T>> rotations;
    Span<T> feature;
    GSH_HD void operator()(std::size_t i) const { pose_feature(i + 1, rotations[i + 1], feature); }
};

template <class T>
struct PoseFeatureBackward {
    Span<const T> dL_dfeature;
    Span<mat3<T>> dL_drotations;
    GSH_HD void operator()(std::size_t i) const { pose_feature_backward(i + 1, dL_dfeature, dL_drotations[i + 1]); }
};

/// One element processes the whole chain, because a bone depends on its parent.
template <class T>
struct BoneTransforms {
    Span<const int> parents;
    Span<const mat3<T>> rotations;
    Span<const vec3<T>> joints, transl;
    Span<Affine<T>> bones;
    GSH_HD void operator()(std::size_t) const { bone_transforms(parents, rotations, joints, transl[0], bones); }
};

template <class T>
struct BoneTransformsBackward {
    Span<const int> parents;
    Span<const mat3<T>> rotations;
    Span<const vec3<T>> joints;
    Span<const Affine<T>> bones, dL_dbones;
    Span<mat3<T>> dL_drotations;
    Span<vec3<T>> dL_djoints, dL_dtransl;
    Span<Affine<T>> scratch;
    GSH_HD void operator()(std::size_t) const {
        bone_transforms_backward(parents, rotations, joints, bones, dL_dbones, dL_drotations, dL_djoints,
                                 dL_dtransl[0], scratch);
    }
};

} // namespace detail

/// Runs the whole chain as one element. This version needs no overload; a backend may have one that runs the joints of
/// the same depth at the same time.
template <Backend B, class T>
void bone_chain(B& backend, const detail::BoneTransforms<T>& chain) {
    backend.for_each(1, chain);
}
/// Its adjoint, likewise.
template <Backend B, class T>
void bone_chain_backward(B& backend, const detail::BoneTransformsBackward<T>& chain) {
    backend.for_each(1, chain);
}

/// A skeleton with fixed parents whose joints, pose and translation are arrays of the backend.
///
/// It has three stages, each with its adjoint: rotations (axis-angle pose to matrices), feature (input of the pose
/// blend shapes) and bones (forward kinematics). A pose given as matrices starts at the second stage.
template <Backend B, std::floating_point T = float>
class Skeleton {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// parents must satisfy validate (body_model.hpp).
    Skeleton(B& backend, Span<const int> parents)
        : backend_(&backend), parents_(parents.size()), scratch_(parents.size()) {
        for (std::size_t j = 0; j < parents.size(); ++j)
            check_value((parents[j] < 0) == (j == 0) && parents[j] < static_cast<int>(j), "Skeleton",
                        "parents must start with the root's -1 and name only earlier joints");
        backend.upload(parents, parents_);
    }

    [[nodiscard]] std::size_t joint_count() const { return parents_.size(); }
    [[nodiscard]] std::size_t pose_feature_count() const { return joint_count() ? 9 * (joint_count() - 1) : 0; }

    /// Shapes  pose [J] axis-angle, rotations [J].
    void rotations(Span<const vec3<T>> pose, Span<mat3<T>> rotations) const {
        check("Skeleton::rotations", "pose", pose);
        check("Skeleton::rotations", "rotations", rotations);
        backend_->for_each(joint_count(), detail::PoseRotations<T>{pose, rotations});
    }
    void rotations_backward(Span<const vec3<T>> pose, Span<const mat3<T>> dL_drotations,
                            Span<vec3<T>> dL_dpose) const {
        check("Skeleton::rotations_backward", "pose", pose);
        check("Skeleton::rotations_backward", "dL_drotations", dL_drotations);
        check("Skeleton::rotations_backward", "dL_dpose", dL_dpose);
        backend_->for_each(joint_count(), detail::PoseRotationsBackward<T>{pose, dL_drotations, dL_dpose});
    }

    /// Shapes  rotations [J], feature [9 (J - 1)].
    void feature(Span<const mat3<T>> rotations, Span<T> feature) const {
        check("Skeleton::feature", "rotations", rotations);
        check("Skeleton::feature", "feature", feature, pose_feature_count());
        if (joint_count()) backend_->for_each(joint_count() - 1, detail::PoseFeature<T>{rotations, feature});
    }
    void feature_backward(Span<const T> dL_dfeature, Span<mat3<T>> dL_drotations) const {
        check("Skeleton::feature_backward", "dL_dfeature", dL_dfeature, pose_feature_count());
        check("Skeleton::feature_backward", "dL_drotations", dL_drotations);
        if (joint_count())
            backend_->for_each(joint_count() - 1, detail::PoseFeatureBackward<T>{dL_dfeature, dL_drotations});
    }

    /// Shapes  rotations [J], joints [J], transl [1], bones [J].
    void bones(Span<const mat3<T>> rotations, Span<const vec3<T>> joints, Span<const vec3<T>> transl,
               Span<Affine<T>> bones) const {
        check("Skeleton::bones", "rotations", rotations);
        check("Skeleton::bones", "joints", joints);
        check("Skeleton::bones", "transl", transl, 1);
        check("Skeleton::bones", "bones", bones);
        bone_chain(*backend_, detail::BoneTransforms<T>{parents_, rotations, joints, transl, bones});
    }
    /// bones are those written by the forward pass.
    void bones_backward(Span<const mat3<T>> rotations, Span<const vec3<T>> joints, Span<const Affine<T>> bones,
                        Span<const Affine<T>> dL_dbones, Span<mat3<T>> dL_drotations, Span<vec3<T>> dL_djoints,
                        Span<vec3<T>> dL_dtransl) {
        check("Skeleton::bones_backward", "rotations", rotations);
        check("Skeleton::bones_backward", "joints", joints);
        check("Skeleton::bones_backward", "bones", bones);
        check("Skeleton::bones_backward", "dL_dbones", dL_dbones);
        check("Skeleton::bones_backward", "dL_drotations", dL_drotations);
        check("Skeleton::bones_backward", "dL_djoints", dL_djoints);
        check("Skeleton::bones_backward", "dL_dtransl", dL_dtransl, 1);
        bone_chain_backward(*backend_,
                            detail::BoneTransformsBackward<T>{parents_, rotations, joints, bones, dL_dbones,
                                                              dL_drotations, dL_djoints, dL_dtransl, scratch_});
    }

private:
    template <class U>
    void check(std::string_view where, std::string_view argument, Span<U> found, std::size_t count,
               std::string_view hint = {}) const {
        check_size(where, argument, found.size(), count, hint);
        check_memory(*backend_, where, argument, found);
    }
    template <class U>
    void check(std::string_view where, std::string_view argument, Span<U> found) const {
        check(where, argument, found, joint_count(), "store one per joint");
    }

    B* backend_;
    Buffer<int> parents_;
    Buffer<Affine<T>> scratch_;
};

} // namespace gsh
