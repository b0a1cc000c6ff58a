// SPDX-License-Identifier: Apache-2.0
/// @file  Scenes of needles, and a dense renderer in long double: for every pixel all Gaussians by z, from their
///        quaternions and scales. It shares only data types with the library.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/image/image.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::test {

inline const vec3<double> needle_background(0.2, 0.4, 0.6);

inline Camera<double> needle_camera() {
    Camera<double> camera;
    camera.R = mat3<double>({1, 0, 0}, {0, -1, 0}, {0, 0, -1});
    camera.t = vec3<double>(0, 0, 5);
    camera.fx = camera.fy = 48, camera.cx = camera.cy = 20;
    camera.width = camera.height = 40;
    return camera;
}

/// `count` Gaussians of some centimetres, and before them four needles of 5 cm by e^log_length metres.
inline GaussianCloud<float> needles(float log_length, std::size_t count) {
    GaussianCloud<float> cloud(count + 4, 0);
    Rng rng(11);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const auto q = rng.quat();
        cloud.means[i] = vec3<float>(rng.vec() * 0.8);
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.log_scales[i] = vec3<float>(rng.vec(-4, -2));
        cloud.opacity_logits[i] = static_cast<float>(rng.uniform(-1, 3));
        cloud.sh[i] = vec3<float>(rng.vec() * 1.5);
        if (i >= 4) continue;
        cloud.means[i] = vec3<float>(rng.vec() * 0.5) + vec3<float>(0, 0, -3);
        // Along the image: a needle towards the camera is short there.
        const double angle = rng.uniform(0.2, 1.3);
        cloud.quats[i] = {float(std::cos(angle)), 0.01f, -0.02f, float(std::sin(angle))};
        cloud.log_scales[i] = {log_length, -3, -3};
    }
    return cloud;
}

[[nodiscard]] inline GaussianCloud<double> in_double(const GaussianCloud<float>& cloud) {
    GaussianCloud<double> result(cloud.size(), cloud.sh_degree);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const quat<float>& q = cloud.quats[i];
        result.means[i] = vec3<double>(cloud.means[i]), result.quats[i] = {q.w, q.x, q.y, q.z};
        result.log_scales[i] = vec3<double>(cloud.log_scales[i]), result.opacity_logits[i] = cloud.opacity_logits[i];
    }
    for (std::size_t k = 0; k < cloud.sh.size(); ++k) result.sh[k] = vec3<double>(cloud.sh[k]);
    return result;
}

struct DenseImage {
    int width, height;
    std::vector<std::array<double, 3>> pixels;
    std::vector<bool> decided; ///< no splat is near the cut, and the transmittance is not near its limit
};

inline DenseImage dense_picture(const GaussianCloud<float>& cloud, const Camera<double>& camera, bool compensate) {
    using L = long double;
    struct Drawn {
        L z, x, y, xx, xy, yy, opacity; // conic
        std::array<L, 3> color;
    };
    std::vector<Drawn> drawn;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const auto& q = cloud.quats[i];
        const L n = std::sqrt(L(q.w) * q.w + L(q.x) * q.x + L(q.y) * q.y + L(q.z) * q.z), w = q.w / n, x = q.x / n,
                y = q.y / n, z = q.z / n;
        const L R[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                           {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                           {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
        L p[3], in_camera[3][3] = {};
        for (int r = 0; r < 3; ++r) {
            p[r] = camera.t[r];
            for (int k = 0; k < 3; ++k) {
                p[r] += L(camera.R[k][r]) * cloud.means[i][k];
                for (int c = 0; c < 3; ++c)
                    in_camera[r][c] += L(camera.R[k][r]) * R[k][c] * std::exp(L(cloud.log_scales[i][c]));
            }
        }
        if (!(p[2] > 0.2L)) continue;
        const L W = camera.width, H = camera.height, margin = 0.15L;
        const L jx = std::clamp(L(camera.fx) * p[0] / p[2], -L(camera.cx) - margin * W, W - camera.cx + margin * W);
        const L jy = std::clamp(L(camera.fy) * p[1] / p[2], -L(camera.cy) - margin * H, H - camera.cy + margin * H);
        L u[3], v[3];
        for (int c = 0; c < 3; ++c) {
            u[c] = (camera.fx * in_camera[0][c] - jx * in_camera[2][c]) / p[2];
            v[c] = (camera.fy * in_camera[1][c] - jy * in_camera[2][c]) / p[2];
        }
        const L N[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
        const auto dot = [](const L* a, const L* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; };
        const L dilation = 0.3L, xx = dot(u, u), xy = dot(u, v), yy = dot(v, v), sharp = dot(N, N),
                det = sharp + dilation * (xx + yy) + dilation * dilation;
        Drawn d{p[2],
                camera.fx * p[0] / p[2] + camera.cx,
                camera.fy * p[1] / p[2] + camera.cy,
                (yy + dilation) / det,
                -xy / det,
                (xx + dilation) / det,
                1 / (1 + std::exp(-L(cloud.opacity_logits[i]))),
                {}};
        if (compensate) d.opacity *= std::sqrt(std::max(sharp / det, 0.000025L));
        for (int c = 0; c < 3; ++c) d.color[c] = std::max(0.28209479177387814L * cloud.sh[i][c] + 0.5L, 0.0L);
        drawn.push_back(d);
    }
    std::sort(drawn.begin(), drawn.end(), [](const Drawn& a, const Drawn& b) { return a.z < b.z; });
    DenseImage image{camera.width, camera.height, {}, {}};
    for (int row = 0; row < camera.height; ++row)
        for (int column = 0; column < camera.width; ++column) {
            L T = 1;
            std::array<L, 3> color{};
            bool decided = true;
            for (const Drawn& d : drawn) {
                const L x = column + 0.5L - d.x, y = row + 0.5L - d.y;
                const L power = d.xx * x * x + 2 * d.xy * x * y + d.yy * y * y,
                        alpha = std::min(0.99L, d.opacity * std::exp(-power / 2));
                decided = decided && std::abs(alpha * 255 - 1) > 1e-4L;
                if (alpha < L(1) / 255) continue;
                decided = decided && std::abs(T * (1 - alpha) / 1e-4L - 1) > 1e-4L;
                if (T * (1 - alpha) < 1e-4L) break;
                for (std::size_t c = 0; c < 3; ++c) color[c] += T * alpha * d.color[c];
                T *= 1 - alpha;
            }
            std::array<double, 3> pixel{};
            for (int c = 0; c < 3; ++c)
                pixel[static_cast<std::size_t>(c)] =
                    static_cast<double>(color[static_cast<std::size_t>(c)] + T * needle_background[c]);
            image.pixels.push_back(pixel), image.decided.push_back(decided);
        }
    return image;
}

/// The largest difference of a channel, at pixels that no rounding decides.
[[nodiscard]] inline double largest_error(const Image<float>& found, const DenseImage& expected) {
    double largest = 0;
    for (int row = 0; row < expected.height; ++row)
        for (int column = 0; column < expected.width; ++column) {
            const auto at = static_cast<std::size_t>(row * expected.width + column);
            for (int c = 0; expected.decided[at] && c < 3; ++c) {
                const double d =
                    std::abs(double(found.at(c, row, column)) - expected.pixels[at][static_cast<std::size_t>(c)]);
                largest = d <= largest ? largest : d; // a NaN stays
            }
        }
    return largest;
}

} // namespace gsh::test
