// SPDX-License-Identifier: Apache-2.0
/// @file  Occlusion policies: the concept of what gives an avatar its ambient occlusion, NoOcclusion and AnyOcclusion.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

namespace gsh {

/// Names of gsh's own ambient occlusions, for ConfiguredAvatarParams::ao.
struct AmbientOcclusion {
    static constexpr const char* none = "none"; ///< ao = 1
    /// The frame, γ(t), as in the paper; in a new motion each Gaussian has its mean over the training frames.
    static constexpr const char* time = "time";
    static constexpr const char* pose = "pose"; ///< the joints' rotations; ao is also right in a new motion
};

/// Sizes of an avatar that an ambient occlusion may depend on.
struct OcclusionSizes {
    std::size_t frame_count = 0;        ///< of the training motion
    std::size_t pose_feature_count = 0; ///< 9 (J - 1)
};

/// The inputs of an occlusion policy.
///
/// Shapes  pose [J] axis-angle; rotations [J] of the joints relative to their parents. Both in the backend's memory.
template <Backend B, std::floating_point T = float>
struct OcclusionInput {
    std::size_t frame = 0; ///< of the training motion
    const Skeleton<B, T>& skeleton;
    Span<const vec3<T>> pose;
    Span<const mat3<T>> rotations;
};

/// An occlusion policy gives ambient occlusion: a factor ao_i on the colour of each Gaussian.
///
///     occludes()                               false if there is no ambient occlusion: ao = 1, and no pass is called
///     follows_pose()                           whether ao depends on the pose, so that it is right in new motions, too
///     forward(input, ao)                       writes ao [N]
///     backward(input, ao, dL_dao, dL_dpose)    adds to the gradients of learned(), and to dL_dpose [J] unless that is
///                                              empty; ao is that of forward; dL_dao [N] is scratch afterwards
///     backward_to_pose(input, ao, dL_dao, dL_dpose)    adds to dL_dpose alone; nothing is learned
///
/// A policy that follows the pose may have baked(), the field that an avatar file stores (std::optional). Without it
/// the file gets the mean of ao over training.
template <class S, class B, class T>
concept OcclusionPolicy = requires(S& occlusion, const S& constant, const OcclusionInput<B, T>& input, Span<const T> ao,
                                   Span<T> values, Span<vec3<T>> dL_dpose) {
    { constant.occludes() } -> std::same_as<bool>;
    { constant.follows_pose() } -> std::same_as<bool>;
    occlusion.forward(input, values);
    occlusion.backward(input, ao, values, dL_dpose);
    occlusion.backward_to_pose(input, ao, values, dL_dpose);
    { occlusion.learned() } -> std::same_as<LearnedArrays<T>>;
};

/// What baked() returns, or nothing for a policy that has none.
template <class Occlusion>
[[nodiscard]] std::optional<OcclusionFieldData> baked_field(const Occlusion& occlusion) {
    if constexpr (requires { occlusion.baked(); }) return occlusion.baked();
    else return std::nullopt;
}

/// A base for occlusion policies that do not depend on the pose. forward, backward and learned() are the policy's own.
template <Backend B, std::floating_point T = float>
struct PlainOcclusion {
    [[nodiscard]] bool occludes() const { return true; }
    [[nodiscard]] bool follows_pose() const { return false; }
    void backward_to_pose(const OcclusionInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
};

/// No ambient occlusion: ao = 1.
template <Backend B, std::floating_point T = float>
struct NoOcclusion : PlainOcclusion<B, T> {
    [[nodiscard]] bool occludes() const { return false; }
    void forward(const OcclusionInput<B, T>&, Span<T>) {}
    void backward(const OcclusionInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
    [[nodiscard]] LearnedArrays<T> learned() { return {}; }
};

/// Any occlusion policy, chosen at run time. Each pass costs a virtual call.
template <Backend B, std::floating_point T = float>
class AnyOcclusion {
public:
    template <class S>
        requires(!std::same_as<std::remove_cvref_t<S>, AnyOcclusion> && OcclusionPolicy<std::remove_cvref_t<S>, B, T>)
    AnyOcclusion(S&& occlusion) : self_(std::make_unique<Model<std::remove_cvref_t<S>>>(std::forward<S>(occlusion))) {}

    [[nodiscard]] bool occludes() const { return self_->occludes(); }
    [[nodiscard]] bool follows_pose() const { return self_->follows_pose(); }
    void forward(const OcclusionInput<B, T>& input, Span<T> ao) { self_->forward(input, ao); }
    void backward(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        self_->backward(input, ao, dL_dao, dL_dpose);
    }
    void backward_to_pose(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        self_->backward_to_pose(input, ao, dL_dao, dL_dpose);
    }
    [[nodiscard]] LearnedArrays<T> learned() { return self_->learned(); }
    [[nodiscard]] std::optional<OcclusionFieldData> baked() const { return self_->baked(); }

private:
    struct Interface {
        virtual ~Interface() = default;
        [[nodiscard]] virtual bool occludes() const = 0;
        [[nodiscard]] virtual bool follows_pose() const = 0;
        virtual void forward(const OcclusionInput<B, T>&, Span<T>) = 0;
        virtual void backward(const OcclusionInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) = 0;
        virtual void backward_to_pose(const OcclusionInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) = 0;
        [[nodiscard]] virtual LearnedArrays<T> learned() = 0;
        [[nodiscard]] virtual std::optional<OcclusionFieldData> baked() const = 0;
    };
    template <class S>
    struct Model final : Interface {
        S policy;
        explicit Model(S occlusion) : policy(std::move(occlusion)) {}
        [[nodiscard]] bool occludes() const override { return policy.occludes(); }
        [[nodiscard]] bool follows_pose() const override { return policy.follows_pose(); }
        void forward(const OcclusionInput<B, T>& input, Span<T> ao) override { policy.forward(input, ao); }
        void backward(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao,
                      Span<vec3<T>> dL_dpose) override {
            policy.backward(input, ao, dL_dao, dL_dpose);
        }
        void backward_to_pose(const OcclusionInput<B, T>& input, Span<const T> ao, Span<T> dL_dao,
                              Span<vec3<T>> dL_dpose) override {
            policy.backward_to_pose(input, ao, dL_dao, dL_dpose);
        }
        [[nodiscard]] LearnedArrays<T> learned() override { return policy.learned(); }
        [[nodiscard]] std::optional<OcclusionFieldData> baked() const override { return baked_field(policy); }
    };
    std::unique_ptr<Interface> self_;
};

/// Former names.
template <Backend B, std::floating_point T = float>
using ShadowInput [[deprecated("use OcclusionInput")]] = OcclusionInput<B, T>;
template <Backend B, std::floating_point T = float>
using PlainShadow [[deprecated("use PlainOcclusion")]] = PlainOcclusion<B, T>;
template <Backend B, std::floating_point T = float>
using NoShadow [[deprecated("use NoOcclusion")]] = NoOcclusion<B, T>;
template <Backend B, std::floating_point T = float>
using AnyShadow [[deprecated("use AnyOcclusion")]] = AnyOcclusion<B, T>;

} // namespace gsh
