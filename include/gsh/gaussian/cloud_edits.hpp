// SPDX-License-Identifier: Apache-2.0
/// @file  Edits of a cloud of Gaussians: another order, a part of it, fewer SH bands, the frame with y down.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/ordered_indices.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace gsh {

/// The Gaussians of the given indices, in this order.
/// Errors  ValueError for an index that the cloud does not have.
template <class T>
[[nodiscard]] GaussianCloud<T> reordered(const GaussianCloud<T>& cloud, Span<const std::uint32_t> order) {
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    GaussianCloud<T> result(order.size(), cloud.sh_degree);
    for (std::size_t i = 0; i < order.size(); ++i) {
        const std::size_t from = order[i];
        check_value(from < cloud.size(), "reordered", "an index is beyond the cloud");
        result.means[i] = cloud.means[from];
        result.quats[i] = cloud.quats[from];
        result.log_scales[i] = cloud.log_scales[from];
        result.opacity_logits[i] = cloud.opacity_logits[from];
        std::copy_n(cloud.sh.data() + from * basis, basis, result.sh.data() + i * basis);
    }
    return result;
}

/// The size of a Gaussian times its opacity, to compare Gaussians of a cloud: e^(sum of its log-scales) sigmoid(logit).
template <class T>
[[nodiscard]] T importance(const GaussianCloud<T>& cloud, std::size_t i) {
    const vec3<T>& s = cloud.log_scales[i];
    return std::exp(s.x + s.y + s.z) * sigmoid(cloud.opacity_logits[i]);
}

/// Indices by importance, largest first. Equal ones keep their order.
template <class T>
[[nodiscard]] std::vector<std::uint32_t> importance_order(const GaussianCloud<T>& cloud) {
    std::vector<T> values(cloud.size());
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = importance(cloud, i);
    return ordered_indices(values.size(), [&](std::uint32_t a, std::uint32_t b) { return values[a] > values[b]; });
}

/// Indices in Morton order of the means, with 10 bits for each axis of their box: neighbours in the order are
/// neighbours in space.
///
/// Source  Morton, "A Computer Oriented Geodetic Data Base and a New Technique in File Sequencing", 1966.
template <class T>
[[nodiscard]] std::vector<std::uint32_t> morton_order(const GaussianCloud<T>& cloud) {
    vec3<T> low(std::numeric_limits<T>::infinity()), high(-low);
    for (const vec3<T>& mean : cloud.means) low = glm::min(low, mean), high = glm::max(high, mean);
    const auto spread = [](std::uint32_t bits) { // two zeros after each of ten bits
        bits = (bits | bits << 16) & 0x030000FFu;
        bits = (bits | bits << 8) & 0x0300F00Fu;
        bits = (bits | bits << 4) & 0x030C30C3u;
        return (bits | bits << 2) & 0x09249249u;
    };
    std::vector<std::uint32_t> codes(cloud.size());
    for (std::size_t i = 0; i < codes.size(); ++i)
        for (int axis = 0; axis < 3; ++axis) {
            const T extent = high[axis] - low[axis];
            const T place = extent > 0 ? (cloud.means[i][axis] - low[axis]) / extent : T(0);
            codes[i] |= spread(static_cast<std::uint32_t>(std::clamp(place * 1024, T(0), T(1023)))) << axis;
        }
    return ordered_indices(codes.size(), [&](std::uint32_t a, std::uint32_t b) { return codes[a] < codes[b]; });
}

/// The indices of the `count` most important Gaussians, in the order of the cloud.
template <class T>
[[nodiscard]] std::vector<std::uint32_t> largest_gaussians(const GaussianCloud<T>& cloud, std::size_t count) {
    std::vector<std::uint32_t> kept = importance_order(cloud);
    kept.resize(std::min(count, kept.size()));
    std::sort(kept.begin(), kept.end());
    return kept;
}

/// The cloud without the SH bands above `degree`.
template <class T>
[[nodiscard]] GaussianCloud<T> with_bands_up_to(GaussianCloud<T> cloud, int degree) {
    check_value(degree >= 0, "with_bands_up_to", "degree must not be negative");
    if (degree >= cloud.sh_degree) return cloud;
    const auto from = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree)),
               kept = static_cast<std::size_t>(sh_basis_count(degree));
    for (std::size_t i = 0; i < cloud.size(); ++i)
        std::copy_n(cloud.sh.data() + i * from, kept, cloud.sh.data() + i * kept);
    cloud.sh.resize(cloud.size() * kept);
    cloud.sh_degree = degree;
    return cloud;
}

/// Turns a cloud by half a turn about z, exactly: from y up to y down, and back. It leads from the frame of gsh to that
/// in which files of 3D Gaussian splatting are usually stored.
template <class T>
void turn_about_z(GaussianCloud<T>& cloud) {
    for (vec3<T>& mean : cloud.means) mean.x = -mean.x, mean.y = -mean.y;
    for (quat<T>& q : cloud.quats) q = {-q.z, -q.y, q.x, q.w};
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    for (std::size_t i = 0; i < cloud.sh.size(); ++i) {
        std::size_t k = i % basis, l = 0;
        while ((l + 1) * (l + 1) <= k) ++l;
        if ((k - l * l + l) % 2) cloud.sh[i] = -cloud.sh[i]; // odd m = k - l² - l
    }
}

} // namespace gsh
