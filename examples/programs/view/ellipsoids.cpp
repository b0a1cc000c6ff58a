// SPDX-License-Identifier: Apache-2.0
#include "view/ellipsoids.hpp"

#include <gsh/core/span.hpp>
#include <gsh/render/projection.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh::examples {

namespace {

/// An ellipse on the image: q = a dx² + 2 b dx dy + c dy².
struct Ellipse2d {
    vec2<float> center;
    float a = 0, b = 0, c = 0;
    float depth = 0, bulge = 0;                   ///< bulge: r σ_z
    int left = 0, right = 0, top = 0, bottom = 0; ///< pixels, half-open
};

Ellipse2d ellipse_of(const Camera<float>& camera, const SplatView<const float>& splats, std::size_t i) {
    constexpr float r = ellipsoid_radius, thinnest = 0.02f; // px²: keeps the inverse finite
    Ellipse2d e;
    if (!(splats.opacities[i] >= ellipsoid_opacity)) return e;
    const sym3<float>& s = splats.covariances[i];
    ProjectionParams<float> params;
    params.dilation = thinnest;
    const Projection<float> p = project(camera, splats.means[i], s, params);
    if (!p.in_front) return e;
    const sym2<float>& v = p.covariance;
    const float inverse = 1 / (v.xx * v.yy - v.xy * v.xy);
    if (!std::isfinite(inverse) || !std::isfinite(p.mean2d.x + p.mean2d.y)) return e;
    const vec3<float> z(camera.R[0].z, camera.R[1].z, camera.R[2].z);
    const float variance = s.xx * z.x * z.x + s.yy * z.y * z.y + s.zz * z.z * z.z +
                           2 * (s.xy * z.x * z.y + s.xz * z.x * z.z + s.yz * z.y * z.z);
    e.center = p.mean2d, e.depth = p.depth, e.bulge = r * std::sqrt(std::max(variance, 0.0f));
    e.a = v.yy * inverse, e.b = -v.xy * inverse, e.c = v.xx * inverse;
    const auto clip = [](float x, int size) {
        return static_cast<int>(std::clamp(std::ceil(x - 0.5f), 0.0f, static_cast<float>(size)));
    };
    const float reach_x = r * std::sqrt(v.xx), reach_y = r * std::sqrt(v.yy);
    e.left = clip(p.mean2d.x - reach_x, camera.width), e.right = clip(p.mean2d.x + reach_x, camera.width);
    e.top = clip(p.mean2d.y - reach_y, camera.height), e.bottom = clip(p.mean2d.y + reach_y, camera.height);
    return e;
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

} // namespace gsh::examples
