// SPDX-License-Identifier: Apache-2.0
/// @file  One Gaussian in the place of several: their mean, their covariance, and how much they cover.
#pragma once

#include <gsh/gaussian/covariance.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/principal_axes.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace gsh {

/// Several Gaussians as a mixture, and how much of a picture they cover.
///
/// A Gaussian i of opacity α_i, seen along its shortest axis, covers α_i A_i, where the area A_i is 2π times the
/// product of its two larger standard deviations. That is its mass m_i. A mixture has
///
///     m = Σ m_i,    μ = Σ m_i μ_i / m,    C = Σ m_i (C_i + (μ_i - μ)(μ_i - μ)ᵀ) / m,
///
/// whatever the order in which Gaussians are added, but for rounding. Of all Gaussians, the one with mean μ and
/// covariance C is nearest to the mixture in the sense of Kullback and Leibler.
///
/// Where two Gaussians a and b overlap, the one behind adds α_b g_b (1 - α_a g_a) only. Both together cover
///
///     c = c_a + c_b - α_a α_b ∫ g_a g_b,
///     ∫ g_a g_b = 2π √(|P_a| |P_b| / |P_a + P_b|) exp(-½ dᵀ (P_a + P_b)⁻¹ d),
///
/// with the covariances P_a, P_b and the distance d of the means in the plane perpendicular to the shortest axis of C.
///
/// Units   square metres for mass, coverage and covariance.
/// Source  moments: Goldberger and Roweis, "Hierarchical Clustering of a Mixture Model", 2004. Kerbl et al., "A
///         Hierarchical 3D Gaussian Representation", 2024, use them for 3D Gaussians, with the sum of the areas as
///         coverage; the part that overlaps is our own.
struct GaussianMixture {
    double mass = 0;
    double coverage = 0;
    vec3<double> mean = vec3<double>(0);
    sym3<double> covariance = {0, 0, 0, 0, 0, 0};
};

/// One Gaussian, with the numbers of a GaussianCloud.
struct PlainGaussian {
    vec3<double> mean;
    quat<double> q;
    vec3<double> log_scale;
    double opacity_logit;
};

namespace detail {

inline constexpr double least_mass = 1e-24; // square metres

/// 2π times the product of the two larger standard deviations.
[[nodiscard]] inline double covered_area(const vec3<double>& scale) {
    const double shortest = std::min({scale.x, scale.y, scale.z});
    return 2 * std::numbers::pi * scale.x * scale.y * scale.z / shortest;
}

/// The covariance in the plane of u and v.
[[nodiscard]] inline sym2<double> in_plane(const sym3<double>& s, const vec3<double>& u, const vec3<double>& v) {
    const mat3<double> S = full_matrix(s);
    const vec3<double> Su = S * u, Sv = S * v;
    return {dot(u, Su), dot(u, Sv), dot(v, Sv)};
}

/// The covariance of two mixtures together: the mean of both, and the scatter of their means.
[[nodiscard]] inline sym3<double> mixed_covariance(const GaussianMixture& a, const GaussianMixture& b) {
    const double m = a.mass + b.mass, p = a.mass / m, q = b.mass / m;
    const vec3<double> d = (b.mean - a.mean) * std::sqrt(p * q);
    const sym3<double>&s = a.covariance, &t = b.covariance;
    return {p * s.xx + q * t.xx + d.x * d.x, p * s.xy + q * t.xy + d.x * d.y, p * s.xz + q * t.xz + d.x * d.z,
            p * s.yy + q * t.yy + d.y * d.y, p * s.yz + q * t.yz + d.y * d.z, p * s.zz + q * t.zz + d.z * d.z};
}

/// Axes and standard deviations of a covariance: the axes of a symmetric matrix are its eigenvectors, and the lengths
/// the eigenvalues.
[[nodiscard]] inline PrincipalAxes<double> axes_of_covariance(const sym3<double>& covariance) {
    PrincipalAxes<double> axes = principal_axes(full_matrix(covariance));
    axes.lengths = glm::sqrt(axes.lengths);
    return axes;
}

/// The number of the shortest axis.
[[nodiscard]] inline int shortest_of(const vec3<double>& lengths) {
    int shortest = 0;
    for (int k = 1; k < 3; ++k)
        if (lengths[k] < lengths[shortest]) shortest = k;
    return shortest;
}

/// ∫ g_a g_b over the plane of u and v.
[[nodiscard]] inline double overlap(const GaussianMixture& a, const GaussianMixture& b, const vec3<double>& u,
                                    const vec3<double>& v) {
    const sym2<double> A = in_plane(a.covariance, u, v), B = in_plane(b.covariance, u, v);
    const sym2<double> S{A.xx + B.xx, A.xy + B.xy, A.yy + B.yy};
    const double det = determinant(S);
    if (!(det > 0)) return 0;
    const vec3<double> between = b.mean - a.mean;
    const double x = dot(u, between), y = dot(v, between);
    const double squared = (S.yy * x * x - 2 * S.xy * x * y + S.xx * y * y) / det;
    const double areas = std::max(determinant(A), 0.0) * std::max(determinant(B), 0.0);
    return 2 * std::numbers::pi * std::sqrt(areas / det) * std::exp(-0.5 * squared);
}

} // namespace detail

/// The mixture of a single Gaussian. An invisible one has a tiny mass above 0, so that every mixture has a mean.
[[nodiscard]] inline GaussianMixture mixture_of(const PlainGaussian& gaussian) {
    const vec3<double> scale = glm::exp(gaussian.log_scale);
    const double covered = std::max(sigmoid(gaussian.opacity_logit) * detail::covered_area(scale), detail::least_mass);
    return {covered, covered, gaussian.mean, covariance(gaussian.q, gaussian.log_scale)};
}

/// Both mixtures together.
[[nodiscard]] inline GaussianMixture merged(const GaussianMixture& a, const GaussianMixture& b) {
    const double m = a.mass + b.mass;
    GaussianMixture both{m, a.coverage + b.coverage, (a.mean * a.mass + b.mean * b.mass) * (1 / m),
                         detail::mixed_covariance(a, b)};
    const PrincipalAxes<double> axes = detail::axes_of_covariance(both.covariance);
    const int normal = detail::shortest_of(axes.lengths);
    const vec3<double>&u = axes.R[(normal + 1) % 3], &v = axes.R[(normal + 2) % 3];
    const auto opacity = [&](const GaussianMixture& part) {
        const double area =
            2 * std::numbers::pi * std::sqrt(std::max(determinant(detail::in_plane(part.covariance, u, v)), 0.0));
        return area > 0 ? std::min(part.coverage / area, 1.0) : 0.0;
    };
    both.coverage -= opacity(a) * opacity(b) * detail::overlap(a, b, u, v);
    return both;
}

/// The Gaussian with the moments of a mixture, and with the opacity c / A that covers as much. Opacities end at 0.99,
/// as in the rasterizer. A mixture that covers more gets a larger area instead, at most twice that of its moments.
[[nodiscard]] inline PlainGaussian gaussian_of(const GaussianMixture& mixture) {
    constexpr double most = 0.99, least = 1e-6, shortest_length = 1e-6; // metres
    PrincipalAxes<double> axes = detail::axes_of_covariance(mixture.covariance);
    for (int k = 0; k < 3; ++k) axes.lengths[k] = std::max(axes.lengths[k], shortest_length);
    const double opacity = mixture.coverage / detail::covered_area(axes.lengths);
    if (opacity > most) {
        const double grown = std::sqrt(std::min(opacity / most, 2.0));
        const int normal = detail::shortest_of(axes.lengths);
        for (int k = 0; k < 3; ++k)
            if (k != normal) axes.lengths[k] *= grown;
    }
    return {mixture.mean, quat_from_rotation(axes.R), glm::log(axes.lengths), logit(std::clamp(opacity, least, most))};
}

} // namespace gsh
