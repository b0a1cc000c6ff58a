// SPDX-License-Identifier: Apache-2.0
/// @file  Shadow policies: what ambient occlusion an avatar has in a pose, and any of them behind one type.
#pragma once

#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/learned_array.hpp>

#include <concepts>
#include <cstddef>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

namespace gsh {

/// What a shadow may depend on.
///
/// Shapes  pose [J] axis-angle; rotations [J] of the joints relative to their parents; both in the backend's memory.
template <Backend B, std::floating_point T = float>
struct ShadowInput {
    std::size_t frame = 0; ///< of the motion that is trained on
    const Skeleton<B, T>& skeleton;
    Span<const vec3<T>> pose;
    Span<const mat3<T>> rotations;
};

/// A shadow: a factor ao_i on the colour of each Gaussian.
///
///     casts()                                  false: there is none, ao = 1, and the passes are not called
///     follows_pose()                           whether ao depends on the pose, so that it holds in new motions
///     forward(input, ao)                       writes ao [N]
///     backward(input, ao, dL_dao, dL_dpose)    adds to learned(), and to dL_dpose [J] unless that is empty;
///                                              overwrites dL_dao, which is scratch afterwards
///     backward_to_pose(input, ao, dL_dao, dL_dpose)      the same for dL_dpose alone, the shadow being what it is
///     baked()                                  the field that an avatar file keeps, for a shadow that follows the pose
template <class S, class B, class T>
concept ShadowPolicy = requires(S& shadow, const S& constant, const ShadowInput<B, T>& input, Span<const T> ao,
                                Span<T> values, Span<vec3<T>> dL_dpose) {
    { constant.casts() } -> std::same_as<bool>;
    { constant.follows_pose() } -> std::same_as<bool>;
    shadow.forward(input, values);
    shadow.backward(input, ao, values, dL_dpose);
    shadow.backward_to_pose(input, ao, values, dL_dpose);
    { shadow.learned() } -> std::same_as<LearnedArrays<T>>;
    { constant.baked() } -> std::same_as<std::optional<OcclusionFieldData>>;
};

/// No shadow: ao = 1.
template <Backend B, std::floating_point T = float>
struct NoShadow {
    [[nodiscard]] bool casts() const { return false; }
    [[nodiscard]] bool follows_pose() const { return false; }
    void forward(const ShadowInput<B, T>&, Span<T>) {}
    void backward(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
    void backward_to_pose(const ShadowInput<B, T>&, Span<const T>, Span<T>, Span<vec3<T>>) {}
    [[nodiscard]] LearnedArrays<T> learned() { return {}; }
    [[nodiscard]] std::optional<OcclusionFieldData> baked() const { return std::nullopt; }
};

/// Any shadow, chosen while running: a virtual call for each pass.
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
        [[nodiscard]] std::optional<OcclusionFieldData> baked() const override { return policy.baked(); }
    };
    std::unique_ptr<Interface> self_;
};

} // namespace gsh
