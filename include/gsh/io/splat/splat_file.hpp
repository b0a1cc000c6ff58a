// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes .splat files: 32 bytes a Gaussian, without header and without view-dependent colours.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/spz_points.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>

namespace gsh {

namespace detail {
/// One Gaussian of a .splat file.
struct SplatRow {
    float mean[3], scale[3];
    std::uint8_t color[4], rotation[4]; // red green blue opacity; 128 + 128 (w x y z)
};
static_assert(sizeof(SplatRow) == 32);
} // namespace detail

/// Reads a .splat file. It cannot state its vertical; the Gaussians are as stored.
///
/// Errors  IoError for a file that is missing, empty or not of whole rows; ValueError for a position or scale that is
///         not finite, and for a quaternion of length 0.
[[nodiscard]] inline StillSplats read_splat(const InputFile& input) {
    const std::string name = input.name(), bytes = read_file(input, std::size_t(4) << 30);
    if (bytes.empty() || bytes.size() % sizeof(detail::SplatRow) != 0)
        throw IoError(name + ": has " + std::to_string(bytes.size()) +
                      " bytes, expected 32 for each Gaussian of a .splat file");
    StillSplats splats{GaussianCloud<float>(bytes.size() / sizeof(detail::SplatRow), 0)};
    GaussianCloud<float>& cloud = splats.cloud;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        detail::SplatRow row;
        std::memcpy(&row, bytes.data() + i * sizeof row, sizeof row);
        const auto at = [&] { return " of Gaussian " + std::to_string(i); };
        vec3<float> color;
        for (int axis = 0; axis < 3; ++axis) {
            check_value(std::isfinite(row.mean[axis]), name, "the position" + at() + " is not finite");
            check_value(std::isfinite(row.scale[axis]) && row.scale[axis] >= 0, name,
                        "the scale" + at() + " is " + detail::number_text(double(row.scale[axis])) +
                            ", expected 0 or more");
            cloud.means[i][axis] = row.mean[axis];
            cloud.log_scales[i][axis] = std::max(std::log(row.scale[axis]), flat_log_scale);
            color[axis] = static_cast<float>(row.color[axis]) / 255;
        }
        const auto part = [&](int k) { return static_cast<float>(row.rotation[k] - 128) / 128; };
        cloud.quats[i] = {part(0), part(1), part(2), part(3)};
        check_value(dot(cloud.quats[i], cloud.quats[i]) > 0, name, "the quaternion" + at() + " is 0");
        cloud.opacity_logits[i] = detail::logit_of_byte(row.color[3]);
        cloud.sh[i] = sh_of_color(color);
    }
    check_writable(name, cloud);
    return splats;
}

/// Writes a .splat file, atomically, in the order of the cloud. Viewers show Gaussians as they load, so the important
/// ones should come first (importance_order). Bands that depend on the view are dropped. Returns how many constant
/// colours are beyond 0 to 1, where they end.
/// Errors  ValueError for an empty cloud.
inline SplatLosses write_splat(const std::filesystem::path& path, GaussianCloud<float> given,
                               std::optional<UpAxis> up = {}) {
    check_writable("write_splat", given);
    check_value(given.size() > 0, "write_splat", "there must be a Gaussian");
    const GaussianCloud<float> cloud = as_stored(std::move(given), up);
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    AtomicFile file(path);
    SplatLosses losses{.gaussians = cloud.size()};
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        detail::SplatRow row;
        const vec3<float> color = detail::unclamped_color<0>(&cloud.sh[i * basis], vec3<float>(0, 0, 1));
        for (int axis = 0; axis < 3; ++axis) {
            row.mean[axis] = cloud.means[i][axis];
            row.scale[axis] = std::exp(cloud.log_scales[i][axis]);
            row.color[axis] = detail::byte_of(255 * double(color[axis]));
        }
        losses.colors +=
            std::max({color.x, color.y, color.z}) > 255.5f / 255 || std::min({color.x, color.y, color.z}) < -0.5f / 255;
        row.color[3] = detail::byte_of(255 * sigmoid(double(cloud.opacity_logits[i])));
        const quat<float> q = normalize(cloud.quats[i]);
        const double parts[4] = {q.w, q.x, q.y, q.z};
        for (int k = 0; k < 4; ++k) row.rotation[k] = detail::byte_of(128 + 128 * parts[k]);
        file.write(&row, sizeof row);
    }
    file.commit();
    return losses;
}

} // namespace gsh
