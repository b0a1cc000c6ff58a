// SPDX-License-Identifier: Apache-2.0
/// @file  Appearance policies: the concept of what gives an avatar's colours and displacements, and AnyAppearance.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <memory>
#include <type_traits>
#include <utility>

namespace gsh {

/// Colours and displacements of N Gaussians, in the memory of the policy. Strides allow one row to hold both.
///
/// Shapes  sh [N, sh_stride] RGB coefficients; the first (degree + 1)² of each row are used. Element
///         i displacement_stride of displacements is Gaussian i's δx.
/// Units   metres, in the canonical frame.
template <class T>
struct AppearanceView {
    Span<const vec3<T>> sh;
    std::size_t sh_stride = 0;
    Span<const vec3<T>> displacements;
    std::size_t displacement_stride = 1;
};

/// Where the gradient of the colours is added. Rows are those of AppearanceView::sh.
template <class T>
struct ColorGradient {
    Span<vec3<T>> sh;
    std::size_t sh_stride = 0;
};

/// An appearance gives colours as spherical harmonics, and the canonical displacement of each Gaussian.
///
///     forward(frame)              evaluates both; only fields that read the time depend on the frame
///     view()                      returns the results of forward
///     color_gradient()            returns where skinning adds the gradient of the colours: zeros, or, for stored
///                                 colours, the array's own gradient
///     backward(frame, dL_dmeans)  adjoint of forward, from that gradient and dL_dmeans [N], which is that of the
///                                 displacements, too; adds to the gradients of learned()
///     reads_time()                whether forward depends on the frame
///
/// An appearance may also have lookups(), the number of table rows that forward reads, for reports, and
/// release_memory(), which frees what passes keep for the next one, but for the results of forward.
template <class A, class T>
concept AppearancePolicy = requires(A& appearance, const A& constant, std::size_t frame, Span<vec3<T>> dL_dmeans) {
    requires std::same_as<std::remove_cvref_t<decltype(A::sh_degree)>, int>;
    appearance.forward(frame);
    { constant.view() } -> std::same_as<AppearanceView<T>>;
    { appearance.color_gradient() } -> std::same_as<ColorGradient<T>>;
    appearance.backward(frame, dL_dmeans);
    { appearance.learned() } -> std::same_as<LearnedArrays<T>>;
    { constant.reads_time() } -> std::same_as<bool>;
};

/// The table rows that an appearance reads: none where it does not say.
template <class A>
[[nodiscard]] std::size_t lookups_of(const A& appearance) {
    if constexpr (requires { appearance.lookups(); }) return appearance.lookups();
    else return 0;
}

/// Frees what the passes of an appearance keep, where it can.
template <class A>
void release_memory_of(A& appearance) {
    if constexpr (requires { appearance.release_memory(); }) appearance.release_memory();
}

/// Any appearance of one degree, chosen at run time. Each pass costs a virtual call.
template <std::floating_point T, int Degree>
class AnyAppearance {
public:
    static constexpr int sh_degree = Degree;

    template <class A>
        requires(!std::same_as<std::remove_cvref_t<A>, AnyAppearance> && AppearancePolicy<std::remove_cvref_t<A>, T> &&
                 std::remove_cvref_t<A>::sh_degree == Degree)
    AnyAppearance(A&& appearance)
        : self_(std::make_unique<Model<std::remove_cvref_t<A>>>(std::forward<A>(appearance))) {}

    void forward(std::size_t frame) { self_->forward(frame); }
    [[nodiscard]] AppearanceView<T> view() const { return self_->view(); }
    [[nodiscard]] ColorGradient<T> color_gradient() { return self_->color_gradient(); }
    void backward(std::size_t frame, Span<vec3<T>> dL_dmeans) { self_->backward(frame, dL_dmeans); }
    [[nodiscard]] LearnedArrays<T> learned() { return self_->learned(); }
    [[nodiscard]] bool reads_time() const { return self_->reads_time(); }
    [[nodiscard]] std::size_t lookups() const { return self_->lookups(); }
    void release_memory() { self_->release_memory(); }

private:
    struct Interface {
        virtual ~Interface() = default;
        virtual void forward(std::size_t frame) = 0;
        [[nodiscard]] virtual AppearanceView<T> view() const = 0;
        [[nodiscard]] virtual ColorGradient<T> color_gradient() = 0;
        virtual void backward(std::size_t frame, Span<vec3<T>> dL_dmeans) = 0;
        [[nodiscard]] virtual LearnedArrays<T> learned() = 0;
        [[nodiscard]] virtual bool reads_time() const = 0;
        [[nodiscard]] virtual std::size_t lookups() const = 0;
        virtual void release_memory() = 0;
    };
    template <class A>
    struct Model final : Interface {
        A policy;
        explicit Model(A appearance) : policy(std::move(appearance)) {}
        void forward(std::size_t frame) override { policy.forward(frame); }
        [[nodiscard]] AppearanceView<T> view() const override { return policy.view(); }
        [[nodiscard]] ColorGradient<T> color_gradient() override { return policy.color_gradient(); }
        void backward(std::size_t frame, Span<vec3<T>> dL_dmeans) override { policy.backward(frame, dL_dmeans); }
        [[nodiscard]] LearnedArrays<T> learned() override { return policy.learned(); }
        [[nodiscard]] bool reads_time() const override { return policy.reads_time(); }
        [[nodiscard]] std::size_t lookups() const override { return lookups_of(policy); }
        void release_memory() override { release_memory_of(policy); }
    };
    std::unique_ptr<Interface> self_;
};

} // namespace gsh
