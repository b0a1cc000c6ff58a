// SPDX-License-Identifier: Apache-2.0
/// @file  A plain and slow rasterizer from the definition, as reference: for every pixel all Gaussians in the order of
///        z, in double. It shares only data types with the library.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <vector>

namespace gsh::test {

struct ReferenceOptions {
    double alpha_min = 1.0 / 255, alpha_max = 0.99, transmittance_min = 1e-4;
    double dilation = 0.3, near_plane = 0.2, jacobian_margin = 0.15;
    bool compensate_opacity = false;
    double compensation_floor = 0.000025;
};

struct Reference {
    Image<double> color, alpha, expected_depth, median_depth;
    /// How close each pixel is to a decision that rounding can change.
    Image<double> cut_margin;  ///< least |alpha / alpha_min - 1| of all splats that a live pixel met
    Image<double> stop_margin; ///< least |T / transmittance_min - 1| after a splat
    Image<double> half_margin; ///< least |T / 0.5 - 1| after a splat: the median depth is that of the one at 0.5
    Image<double> depth_gap; ///< least distance in z, relative to z, of two neighbours among the splats that count here
};

struct ReferenceSplat {
    double z = 0, px = 0, py = 0, conic_a = 0, conic_b = 0, conic_c = 0, opacity = 0;
    std::size_t index = 0;
};

/// Projects one Gaussian: x_cam = R x + t, J R Σ Rᵀ Jᵀ + dilation. Returns false if it is culled.
inline bool reference_project(const Camera<double>& camera, const SplatView<const double>& splats, std::size_t index,
                              const ReferenceOptions& o, ReferenceSplat& out) {
    double R[3][3], t[3], mean[3], p[3];
    for (int i = 0; i < 3; ++i) {
        t[i] = camera.t[i], mean[i] = splats.means[index][i];
        for (int j = 0; j < 3; ++j) R[i][j] = camera.R[j][i];
    }
    for (int i = 0; i < 3; ++i) p[i] = R[i][0] * mean[0] + R[i][1] * mean[1] + R[i][2] * mean[2] + t[i];
    if (!(p[2] > o.near_plane)) return false;

    const double W = camera.width, H = camera.height, x = p[0] / p[2], y = p[1] / p[2];
    const double jx = std::clamp(x, -camera.cx / camera.fx - o.jacobian_margin * W / camera.fx,
                                 (W - camera.cx) / camera.fx + o.jacobian_margin * W / camera.fx);
    const double jy = std::clamp(y, -camera.cy / camera.fy - o.jacobian_margin * H / camera.fy,
                                 (H - camera.cy) / camera.fy + o.jacobian_margin * H / camera.fy);
    const double J[2][3] = {{camera.fx / p[2], 0, -camera.fx * jx / p[2]},
                            {0, camera.fy / p[2], -camera.fy * jy / p[2]}};
    const sym3<double>& s = splats.covariances[index];
    const double sigma[3][3] = {{s.xx, s.xy, s.xz}, {s.xy, s.yy, s.yz}, {s.xz, s.yz, s.zz}};
    double M[2][3] = {}, cov[2][2] = {};
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) M[i][j] += J[i][k] * R[k][j];
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2; ++j)
            for (int k = 0; k < 3; ++k)
                for (int l = 0; l < 3; ++l) cov[i][j] += M[i][k] * sigma[k][l] * M[j][l];
    const double det_before = cov[0][0] * cov[1][1] - cov[0][1] * cov[1][0];
    cov[0][0] += o.dilation;
    cov[1][1] += o.dilation;
    const double det = cov[0][0] * cov[1][1] - cov[0][1] * cov[1][0];
    if (!(det > 0)) return false;

    out.z = p[2];
    out.px = camera.fx * x + camera.cx;
    out.py = camera.fy * y + camera.cy;
    out.conic_a = cov[1][1] / det, out.conic_b = -cov[0][1] / det, out.conic_c = cov[0][0] / det;
    out.opacity = splats.opacities[index];
    if (o.compensate_opacity) out.opacity *= std::sqrt(std::max(o.compensation_floor, det_before / det));
    out.index = index;
    return true;
}

/// Renders over a colour, or over `background` if that is not empty.
inline Reference reference_rasterize(const Camera<double>& camera, const SplatView<const double>& splats,
                                     const vec3<double>& background_color,
                                     const ImageView<const double>& background = {},
                                     const ReferenceOptions& o = {}) {
    std::vector<ReferenceSplat> sorted;
    for (std::size_t i = 0; i < splats.size(); ++i) {
        ReferenceSplat splat;
        if (reference_project(camera, splats, i, o, splat)) sorted.push_back(splat);
    }
    std::sort(sorted.begin(), sorted.end(),
              [](const auto& a, const auto& b) { return a.z < b.z || (a.z == b.z && a.index < b.index); });

    const int H = camera.height, W = camera.width;
    constexpr double infinity = std::numeric_limits<double>::infinity();
    Reference out{Image<double>(3, H, W), Image<double>(1, H, W), Image<double>(1, H, W), Image<double>(1, H, W),
                  Image<double>(1, H, W, infinity), Image<double>(1, H, W, infinity), Image<double>(1, H, W, infinity),
                  Image<double>(1, H, W, infinity)};
    for (int py = 0; py < H; ++py)
        for (int px = 0; px < W; ++px) {
            double T = 1, color[3] = {0, 0, 0}, depth = 0, median = 0, last_z = -infinity;
            for (const ReferenceSplat& splat : sorted) {
                const double dx = px + 0.5 - splat.px, dy = py + 0.5 - splat.py;
                const double q = splat.conic_a * dx * dx + 2 * splat.conic_b * dx * dy + splat.conic_c * dy * dy;
                const double alpha = std::min(o.alpha_max, splat.opacity * std::exp(-0.5 * q));
                double& margin = out.cut_margin.at(0, py, px);
                margin = std::min(margin, std::abs(alpha / o.alpha_min - 1));
                if (alpha < o.alpha_min) continue;
                out.depth_gap.at(0, py, px) = std::min(out.depth_gap.at(0, py, px), (splat.z - last_z) / splat.z);
                last_z = splat.z;
                const double after = T * (1 - alpha);
                double& half = out.half_margin.at(0, py, px);
                half = std::min(half, std::abs(after / 0.5 - 1));
                if (o.transmittance_min > 0)
                    out.stop_margin.at(0, py, px) =
                        std::min(out.stop_margin.at(0, py, px), std::abs(after / o.transmittance_min - 1));
                if (after < o.transmittance_min) break;
                for (int c = 0; c < 3; ++c) color[c] += T * alpha * splats.colors[splat.index][c];
                depth += T * alpha * splat.z;
                if (T > 0.5 && after <= 0.5) median = splat.z;
                T = after;
            }
            for (int c = 0; c < 3; ++c)
                out.color.at(c, py, px) =
                    color[c] + T * (background.empty() ? background_color[c] : background.at(c, py, px));
            out.alpha.at(0, py, px) = 1 - T;
            out.expected_depth.at(0, py, px) = depth;
            out.median_depth.at(0, py, px) = median;
        }
    return out;
}

} // namespace gsh::test
