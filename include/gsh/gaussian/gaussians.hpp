// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians before activation: one contiguous array per attribute, on a backend or on the host.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

/// Views of N Gaussians; `GaussiansView<const T>` is an input, `GaussiansView<T>` an output or a gradient. In a
/// gradient an empty attribute is not written.
///
/// Shapes  means [N], quats [N] of any length but zero, log_scales [N], opacity_logits [N], sh [N, (sh_degree+1)²] RGB.
/// Units   metres, logarithm of metres; opacities before the sigmoid; display-referred sRGB.
template <class T>
struct GaussiansView {
    using Scalar = std::remove_const_t<T>;
    template <class U>
    using Like = std::conditional_t<std::is_const_v<T>, const U, U>;

    Span<Like<vec3<Scalar>>> means;
    Span<Like<quat<Scalar>>> quats;
    Span<Like<vec3<Scalar>>> log_scales;
    Span<T> opacity_logits;
    Span<Like<vec3<Scalar>>> sh;
    int sh_degree = 0;

    [[nodiscard]] GSH_HD std::size_t size() const { return means.size(); }
    template <std::same_as<T> U> // a template, because nvcc warns about a conversion to the same type
        requires(!std::is_const_v<T>)
    [[nodiscard]] operator GaussiansView<const U>() const
    {
        return {means, quats, log_scales, opacity_logits, sh, sh_degree};
    }
};

namespace detail {

/// Adds a Gaussian's gradient, but for its coefficients, to the arrays of `to` that are not empty. `to` is a view with
/// the names of GaussiansView, and `gradient` has those of one Gaussian.
template <class Gradient, class View>
GSH_HD void add_attributes(const Gradient& gradient, const View& to, std::size_t i) {
    if (!to.means.empty()) to.means[i] += gradient.mean;
    if (!to.quats.empty()) to.quats[i] += gradient.q;
    if (!to.log_scales.empty()) to.log_scales[i] += gradient.log_scale;
    if (!to.opacity_logits.empty()) to.opacity_logits[i] += gradient.opacity_logit;
}

} // namespace detail

/// Sets every number of every attribute to zero, the initial value of a gradient or of a moment of Adam. The default
/// quat{} is the identity rotation and would be wrong here.
template <Backend B, std::floating_point T>
void fill_zero(B& backend, const GaussiansView<T>& gradient) {
    backend.fill(gradient.means, vec3<T>(T(0)));
    backend.fill(gradient.quats, quat<T>{T(0), T(0), T(0), T(0)});
    backend.fill(gradient.log_scales, vec3<T>(T(0)));
    backend.fill(gradient.opacity_logits, T(0));
    backend.fill(gradient.sh, vec3<T>(T(0)));
}

/// Throws ShapeError unless every attribute has the size for `count` Gaussians. If `optional`, an attribute may be
/// empty.
template <class T>
void check_gaussians(std::string_view where, std::string_view argument, const GaussiansView<T>& view,
                     std::size_t count, bool optional = false) {
    const auto check = [&](const char* name, std::size_t found, std::size_t expected, std::string_view hint) {
        if (optional && found == 0) return;
        check_size(where, std::string(argument) + "." + name, found, expected, hint);
    };
    const auto basis = static_cast<std::size_t>(sh_basis_count(view.sh_degree));
    check("means", view.means.size(), count, "one mean per Gaussian");
    check("quats", view.quats.size(), count, "one quaternion per Gaussian");
    check("log_scales", view.log_scales.size(), count, "three log-scales per Gaussian");
    check("opacity_logits", view.opacity_logits.size(), count, "one opacity logit per Gaussian");
    check("sh", view.sh.size(), count * basis, "(sh_degree + 1)² RGB coefficients per Gaussian");
}

/// Throws MemoryError unless the backend reaches every attribute.
template <Backend B, class T>
void check_memory(const B& backend, std::string_view where, std::string_view argument, const GaussiansView<T>& view) {
    check_memory(backend, where, argument, view.means, "means");
    check_memory(backend, where, argument, view.quats, "quats");
    check_memory(backend, where, argument, view.log_scales, "log_scales");
    check_memory(backend, where, argument, view.opacity_logits, "opacity_logits");
    check_memory(backend, where, argument, view.sh, "sh");
}

/// Storage behind a GaussiansView, in the backend's memory.
template <Backend B, std::floating_point T = float>
struct Gaussians {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    Buffer<vec3<T>> means;
    Buffer<quat<T>> quats;
    Buffer<vec3<T>> log_scales;
    Buffer<T> opacity_logits;
    Buffer<vec3<T>> sh;
    int sh_degree = 0;

    void resize(std::size_t count, int degree) {
        means.resize(count);
        quats.resize(count);
        log_scales.resize(count);
        opacity_logits.resize(count);
        sh.resize(count * static_cast<std::size_t>(sh_basis_count(degree)));
        sh_degree = degree;
    }
    [[nodiscard]] std::size_t size() const { return means.size(); }
    [[nodiscard]] GaussiansView<T> view() { return {means, quats, log_scales, opacity_logits, sh, sh_degree}; }
    [[nodiscard]] GaussiansView<const T> view() const {
        return {means, quats, log_scales, opacity_logits, sh, sh_degree};
    }
};

/// Gaussians in host memory, in the form in which files store them.
template <class T>
struct GaussianCloud {
    std::vector<vec3<T>> means;
    std::vector<quat<T>> quats;
    std::vector<vec3<T>> log_scales;
    std::vector<T> opacity_logits;
    std::vector<vec3<T>> sh;
    int sh_degree = 0;

    GaussianCloud() = default;
    GaussianCloud(std::size_t count, int degree) { resize(count, degree); }

    /// New Gaussians are at the origin with scale 1, opacity 1/2 and grey colour.
    void resize(std::size_t count, int degree) {
        means.resize(count, vec3<T>(T(0)));
        quats.resize(count);
        log_scales.resize(count, vec3<T>(T(0)));
        opacity_logits.resize(count, T(0));
        sh.resize(count * static_cast<std::size_t>(sh_basis_count(degree)), vec3<T>(T(0)));
        sh_degree = degree;
    }
    [[nodiscard]] std::size_t size() const { return means.size(); }
    [[nodiscard]] GaussiansView<T> view() { return {means, quats, log_scales, opacity_logits, sh, sh_degree}; }
    [[nodiscard]] GaussiansView<const T> view() const {
        return {means, quats, log_scales, opacity_logits, sh, sh_degree};
    }
};

/// Copies a cloud into the backend's memory and resizes `gaussians` to match.
template <Backend B, std::floating_point T = float>
void upload(B& backend, const GaussianCloud<T>& cloud, Gaussians<B, T>& gaussians) {
    check_gaussians("upload", "cloud", cloud.view(), cloud.size());
    gaussians.resize(cloud.size(), cloud.sh_degree);
    const GaussiansView<const T> from = cloud.view();
    const GaussiansView<T> to = gaussians.view();
    backend.upload(from.means, to.means);
    backend.upload(from.quats, to.quats);
    backend.upload(from.log_scales, to.log_scales);
    backend.upload(from.opacity_logits, to.opacity_logits);
    backend.upload(from.sh, to.sh);
}

/// Copies Gaussians from the backend's memory to the host.
template <Backend B, std::floating_point T = float>
[[nodiscard]] GaussianCloud<T> download(B& backend, const Gaussians<B, T>& gaussians) {
    GaussianCloud<T> cloud(gaussians.size(), gaussians.sh_degree);
    const GaussiansView<const T> from = gaussians.view();
    const GaussiansView<T> to = cloud.view();
    backend.download(from.means, to.means);
    backend.download(from.quats, to.quats);
    backend.download(from.log_scales, to.log_scales);
    backend.download(from.opacity_logits, to.opacity_logits);
    backend.download(from.sh, to.sh);
    return cloud;
}

/// Calls f(std::integral_constant<int, degree>) for a degree that is known only at run time.
/// Errors  ValueError unless 0 <= degree <= 4.
template <class F>
decltype(auto) with_sh_degree(int degree, F&& f) {
    switch (degree) {
    case 0: return f(std::integral_constant<int, 0>{});
    case 1: return f(std::integral_constant<int, 1>{});
    case 2: return f(std::integral_constant<int, 2>{});
    case 3: return f(std::integral_constant<int, 3>{});
    case 4: return f(std::integral_constant<int, 4>{});
    default:
        throw ValueError("with_sh_degree: degree is " + std::to_string(degree) +
                         ", expected 0 to 4; pad or cut the coefficients");
    }
}

} // namespace gsh
