// SPDX-License-Identifier: Apache-2.0
/// @file  The Gaussians after a change of density control: which there are, and how they follow from their parents.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

namespace gsh {

/// Numbers of Gaussians in one change.
struct DensityChange {
    std::size_t cloned = 0, split = 0, pruned = 0;
    bool opacity_reset = false;

    [[nodiscard]] bool changed() const { return cloned + split + pruned > 0; }
};

/// What happens to a Gaussian.
enum class Fate : std::uint8_t { keep, clone, split, prune };

namespace detail {

/// How a new Gaussian relates to its parent: the parent itself, its copy, or a part of it.
enum class Kin : std::uint8_t { self, copy, part };

/// The Gaussians after a change: the parent of each, in the order of the parents.
struct Descent {
    std::vector<std::uint32_t> parents;
    std::vector<Kin> kin;
    DensityChange change;

    void add(std::size_t parent, Kin relation) {
        parents.push_back(static_cast<std::uint32_t>(parent));
        kin.push_back(relation);
    }
};

/// Lists the Gaussians after a change. If `most` leaves too little room, those with the largest gradients are cloned or
/// split first (ties: the lower index), and the others stay.
template <class T>
[[nodiscard]] Descent plan_descent(std::vector<Fate> fates, const std::vector<T>& gradients, std::size_t split_count,
                                   std::size_t most) {
    std::vector<std::size_t> wishes;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < fates.size(); ++i) {
        kept += fates[i] != Fate::prune;
        if (fates[i] == Fate::clone || fates[i] == Fate::split) wishes.push_back(i);
    }
    const auto growth = [&](std::size_t i) { return fates[i] == Fate::clone ? 1 : split_count - 1; };
    std::size_t wished = 0, room = most - std::min(most, kept);
    for (const std::size_t i : wishes) wished += growth(i);
    if (wished > room) {
        std::sort(wishes.begin(), wishes.end(), [&](std::size_t a, std::size_t b) {
            return gradients[a] != gradients[b] ? gradients[a] > gradients[b] : a < b;
        });
        for (const std::size_t i : wishes)
            if (growth(i) <= room) room -= growth(i);
            else fates[i] = Fate::keep;
    }

    Descent descent;
    for (std::size_t i = 0; i < fates.size(); ++i) {
        if (fates[i] == Fate::prune) {
            ++descent.change.pruned;
        } else if (fates[i] == Fate::split) {
            ++descent.change.split;
            for (std::size_t k = 0; k < split_count; ++k) descent.add(i, Kin::part);
        } else {
            descent.add(i, Kin::self);
            if (fates[i] == Fate::clone) ++descent.change.cloned, descent.add(i, Kin::copy);
        }
    }
    return descent;
}

/// The same in a backend's memory: the parent of each Gaussian after a change, and how it relates to it.
template <Backend B>
struct DescentBuffers {
    typename B::template Buffer<std::uint32_t> parents;
    typename B::template Buffer<Kin> kin;
};

/// Plans a change on the host, from fates and gradients in a backend's memory.
template <Backend B, class T>
DensityChange plan_descent_on_host(B& backend, Span<const Fate> fates, Span<const T> gradients,
                                   std::size_t split_count, std::size_t most, DescentBuffers<B>& to) {
    std::vector<Fate> host_fates = downloaded(backend, fates);
    const std::vector<T> host_gradients = downloaded(backend, gradients);
    const Descent descent = plan_descent(std::move(host_fates), host_gradients, split_count, most);
    assign(backend, descent.parents, to.parents);
    assign(backend, descent.kin, to.kin);
    return descent.change;
}
/// A backend may have an overload of its own.
template <Backend B, class T>
DensityChange plan_descent(B& backend, Span<const Fate> fates, Span<const T> gradients, std::size_t split_count,
                           std::size_t most, DescentBuffers<B>& to) {
    return plan_descent_on_host(backend, fates, gradients, split_count, most, to);
}

/// Standard normal (Box and Muller, 1958) from two draws of the stream.
[[nodiscard]] GSH_HD inline double random_normal(std::uint64_t seed, std::uint64_t index) {
    const double radius = sqrt(-2 * log(1 - random_uniform(seed, 2 * index)));
    return radius * cos(2 * std::numbers::pi * random_uniform(seed, 2 * index + 1));
}

/// New Gaussian r from its parent. The mean of a part is a random sample of its parent's density; a part is smaller.
template <class T>
struct DescendGaussian {
    GaussiansView<const T> from;
    Span<const std::uint32_t> parents;
    Span<const Kin> kin;
    std::uint64_t seed;
    T log_split_factor;
    GaussiansView<T> to;

    GSH_HD void operator()(std::size_t r) const {
        const std::size_t p = parents[r];
        vec3<T> mean = from.means[p], log_scale = from.log_scales[p];
        if (kin[r] == Kin::part) {
            vec3<T> offset;
            for (int k = 0; k < 3; ++k)
                offset[k] =
                    exp(log_scale[k]) * static_cast<T>(random_normal(seed, 3 * r + static_cast<std::size_t>(k)));
            mean += rotation_from_quat(from.quats[p]) * offset;
            log_scale -= vec3<T>(log_split_factor);
        }
        to.means[r] = mean;
        to.log_scales[r] = log_scale;
        to.quats[r] = from.quats[p];
        to.opacity_logits[r] = from.opacity_logits[p];
        const std::size_t basis = static_cast<std::size_t>(sh_basis_count(from.sh_degree));
        for (std::size_t k = 0; k < basis; ++k) to.sh[r * basis + k] = from.sh[p * basis + k];
    }
};

/// Adam's moments of new Gaussian r. The parent itself keeps its moments; copies and parts start with zero.
template <class T>
struct DescendMoments {
    GaussiansView<const T> from;
    Span<const std::uint32_t> parents;
    Span<const Kin> kin;
    GaussiansView<T> to;

    GSH_HD void operator()(std::size_t r) const {
        const std::size_t p = parents[r], basis = static_cast<std::size_t>(sh_basis_count(from.sh_degree));
        const bool self = kin[r] == Kin::self;
        to.means[r] = self ? from.means[p] : vec3<T>(T(0));
        to.log_scales[r] = self ? from.log_scales[p] : vec3<T>(T(0));
        to.quats[r] = self ? from.quats[p] : quat<T>{T(0), T(0), T(0), T(0)};
        to.opacity_logits[r] = self ? from.opacity_logits[p] : T(0);
        for (std::size_t k = 0; k < basis; ++k) to.sh[r * basis + k] = self ? from.sh[p * basis + k] : vec3<T>(T(0));
    }
};

} // namespace detail
} // namespace gsh
