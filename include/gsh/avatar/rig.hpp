// SPDX-License-Identifier: Apache-2.0
/// @file  The rig of an avatar: skeleton, blend shapes, and the attachment of canonical points to the body.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/body/blend_shapes.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/body/surface_interpolation.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/body/thinned_samples.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <concepts>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh {

/// A rig on the host, as files store it: a body, its learned joints, and N points attached to its surface.
///
/// Shapes  J joints, N points.
/// Frame   the canonical pose: the zero pose of the body with shape `betas` and a neutral face.
struct RigData {
    BodyModel body;                            ///< with shape directions for `betas` only
    std::vector<double> betas;                 // [S] the shape that the canonical points lie on
    std::vector<vec3<double>> joints;          // [J] rest positions at that shape, after training
    std::vector<std::array<int, 3>> triangles; // [N] vertices of the triangle that holds the point
    std::vector<vec3<double>> barycentric;     // [N]
    SkinWeightTable<double> skin;              // [N]

    [[nodiscard]] std::size_t joint_count() const { return body.joint_count(); }
    [[nodiscard]] std::size_t point_count() const { return triangles.size(); }
};

/// The rig of a body of shape `betas` with samples on its surface. Shape directions without a beta are dropped, so that
/// a file with 300 of them is not stored for ten betas.
///
/// Errors  ValueError if there are more betas than shape directions.
[[nodiscard]] inline RigData make_rig(const BodyModel& body, Span<const double> betas, const SurfaceSamples& samples) {
    const auto S = static_cast<std::size_t>(body.shape_count);
    check_value(betas.size() <= S, "make_rig",
                "there are " + std::to_string(betas.size()) + " betas for a body with " + std::to_string(S) +
                    " shape directions; drop the rest");
    RigData rig{.body = body,
                .betas = {betas.begin(), betas.end()},
                .joints = regress_joints(body, shaped_vertices(body, betas)),
                .triangles = samples.triangles,
                .barycentric = samples.barycentric,
                .skin = samples.weights};
    rig.body.shape_count = static_cast<int>(betas.size());
    rig.body.shapedirs.clear();
    for (std::size_t v = 0; v < body.vertex_count(); ++v)
        for (std::size_t k = 0; k < betas.size(); ++k) rig.body.shapedirs.push_back(body.shapedirs[v * S + k]);
    return rig;
}

/// The same rig for every stride-th of its points, which are those of thinned samples.
[[nodiscard]] inline RigData thinned(const RigData& rig, std::size_t stride) {
    return {.body = rig.body,
            .betas = rig.betas,
            .joints = rig.joints,
            .triangles = thinned_rows(rig.triangles, 1, stride),
            .barycentric = thinned_rows(rig.barycentric, 1, stride),
            .skin = thinned(rig.skin, stride)};
}

/// One frame in the canonical pose.
[[nodiscard]] inline Motion rest_motion(const RigData& rig) {
    Motion motion;
    motion.joint_count = rig.joint_count();
    motion.pose.assign(rig.joint_count(), vec3<double>(0));
    motion.transl.assign(1, vec3<double>(0));
    motion.timestamps.assign(1, 0);
    return motion;
}

/// The part of a pose's work that depends on the pose alone: rotations of the joints, and offsets of the vertices.
///
/// Shapes  rotations [J], of each joint against its parent; blend_coefficients [S + E + 9 (J - 1)]: β - β_init, ψ and
///         vec(R - I); vertex_offsets [V], metres, canonical frame.
template <Backend B, std::floating_point T = float>
struct PreparedPose {
    typename B::template Buffer<mat3<T>> rotations;
    typename B::template Buffer<T> blend_coefficients;
    typename B::template Buffer<vec3<T>> vertex_offsets;

    [[nodiscard]] bool empty() const { return rotations.size() == 0; }
};

/// The former name of PreparedPose.
template <Backend B, std::floating_point T = float>
using RigShape [[deprecated("use PreparedPose")]] = PreparedPose<B, T>;

/// One frame's pose in a backend's memory.
///
/// Shapes  pose [J] axis-angle; coefficients [S + E], betas (absolute) then expression; transl [1].
template <Backend B, std::floating_point T = float>
struct RigPose {
    typename B::template Buffer<vec3<T>> pose;
    typename B::template Buffer<T> coefficients;
    typename B::template Buffer<vec3<T>> transl;
    /// What Rig::prepare has computed, for Rig::forward to read; otherwise empty. A pose that is changed in place must
    /// be prepared again.
    PreparedPose<B, T> prepared;
};

/// Gradient with respect to a RigPose; the parts with an empty span are not computed.
template <std::floating_point T>
struct RigPoseGradient {
    Span<vec3<T>> pose;
    Span<T> coefficients;
    Span<vec3<T>> transl;

    [[nodiscard]] bool empty() const { return pose.empty() && coefficients.empty() && transl.empty(); }
};

namespace detail {

template <class T>
struct Difference {
    Span<const T> a, b;
    Span<T> result;
    GSH_HD void operator()(std::size_t i) const { result[i] = a[i] - b[i]; }
};

template <class T>
struct Accumulate {
    Span<const T> from;
    Span<T> to;
    GSH_HD void operator()(std::size_t i) const { to[i] += from[i]; }
};

} // namespace detail

/// Moves canonical points with a body: computes the bones for skinning, and the offsets of expression, shape and pose
/// that are added to the points before skinning,
///
///     x̂₀(t) = x₀ + δx + E(x₀) ψ + P(x₀) vec(R - I) + S(x₀)(β - β_init),
///     J(t)   = J_learned + regressed(β, ψ) - regressed(β_init, 0).
///
/// Source  method of the paper §3.5 for the skeleton; the offsets are those of the body model, Pavlakos et al.,
///         "Expressive Body Capture" (SMPL-X), 2019, equations 1 to 5.
template <Backend B, std::floating_point T = float>
class Rig {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    /// Results of forward, which `add_offsets` and `backward` need. The views are valid as long as this cache, and the
    /// pose if it was prepared.
    struct Cache {
        Span<const mat3<T>> rotations; // [J], as in PreparedPose
        Span<const T> blend_coefficients;
        Span<const vec3<T>> vertex_offsets;
        Buffer<vec3<T>> joints;           // [J] at this frame
        Buffer<Affine<T>> bones;          // [J]
        PreparedPose<B, T> prepared;      // of a pose that was not prepared
        // working storage of backward
        Buffer<mat3<T>> dL_drotations;
        Buffer<T> dL_dcoefficients;
        Buffer<vec3<T>> dL_djoints, dL_dvertex_offsets, dL_dtransl;
        typename BlendShapes<B, T>::Workspace workspace;
    };

    Rig(B& backend, const RigData& data)
        : backend_(&backend), joint_count_(data.joint_count()), point_count_(data.point_count()),
          shape_count_(data.betas.size()), expression_count_(static_cast<std::size_t>(data.body.expression_count)),
          vertex_count_(data.body.vertex_count()),
          feature_count_(data.body.posedirs.empty() ? 0 : data.body.pose_feature_count()),
          influences_(data.skin.influences), betas_(data.betas), skeleton_(backend, data.body.parents),
          vertex_shapes_(backend, vertex_count_, {data.body.shapedirs, data.body.exprdirs, data.body.posedirs}),
          joint_shapes_(
              backend, joint_count_,
              {joint_directions(data.body, data.body.shapedirs), joint_directions(data.body, data.body.exprdirs)}),
          interpolation_(backend, vertex_count_, data.triangles, data.barycentric) {
        check_size("Rig", "body.shape_count", static_cast<std::size_t>(data.body.shape_count), shape_count_,
                   "keep directions for the rig's betas only");
        check_size("Rig", "joints", data.joints.size(), joint_count_, "store one rest position per joint");
        check_skin("Rig", data.skin.view(), point_count_);
        const SkinWeightTable<T> skin = data.skin.template cast<T>();
        assign(backend, skin.joints, skin_joints_);
        assign(backend, skin.weights, skin_weights_);
        std::vector<T> initial(coefficient_count(), T(0));
        for (std::size_t k = 0; k < shape_count_; ++k) initial[k] = T(data.betas[k]);
        assign(backend, initial, initial_);
    }

    [[nodiscard]] std::size_t joint_count() const { return joint_count_; }
    [[nodiscard]] std::size_t point_count() const { return point_count_; }
    [[nodiscard]] std::size_t coefficient_count() const { return shape_count_ + expression_count_; }
    [[nodiscard]] const Skeleton<B, T>& skeleton() const { return skeleton_; }
    [[nodiscard]] SkinWeights<T> skin() const { return {skin_joints_, skin_weights_, influences_}; }

    /// Uploads frame `frame` of a motion to the backend. A motion may have fewer coefficients than the rig; the rest
    /// are zero. Without betas, the motion has the shape of the rig.
    ///
    /// Errors  ShapeError if the joints of the motion are not those of the rig, or if it has more coefficients.
    void upload_pose(const Motion& motion, std::size_t frame, RigPose<B, T>& pose) const {
        check_size("Rig::upload_pose", "the motion's joints", motion.joint_count, joint_count_,
                   "the motion must be made for the avatar's skeleton");
        check_frame("Rig::upload_pose", frame, motion.frame_count());
        if (motion.betas.size() > shape_count_)
            throw ShapeError("Rig::upload_pose: the motion has " + std::to_string(motion.betas.size()) +
                             " betas, the rig " + std::to_string(shape_count_) + "; drop the rest");
        if (motion.expression_count > expression_count_)
            throw ShapeError("Rig::upload_pose: the motion has " + std::to_string(motion.expression_count) +
                             " expression coefficients, the rig " + std::to_string(expression_count_) +
                             "; drop the rest");
        const auto pose_at = motion.pose_at(frame);
        const std::vector<vec3<T>> angles(pose_at.begin(), pose_at.end());
        std::vector<T> coefficients(coefficient_count(), T(0));
        const std::vector<double>& betas = motion.betas.empty() ? betas_ : motion.betas;
        for (std::size_t k = 0; k < betas.size(); ++k) coefficients[k] = T(betas[k]);
        for (std::size_t k = 0; k < motion.expression_count; ++k)
            coefficients[shape_count_ + k] = T(motion.expression_at(frame)[k]);
        const vec3<T> transl(motion.transl[frame]);
        assign(*backend_, angles, pose.pose);
        assign(*backend_, coefficients, pose.coefficients);
        assign(*backend_, Span<const vec3<T>>(&transl, 1), pose.transl);
        pose.prepared = {};
    }

    /// Computes what depends on the pose alone, so that forward does not. For poses that are used more than once.
    void prepare(RigPose<B, T>& pose) const {
        try {
            compute(pose, pose.prepared);
        } catch (...) { // what is prepared in part must not be taken for a prepared pose
            pose.prepared = {};
            throw;
        }
    }
    /// The memory of a PreparedPose.
    [[nodiscard]] std::size_t prepared_bytes() const {
        return sizeof(mat3<T>) * joint_count_ + sizeof(T) * (coefficient_count() + feature_count_) +
               sizeof(vec3<T>) * vertex_count_;
    }

    /// Bones and offsets of one frame. joints [J]: the learned rest positions J_learned.
    void forward(const RigPose<B, T>& pose, Span<const vec3<T>> joints, Cache& cache) const {
        check_size("Rig::forward", "joints", joints.size(), joint_count_, "store one per joint");
        check_memory(*backend_, "Rig::forward", "joints", joints);
        if (pose.prepared.empty()) compute(pose, cache.prepared);
        const PreparedPose<B, T>& prepared = pose.prepared.empty() ? cache.prepared : pose.prepared;
        check_size("Rig::forward", "pose.prepared.vertex_offsets", prepared.vertex_offsets.size(), vertex_count_,
                   "prepare the pose with this rig");
        cache.rotations = prepared.rotations;
        cache.blend_coefficients = prepared.blend_coefficients;
        cache.vertex_offsets = prepared.vertex_offsets;
        cache.joints.resize(joint_count_);
        cache.bones.resize(joint_count_);
        backend_->copy(joints, cache.joints);
        joint_shapes_.forward(cache.blend_coefficients.subspan(0, coefficient_count()), cache.joints);
        skeleton_.bones(cache.rotations, cache.joints, pose.transl, cache.bones);
    }

    /// points[i] += the offset of point i at the frame of `cache`.
    void add_offsets(const Cache& cache, Span<vec3<T>> points) const {
        interpolation_.forward(cache.vertex_offsets, points);
    }

    /// Adjoint of forward and add_offsets: adds to dL_djoints and to the non-empty members of dL_dpose.
    /// dL_dvertex_offsets [V] is the gradient of Cache::vertex_offsets by other ways than the points, or empty.
    void backward(const RigPose<B, T>& pose, Cache& cache, Span<const Affine<T>> dL_dbones,
                  Span<const vec3<T>> dL_dpoints, Span<vec3<T>> dL_djoints, RigPoseGradient<T> dL_dpose = {},
                  Span<const vec3<T>> dL_dvertex_offsets = {}) {
        check_memory(*backend_, "Rig::backward", "dL_dbones", dL_dbones);
        check_memory(*backend_, "Rig::backward", "dL_dpoints", dL_dpoints);
        check_memory(*backend_, "Rig::backward", "dL_djoints", dL_djoints);
        check_memory(*backend_, "Rig::backward", "dL_dpose.pose", dL_dpose.pose);
        check_memory(*backend_, "Rig::backward", "dL_dpose.coefficients", dL_dpose.coefficients);
        check_memory(*backend_, "Rig::backward", "dL_dpose.transl", dL_dpose.transl);
        cache.dL_drotations.resize(joint_count_);
        cache.dL_djoints.resize(joint_count_);
        cache.dL_dtransl.resize(1);
        backend_->fill(Span<mat3<T>>(cache.dL_drotations), mat3<T>(T(0)));
        backend_->fill(Span<vec3<T>>(cache.dL_djoints), vec3<T>(T(0)));
        backend_->fill(Span<vec3<T>>(cache.dL_dtransl), vec3<T>(T(0)));
        skeleton_.bones_backward(cache.rotations, cache.joints, cache.bones, dL_dbones, cache.dL_drotations,
                                 cache.dL_djoints, cache.dL_dtransl);
        backend_->for_each(joint_count_, detail::Accumulate<vec3<T>>{cache.dL_djoints, dL_djoints});
        if (dL_dpose.empty()) return;

        cache.dL_dcoefficients.resize(cache.blend_coefficients.size());
        cache.dL_dvertex_offsets.resize(vertex_count_);
        backend_->fill(Span<T>(cache.dL_dcoefficients), T(0));
        if (dL_dvertex_offsets.empty()) {
            backend_->fill(Span<vec3<T>>(cache.dL_dvertex_offsets), vec3<T>(T(0)));
        } else {
            check_size("Rig::backward", "dL_dvertex_offsets", dL_dvertex_offsets.size(), vertex_count_,
                       "one per vertex, or none");
            check_memory(*backend_, "Rig::backward", "dL_dvertex_offsets", dL_dvertex_offsets);
            backend_->copy(dL_dvertex_offsets, Span<vec3<T>>(cache.dL_dvertex_offsets));
        }
        const Span<T> dL_dcoefficients = cache.dL_dcoefficients;
        interpolation_.backward(dL_dpoints, cache.dL_dvertex_offsets);
        vertex_shapes_.backward(cache.dL_dvertex_offsets, dL_dcoefficients, cache.workspace);
        joint_shapes_.backward(cache.dL_djoints, dL_dcoefficients.subspan(0, coefficient_count()), cache.workspace);
        if (feature_count_)
            skeleton_.feature_backward(dL_dcoefficients.subspan(coefficient_count(), feature_count_),
                                       cache.dL_drotations);
        if (!dL_dpose.pose.empty()) skeleton_.rotations_backward(pose.pose, cache.dL_drotations, dL_dpose.pose);
        if (!dL_dpose.coefficients.empty())
            backend_->for_each(coefficient_count(), detail::Accumulate<T>{dL_dcoefficients, dL_dpose.coefficients});
        if (!dL_dpose.transl.empty())
            backend_->for_each(1, detail::Accumulate<vec3<T>>{cache.dL_dtransl, dL_dpose.transl});
    }

private:
    void compute(const RigPose<B, T>& pose, PreparedPose<B, T>& prepared) const {
        check_size("Rig", "pose.coefficients", pose.coefficients.size(), coefficient_count());
        prepared.rotations.resize(joint_count_);
        prepared.blend_coefficients.resize(coefficient_count() + feature_count_);
        prepared.vertex_offsets.resize(vertex_count_);
        skeleton_.rotations(pose.pose, prepared.rotations);
        const Span<T> coefficients = prepared.blend_coefficients;
        backend_->for_each(coefficient_count(), detail::Difference<T>{pose.coefficients, initial_, coefficients});
        if (feature_count_)
            skeleton_.feature(prepared.rotations, coefficients.subspan(coefficient_count(), feature_count_));
        backend_->fill(Span<vec3<T>>(prepared.vertex_offsets), vec3<T>(T(0)));
        vertex_shapes_.forward(coefficients, prepared.vertex_offsets);
    }

    B* backend_;
    std::size_t joint_count_, point_count_, shape_count_, expression_count_, vertex_count_, feature_count_, influences_;
    std::vector<double> betas_;
    Skeleton<B, T> skeleton_;
    BlendShapes<B, T> vertex_shapes_, joint_shapes_;
    SurfaceInterpolation<B, T> interpolation_;
    Buffer<std::uint16_t> skin_joints_;
    Buffer<T> skin_weights_;
    Buffer<T> initial_; // [S + E]: β_init, then zeros
};

} // namespace gsh
