// SPDX-License-Identifier: Apache-2.0
/// @file  Shadow policies: the concept of what gives an avatar's ambient occlusion in a pose, NoShadow and AnyShadow.
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

/// The inputs of a shadow.
///
/// Shapes  pose [J] axis-angle; rotations [J] of the joints relative to their parents. Both in the backend's memory.
template <Backend B, std::floating_point T = float>
struct ShadowInput {
    std::size_t frame = 0; ///< of the training motion
    const Skeleton<B, T>& skeleton;
    Span<const vec3<T>> pose;
    Span<const mat3<T>> rotations;
};

/// A shadow gives a factor ao_i on the colour of each Gaussian.
///
///     casts()                                  false if there is no shadow: ao = 1, and no pass is called
///     follows_pose()                           whether ao depends on the pose, so that it is right in new motions, too
///     forward(input, ao)                       writes ao [N]
///     backward(input, ao, dL_dao, dL_dpose)    adds to the gradients of learned(), and to dL_dpose [J] unless that is
///                                              empty; ao is that of forward; dL_dao [N] is scratch afterwards
///     backward_to_pose(input, ao, dL_dao, dL_dpose)    adds to dL_dpose alone; the shadow does not learn
///
/// A shadow that follows the pose may have baked(), the field that an avatar file stores (std::optional). Without it
/// the file gets the mean of ao over training.
template <class S, class B, class T>
concept ShadowPolicy = requires(S& shadow, const S& constant, const ShadowInput<B, T>& input, Span<const T> ao,
                                Span<T> values, Span<vec3<T>> dL_dpose) {
    { constant.casts() } -> std::same_as<bool>;
    { constant.follows_pose() } -> std::same_as<bool>;
    shadow.forward(input, values);
    shadow.backward(input, ao, values, dL_dpose);
    shadow.backward_to_pose(input, ao, values, dL_dpose);
    { shadow.learned() } -> std::same_as<LearnedArrays<T>>;
};

/// What baked() returns, or nothing for a shadow that has none.
template <class Shadow>
[[nodiscard]] std::optional<OcclusionFieldData> baked_field(const Shadow& shadow) {
    if constexpr (requires { shadow.baked(); }) return shadow.baked();
    else return std::nullopt;
}

/// A base for shadows that do not depend on the pose. forward, backward and learned() are the shadow's.
template <Backend B, std::floating_point T = float>
struct PlainShadow {
    [[nodiscard]] bool casts() const { return true; }
    [[nodiscard]] bool follows_pose() const { return false; }
    void backward_to_pose(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
};

/// No shadow: ao = 1.
template <Backend B, std::floating_point T = float>
struct NoShadow : PlainShadow<B, T> {
    [[nodiscard]] bool casts() const { return false; }
    void forward(const ShadowInput<B, T>&, Span<T>) {}
    void backward(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
    [[nodiscard]] LearnedArrays<T> learned() { return {}; }
};

/// Any shadow, chosen at run time. Each pass costs a virtual call.
template <Backend B, std::floating_point T = float>
class AnyShadow {
public:
    template <class S>
        requires(!std::same_as<std::remove_cvref_t<S>, AnyShadow> && ShadowPolicy<std::remove_cvref_t<S>, B, T>)
    AnyShadow(S&& shadow) : self_(std::make_unique<Model<std::remove_cvref_t<S>>>(std::forward<S>(shadow))) {}

    [[nodiscard]] bool casts() const { return self_->casts(); }
    [[nodiscard]] bool follows_pose() const { return self_->follows_pose(); }
    void forward(const ShadowInput<B, T>& input, Span<T> ao) { self_->forward(input, ao); }
    void backward(const ShadowInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        self_->backward(input, ao, dL_dao, dL_dpose);
    }
    void backward_to_pose(const ShadowInput<B, T>& input, Span<const T> ao, Span<T> dL_dao, Span<vec3<T>> dL_dpose) {
        self_->backward_to_pose(input, ao, dL_dao, dL_dpose);
    }
    [[nodiscard]] LearnedArrays<T> learned() { return self_->learned(); }
    [[nodiscard]] std::optional<OcclusionFieldData> baked() const { return self_->baked(); }

private:
    struct Interface {
        virtual ~Interface() = default;
        [[nodiscard]] virtual bool casts() const = 0;
        [[nodiscard]] virtual bool follows_pose() const = 0;
        virtual void forward(const ShadowInput<B, T>&, Span<T>) = 0;
        virtual void backward(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) = 0;
        virtual void backward_to_pose(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) = 0;
        [[nodiscard]] virtual LearnedArrays<T> learned() = 0;
        [[nodiscard]] virtual std::optional<OcclusionFieldData> baked() const = 0;
    };
    template <class S>
    struct Model final : Interface {
        S policy;
        explicit Model(S shadow) : policy(std::move(shadow)) {}
        [[nodiscard]] bool casts() const override { return policy.casts(); }
        [[nodiscard]] bool follows_pose() const override { return policy.follows_pose(); }
        void forward(const ShadowInput<B, T>& input, Span<T> ao) override { policy.forward(input, ao); }
        void backward(const ShadowInput<B, T>& input, Span<const T> ao, Span<T> dL_dao,
                      Span<vec3<T>> dL_dpose) override {
            policy.backward(input, ao, dL_dao, dL_dpose);
        }
        void backward_to_pose(const ShadowInput<B, T>& input, Span<const T> ao, Span<T> dL_dao,
                              Span<vec3<T>> dL_dpose) override {
            policy.backward_to_pose(input, ao, dL_dao, dL_dpose);
        }
        [[nodiscard]] LearnedArrays<T> learned() override { return policy.learned(); }
        [[nodiscard]] std::optional<OcclusionFieldData> baked() const override { return baked_field(policy); }
    };
    std::unique_ptr<Interface> self_;
};

} // namespace gsh
