// SPDX-License-Identifier: Apache-2.0
#include "view/ellipsoids.hpp"

#include <gsh/core/span.hpp>
#include <gsh/render/projection.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh::programs {

namespace {

/// An ellipse on the image: q = a dx² + 2 b dx dy + c dy².
struct Ellipse2d {
    vec2<float> center;
    float a = 0, b = 0, c = 0;
    float depth = 0, bulge = 0;                   ///< bulge: r σ_z
    int left = 0, right = 0, top = 0, bottom = 0; ///< pixels, half-open
};

/// The variance along a direction of a covariance, or of a factor of it.
double variance_along(const sym3<double>& s, const vec3<double>& z) {
    return s.xx * z.x * z.x + s.yy * z.y * z.y + s.zz * z.z * z.z +
           2 * (s.xy * z.x * z.y + s.xz * z.x * z.z + s.yz * z.y * z.z);
}
double variance_along(const mat3<double>& factor, const vec3<double>& z) {
    const vec3<double> lengths = transposed_times(factor, z);
    return dot(lengths, lengths);
}

/// In double: the inverse of a thin ellipse is a small difference of large numbers.
template <class Shape>
Ellipse2d ellipse_of(const Camera<float>& camera, const vec3<float>& mean, const Shape& shape) {
    constexpr float r = ellipsoid_radius;
    Ellipse2d e;
    ProjectionParams<double> params;
    params.dilation = 0.02; // px²: keeps the inverse finite
    const Camera<double> exact = camera.cast<double>();
    const Projection<double> p = project(exact, vec3<double>(mean), shape, params);
    if (!p.in_front) return e;
    const sym2<double>& v = p.covariance;
    const double inverse = 1 / p.determinant;
    if (!std::isfinite(inverse) || !std::isfinite(p.mean2d.x + p.mean2d.y)) return e;
    const double variance = variance_along(shape, vec3<double>(exact.R[0].z, exact.R[1].z, exact.R[2].z));
    const vec2<float> center(p.mean2d);
    e.center = center, e.depth = static_cast<float>(p.depth);
    e.bulge = r * static_cast<float>(std::sqrt(std::max(variance, 0.0)));
    e.a = static_cast<float>(v.yy * inverse), e.b = static_cast<float>(-v.xy * inverse);
    e.c = static_cast<float>(v.xx * inverse);
    const auto clip = [](float x, int size) {
        return static_cast<int>(std::clamp(std::ceil(x - 0.5f), 0.0f, static_cast<float>(size)));
    };
    const float reach_x = r * static_cast<float>(std::sqrt(v.xx)), reach_y = r * static_cast<float>(std::sqrt(v.yy));
    e.left = clip(center.x - reach_x, camera.width), e.right = clip(center.x + reach_x, camera.width);
    e.top = clip(center.y - reach_y, camera.height), e.bottom = clip(center.y + reach_y, camera.height);
    return e;
}

Ellipse2d ellipse_of(const Camera<float>& camera, const SplatView<const float>& splats, std::size_t i) {
    if (!(splats.opacities[i] >= ellipsoid_opacity)) return {};
    if (splats.is_factored()) return ellipse_of(camera, splats.means[i], mat3<double>(splats.factors[i]));
    const sym3<float>& s = splats.covariances[i];
    return ellipse_of(camera, splats.means[i], sym3<double>{s.xx, s.xy, s.xz, s.yy, s.yz, s.zz});
}

} // namespace

Image<float> draw_ellipsoids(cpu::Threads& backend, const Camera<float>& camera, const SplatView<const float>& splats,
                             const vec3<float>& background) {
    std::vector<Ellipse2d> ellipses(splats.size());
    backend.for_chunks(splats.size(), 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) ellipses[i] = ellipse_of(camera, splats, i);
    });
    Image<float> picture(3, camera.height, camera.width);
    const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
    const std::size_t plane = width * height;
    constexpr std::size_t band = 32; // rows
    backend.for_chunks(height, band, [&](std::size_t, std::size_t first, std::size_t past) {
        for (std::size_t c = 0; c < 3; ++c)
            std::fill(picture.data.begin() + static_cast<std::ptrdiff_t>(c * plane + first * width),
                      picture.data.begin() + static_cast<std::ptrdiff_t>(c * plane + past * width),
                      background[static_cast<int>(c)]);
        std::vector<float> depths((past - first) * width, std::numeric_limits<float>::infinity());
        for (std::size_t i = 0; i < ellipses.size(); ++i) {
            const Ellipse2d& e = ellipses[i];
            const int top = std::max(e.top, static_cast<int>(first));
            const int bottom = std::min(e.bottom, static_cast<int>(past));
            for (int y = top; y < bottom; ++y)
                for (int x = e.left; x < e.right; ++x) {
                    const float dx = static_cast<float>(x) + 0.5f - e.center.x;
                    const float dy = static_cast<float>(y) + 0.5f - e.center.y;
                    const float q = e.a * dx * dx + 2 * e.b * dx * dy + e.c * dy * dy;
                    const float squared = 1 - q / (ellipsoid_radius * ellipsoid_radius);
                    if (!(squared >= 0)) continue;
                    const float s = std::sqrt(squared), depth = e.depth - s * e.bulge;
                    const std::size_t pixel = static_cast<std::size_t>(y) * width + static_cast<std::size_t>(x);
                    float& nearest = depths[pixel - first * width];
                    if (!(depth < nearest)) continue;
                    nearest = depth;
                    for (std::size_t c = 0; c < 3; ++c)
                        picture.data[c * plane + pixel] = splats.colors[i][static_cast<int>(c)] * (0.35f + 0.65f * s);
                }
        }
    });
    return picture;
}

} // namespace gsh::programs
