// SPDX-License-Identifier: Apache-2.0
/// @file  Edits of a cloud of Gaussians: another order, a part of it, fewer SH bands.
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
#include <utility>
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

namespace detail {

/// Sorts indices of a cloud by the Morton codes of their means, with 10 bits for each axis of their box.
template <class T>
void sort_by_place(const GaussianCloud<T>& cloud, std::vector<std::uint32_t>& indices) {
    vec3<T> low(std::numeric_limits<T>::infinity()), high(-low);
    for (const std::uint32_t i : indices) low = glm::min(low, cloud.means[i]), high = glm::max(high, cloud.means[i]);
    const auto spread = [](std::uint32_t bits) { // two zeros after each of ten bits
        bits = (bits | bits << 16) & 0x030000FFu;
        bits = (bits | bits << 8) & 0x0300F00Fu;
        bits = (bits | bits << 4) & 0x030C30C3u;
        return (bits | bits << 2) & 0x09249249u;
    };
    std::vector<std::uint32_t> codes(cloud.size());
    for (const std::uint32_t i : indices)
        for (int axis = 0; axis < 3; ++axis) {
            const T extent = high[axis] - low[axis];
            const T place = extent > 0 ? (cloud.means[i][axis] - low[axis]) / extent : T(0);
            codes[i] |= spread(static_cast<std::uint32_t>(std::clamp(place * 1024, T(0), T(1023)))) << axis;
        }
    std::stable_sort(indices.begin(), indices.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return codes[a] < codes[b]; });
}

/// The element in the middle of the sorted values.
template <class T>
[[nodiscard]] T middle_of(std::vector<T> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

} // namespace detail

/// Indices in Morton order of the means: neighbours in the order are neighbours in space. Gaussians that are more than
/// 32 times as far from the middle as most come after the others, in an order of their own, so that a few outliers do
/// not make the cells of the order coarse.
///
/// Source  Morton, "A Computer Oriented Geodetic Data Base and a New Technique in File Sequencing", 1966.
template <class T>
[[nodiscard]] std::vector<std::uint32_t> morton_order(const GaussianCloud<T>& cloud) {
    std::vector<std::uint32_t> order, left(cloud.size());
    for (std::size_t i = 0; i < left.size(); ++i) left[i] = static_cast<std::uint32_t>(i);
    while (!left.empty()) {
        vec3<T> centre;
        std::vector<T> values(left.size());
        for (int axis = 0; axis < 3; ++axis) {
            for (std::size_t k = 0; k < left.size(); ++k) values[k] = cloud.means[left[k]][axis];
            centre[axis] = detail::middle_of(values);
        }
        for (std::size_t k = 0; k < left.size(); ++k) {
            const vec3<T> away = glm::abs(cloud.means[left[k]] - centre);
            values[k] = std::max({away.x, away.y, away.z});
        }
        const T near = 32 * detail::middle_of(values);
        std::vector<std::uint32_t> here, far;
        for (std::size_t k = 0; k < left.size(); ++k) (values[k] <= near ? here : far).push_back(left[k]);
        detail::sort_by_place(cloud, here);
        order.insert(order.end(), here.begin(), here.end());
        left = std::move(far);
    }
    return order;
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

} // namespace gsh
