// SPDX-License-Identifier: Apache-2.0
/// @file  The numbers of an SPZ file: how each attribute of a Gaussian is stored in a few bytes.
#pragma once

#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

namespace gsh {

/// The streams of an SPZ file, in their order; each holds one attribute of all Gaussians.
struct SpzStreams {
    static constexpr std::size_t count = 6;
    std::array<std::string, count> bytes; // positions, opacities, colours, scales, rotations, SH

    /// Bytes of one Gaussian in each stream.
    [[nodiscard]] static std::array<std::size_t, count> widths(int version, int sh_degree) {
        const auto bands = static_cast<std::size_t>(sh_basis_count(sh_degree) - 1);
        return {version == 1 ? 6u : 9u, 1, 3, 3, version >= 3 ? 4u : 3u, 3 * bands};
    }
};

/// Bits after the point of a position that is usually written: steps of 0.24 mm up to 2048 m.
inline constexpr int spz_fractional_bits = 12;

/// The number of bits after the point with which a cloud loses least. Beyond 2048 m, fewer bits reach farther, in
/// larger steps: a few outliers are not worth it, a large scene is. A Gaussian that ends at the format's edge counts as
/// lost; one that stays within it counts by the squared step of its position over its size, at most as lost.
[[nodiscard]] inline int spz_bits_for(const GaussianCloud<float>& cloud) {
    std::vector<double> reach(cloud.size()), weight(cloud.size());
    double farthest = 0;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const vec3<float>& p = cloud.means[i];
        reach[i] = std::max({std::abs(double(p.x)), std::abs(double(p.y)), std::abs(double(p.z))});
        farthest = std::max(farthest, reach[i]);
        weight[i] = 1 / (12 * size_of(cloud.log_scales[i]) * size_of(cloud.log_scales[i]));
    }
    int best = spz_fractional_bits;
    double least = std::numeric_limits<double>::infinity();
    for (int bits = spz_fractional_bits; bits >= 0; --bits) {
        const double step = std::ldexp(1.0, -bits), edge = 8388607.5 * step;
        double lost = 0;
        for (std::size_t i = 0; i < reach.size(); ++i)
            lost += reach[i] > edge ? 1 : std::min(1.0, step * step * weight[i]);
        if (lost <= least) least = lost, best = bits; // a scene in large steps is more than one in a corner
        if (farthest <= edge) break;
    }
    return best;
}

namespace detail {

inline std::uint8_t byte_of(double value) {
    return static_cast<std::uint8_t>(std::clamp(std::round(value), 0.0, 255.0));
}

/// The logit of an opacity byte; those of 0 and 255 are infinite and end at a quarter of a step.
inline float logit_of_byte(std::uint8_t byte) {
    return static_cast<float>(logit(std::clamp(byte / 255.0, 0.25 / 255, 1 - 0.25 / 255)));
}

/// 2 bits name the largest component in the order x y z w, then come the signs and magnitudes of the others.
inline std::uint32_t spz_rotation(const quat<float>& given) {
    const quat<double> q = normalize(quat<double>{given.w, given.x, given.y, given.z});
    const double components[4] = {q.x, q.y, q.z, q.w};
    std::uint32_t largest = 0;
    for (std::uint32_t k = 1; k < 4; ++k)
        if (std::abs(components[k]) > std::abs(components[largest])) largest = k;
    std::uint32_t bits = largest;
    for (std::uint32_t k = 0; k < 4; ++k) {
        if (k == largest) continue;
        const double value = components[largest] < 0 ? -components[k] : components[k];
        const auto magnitude = std::lround(std::min(511.0, 511 * std::abs(value) * std::sqrt(2.0)));
        bits = bits << 10 | (value < 0 ? 1u << 9 : 0u) | static_cast<std::uint32_t>(magnitude);
    }
    return bits;
}

inline quat<float> quat_of_spz(std::uint32_t bits) {
    const std::uint32_t largest = bits >> 30;
    double components[4] = {}, squares = 0;
    for (std::uint32_t k = 4; k-- > 0;) {
        if (k == largest) continue;
        const double magnitude = (bits & 511u) / (511 * std::sqrt(2.0));
        components[k] = bits & 512u ? -magnitude : magnitude;
        squares += magnitude * magnitude;
        bits >>= 10;
    }
    components[largest] = std::sqrt(std::max(0.0, 1 - squares));
    return {float(components[3]), float(components[0]), float(components[1]), float(components[2])};
}

/// x, y, z as bytes, w >= 0 from the unit length.
inline quat<float> quat_of_spz_bytes(const std::uint8_t* bytes) {
    double v[3], squares = 0;
    for (int k = 0; k < 3; ++k) v[k] = bytes[k] / 127.5 - 1, squares += v[k] * v[k];
    return {float(std::sqrt(std::max(0.0, 1 - squares))), float(v[0]), float(v[1]), float(v[2])};
}

/// The byte of an SH coefficient: 5 bits of precision for degree 1, 4 above, as SPZ's own library writes it.
inline std::uint8_t spz_sh(double value, int degree) {
    const int bucket = degree == 1 ? 8 : 16;
    const int steps = static_cast<int>(std::lround(std::clamp(value, -2.0, 2.0) * 128)) + 128;
    return static_cast<std::uint8_t>(std::clamp((std::max(steps, 0) + bucket / 2) / bucket * bucket, 0, 255));
}

} // namespace detail

/// The streams of versions 3 and 4. Numbers that do not fit end at what the format holds, and are counted: positions
/// beyond 2^23 steps, log-scales beyond -10 to 5.94, constant colours beyond -0.44 to 1.44, and SH beyond 1.
[[nodiscard]] inline SpzStreams spz_streams(const GaussianCloud<float>& cloud, int fractional_bits,
                                            SplatLosses& losses) {
    SpzStreams streams;
    const auto append = [](std::string& out, auto value, std::size_t bytes) {
        out.append(reinterpret_cast<const char*>(&value), bytes);
    };
    auto& [positions, opacities, colors, scales, rotations, bands] = streams.bytes;
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto is_beyond = [](double value, double low, double high) {
        return std::round(value) < low || std::round(value) > high;
    };
    losses.gaussians += cloud.size();
    if (fractional_bits < spz_fractional_bits)
        losses.position_step = std::max(losses.position_step, std::ldexp(1.0, -fractional_bits));
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        bool moved = false, resized = false, recolored = false;
        for (int axis = 0; axis < 3; ++axis) {
            const double fixed = std::round(std::ldexp(double(cloud.means[i][axis]), fractional_bits)),
                         color = cloud.sh[i * basis][axis] * 0.15 * 255 + 127.5,
                         scale = (cloud.log_scales[i][axis] + 10.0) * 16;
            append(positions, static_cast<std::int32_t>(std::clamp(fixed, -8388608.0, 8388607.0)), 3);
            append(colors, detail::byte_of(color), 1);
            append(scales, detail::byte_of(scale), 1);
            moved = moved || is_beyond(fixed, -8388608, 8388607), resized = resized || is_beyond(scale, 0, 255);
            recolored = recolored || is_beyond(color, 0, 255);
        }
        losses.coarse +=
            fractional_bits < spz_fractional_bits && size_of(cloud.log_scales[i]) < std::ldexp(1.0, -fractional_bits);
        losses.positions += moved, losses.scales += resized, losses.colors += recolored;
        append(opacities, detail::byte_of(255 * sigmoid(double(cloud.opacity_logits[i]))), 1);
        append(rotations, detail::spz_rotation(cloud.quats[i]), 4);
        for (std::size_t k = 1; k < basis; ++k)
            for (int channel = 0; channel < 3; ++channel) {
                const float value = cloud.sh[i * basis + k][channel];
                losses.coefficients += std::abs(value) > 1;
                append(bands, detail::spz_sh(value, k < 4 ? 1 : 2), 1);
            }
    }
    return streams;
}

/// The Gaussians of streams, whose sizes fit `count`, version and degree.
[[nodiscard]] inline GaussianCloud<float> gaussians_of_spz(const SpzStreams& streams, std::size_t count, int version,
                                                           int sh_degree, int fractional_bits) {
    GaussianCloud<float> cloud(count, sh_degree);
    const auto& [positions, opacities, colors, scales, rotations, bands] = streams.bytes;
    const auto byte = [](const std::string& bytes, std::size_t i) { return static_cast<std::uint8_t>(bytes[i]); };
    const auto basis = static_cast<std::size_t>(sh_basis_count(sh_degree));
    for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const int a = static_cast<int>(axis);
            const std::size_t at = 3 * i + axis;
            if (version == 1) {
                std::uint16_t half = 0;
                std::memcpy(&half, positions.data() + 2 * at, 2);
                cloud.means[i][a] = detail::half_to_float(half);
            } else {
                std::uint32_t fixed = 0;
                std::memcpy(&fixed, positions.data() + 3 * at, 3);
                const auto value = static_cast<std::int32_t>(fixed << 8) >> 8; // with the sign of bit 23
                cloud.means[i][a] = static_cast<float>(std::ldexp(value, -fractional_bits));
            }
            cloud.sh[i * basis][a] = static_cast<float>((byte(colors, at) - 127.5) / (0.15 * 255));
            cloud.log_scales[i][a] = static_cast<float>(byte(scales, at) / 16.0 - 10);
        }
        cloud.opacity_logits[i] = detail::logit_of_byte(byte(opacities, i));
        if (version >= 3) {
            std::uint32_t bits = 0;
            std::memcpy(&bits, rotations.data() + 4 * i, 4);
            cloud.quats[i] = detail::quat_of_spz(bits);
        } else {
            cloud.quats[i] = detail::quat_of_spz_bytes(reinterpret_cast<const std::uint8_t*>(rotations.data()) + 3 * i);
        }
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel)
                cloud.sh[i * basis + k][static_cast<int>(channel)] =
                    static_cast<float>((byte(bands, 3 * (i * (basis - 1) + k - 1) + channel) - 128) / 128.0);
    }
    return cloud;
}

} // namespace gsh
