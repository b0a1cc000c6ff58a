// SPDX-License-Identifier: Apache-2.0
/// @file  Groups of neighbouring Gaussians that look alike, each of which one Gaussian can replace.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/merged_gaussian.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// What counts as alike.
struct GroupParams {
    std::size_t neighbours = 8; ///< of each Gaussian, with which it may be merged
    double share = 0.2;         ///< of all Gaussians that disappear in a round; smaller shares are better and slower
    double length = 0.05;       ///< metres between means that are as bad as a difference of 1 in a colour
    double thickness = 0.005;   ///< the same along the normals; merged across, an outline would grow
};

/// A division of N Gaussians into G groups. Groups are in the order of their first members.
struct GaussianGroups {
    std::vector<std::uint32_t> group;      // [N] below G
    std::vector<std::uint32_t> leads;      // [G] a member: that of the heavier part, whenever two parts were merged
    std::vector<GaussianMixture> mixtures; // [G]
    std::vector<double> masses;            // [N] of single Gaussians (GaussianMixture)

    [[nodiscard]] std::size_t size() const { return leads.size(); }
    /// The members of each group, ascending: those of group g are members[starts[g]] up to members[starts[g + 1]].
    [[nodiscard]] std::pair<std::vector<std::size_t>, std::vector<std::uint32_t>> members() const {
        std::vector<std::size_t> starts(size() + 1);
        for (const std::uint32_t g : group) ++starts[g + 1];
        for (std::size_t g = 0; g < size(); ++g) starts[g + 1] += starts[g];
        std::vector<std::uint32_t> members(group.size());
        auto next = starts;
        for (std::size_t i = 0; i < group.size(); ++i) members[next[group[i]]++] = static_cast<std::uint32_t>(i);
        return {std::move(starts), std::move(members)};
    }
};

namespace detail {

/// Groups while they merge. A round finds the cheapest pairs of neighbours, each group in one pair at most, and merges
/// them. The neighbours of a merged group are those of both.
template <HostExecutor E, class Apart>
class GroupMerger {
public:
    GroupMerger(E& executor, const GaussianCloud<float>& cloud, const GroupParams& params, const Apart& apart)
        : executor_(&executor), params_(params), apart_(&apart) {
        const std::size_t N = cloud.size();
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        looks_.resize(N), groups_.group.resize(N), groups_.leads.resize(N), groups_.masses.resize(N);
        groups_.mixtures.resize(N);
        for (std::size_t i = 0; i < N; ++i) {
            const PlainGaussian gaussian = plain_gaussian(cloud, i);
            groups_.mixtures[i] = mixture_of(gaussian);
            groups_.masses[i] = groups_.mixtures[i].mass;
            groups_.group[i] = groups_.leads[i] = static_cast<std::uint32_t>(i);
            const CovarianceFactor<double> factor(gaussian.q, gaussian.log_scale);
            looks_[i] = {factor.R[shortest_of(factor.scale)],
                         vec3<double>(unclamped_color<0>(cloud.sh.data() + i * basis, vec3<float>(0, 0, 1)))};
            const Look& look = looks_[i];
            const double sum = dot(gaussian.mean, gaussian.mean) + groups_.masses[i] + dot(look.normal, look.normal) +
                               dot(look.color, look.color);
            check_value(std::isfinite(sum), "gaussian_groups",
                        "Gaussian " + std::to_string(i) + " has a number that is not finite, or no direction");
        }
    }

    [[nodiscard]] GaussianGroups merge(std::size_t count) {
        while (groups_.size() > count) {
            if (pairs_.empty()) find_neighbours();
            sort_pairs();
            const std::size_t n = groups_.size();
            const auto round = static_cast<std::size_t>(params_.share * static_cast<double>(n));
            merge_pairs(std::min(n - count, std::max<std::size_t>(round, 1)));
        }
        return std::move(groups_);
    }

private:
    static constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

    /// What a group looks like: its lead's normal, and the mean of its colours.
    struct Look {
        vec3<double> normal, color;
    };
    struct Pair {
        double cost;
        std::uint32_t a, b; // a < b

        [[nodiscard]] bool operator<(const Pair& other) const {
            return std::tie(cost, a, b) < std::tie(other.cost, other.a, other.b);
        }
        [[nodiscard]] bool operator==(const Pair& other) const { return a == other.a && b == other.b; }
    };

    [[nodiscard]] static PlainGaussian plain_gaussian(const GaussianCloud<float>& cloud, std::size_t i) {
        const quat<float>& q = cloud.quats[i];
        return {vec3<double>(cloud.means[i]),
                {q.w, q.x, q.y, q.z},
                vec3<double>(cloud.log_scales[i]),
                cloud.opacity_logits[i]};
    }

    void find_neighbours() {
        const std::size_t n = groups_.size(), K = std::min(params_.neighbours, n - 1);
        std::vector<vec3<double>> means(n);
        for (std::size_t i = 0; i < n; ++i) means[i] = groups_.mixtures[i].mean;
        const NearestPoints places{Span<const vec3<double>>(means)};
        pairs_.resize(n * K);
        executor_->for_chunks(n, 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i) {
                std::size_t k = 0;
                for (const auto& [squared, j] : places.nearest(means[i], K + 1))
                    if (j != i && k < K)
                        pairs_[i * K + k++] = {0, static_cast<std::uint32_t>(std::min(i, j)),
                                               static_cast<std::uint32_t>(std::max(i, j))};
            }
        });
    }

    /// Sorts the pairs by their cost, each pair once.
    void sort_pairs() {
        executor_->for_chunks(pairs_.size(), 4096, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t k = begin; k < end; ++k) pairs_[k].cost = cost(pairs_[k].a, pairs_[k].b);
        });
        std::sort(pairs_.begin(), pairs_.end());
        pairs_.erase(std::unique(pairs_.begin(), pairs_.end()), pairs_.end());
    }

    [[nodiscard]] double cost(std::uint32_t a, std::uint32_t b) const {
        const GaussianMixture &p = groups_.mixtures[a], &q = groups_.mixtures[b];
        const vec3<double> color = looks_[a].color - looks_[b].color, way = (p.mean - q.mean) / params_.length;
        const double above_a = dot(p.mean - q.mean, looks_[a].normal) / params_.thickness,
                     above_b = dot(p.mean - q.mean, looks_[b].normal) / params_.thickness;
        return p.mass * q.mass / (p.mass + q.mass) *
               (dot(color, color) + dot(way, way) + 0.5 * (above_a * above_a + above_b * above_b) +
                (*apart_)(groups_.leads[a], groups_.leads[b]));
    }

    /// Merges the first `most` pairs whose groups are in no earlier pair.
    void merge_pairs(std::size_t most) {
        const std::size_t n = groups_.size();
        std::vector<std::uint32_t> partner(n, none), number(n);
        for (const Pair& pair : pairs_) {
            if (most == 0) break;
            if (partner[pair.a] != none || partner[pair.b] != none) continue;
            partner[pair.a] = pair.b, partner[pair.b] = pair.a, --most;
        }
        std::uint32_t next = 0; // at most i, so that entries can be overwritten in place
        for (std::uint32_t i = 0; i < n; ++i) {
            const std::uint32_t j = partner[i];
            if (j < i) {
                number[i] = number[j];
                continue;
            }
            number[i] = next;
            const auto [mixture, look, lead] =
                j == none ? std::tuple(groups_.mixtures[i], looks_[i], groups_.leads[i]) : both(i, j);
            groups_.mixtures[next] = mixture, looks_[next] = look, groups_.leads[next] = lead;
            ++next;
        }
        groups_.mixtures.resize(next), looks_.resize(next), groups_.leads.resize(next);
        for (std::uint32_t& g : groups_.group) g = number[g];
        for (Pair& pair : pairs_) {
            const std::uint32_t a = number[pair.a], b = number[pair.b];
            pair.a = std::min(a, b), pair.b = std::max(a, b);
        }
        std::erase_if(pairs_, [](const Pair& pair) { return pair.a == pair.b; });
    }

    [[nodiscard]] std::tuple<GaussianMixture, Look, std::uint32_t> both(std::uint32_t i, std::uint32_t j) const {
        const GaussianMixture &p = groups_.mixtures[i], &q = groups_.mixtures[j];
        const std::uint32_t heavier = p.mass >= q.mass ? i : j;
        return {
            merged(p, q),
            {looks_[heavier].normal, (looks_[i].color * p.mass + looks_[j].color * q.mass) * (1 / (p.mass + q.mass))},
            groups_.leads[heavier]};
    }

    E* executor_;
    GroupParams params_;
    const Apart* apart_;
    GaussianGroups groups_;
    std::vector<Look> looks_; // [G]
    std::vector<Pair> pairs_;
};

} // namespace detail

/// Divides Gaussians into `count` groups, or into one each if there are no more. Two groups a and b of masses m merge
/// at the cost
///
///     m_a m_b / (m_a + m_b) (|Δcolour|² + |Δμ|² / length² + ((n_a·Δμ)² + (n_b·Δμ)²) / 2 thickness² + apart(a, b)),
///
/// Ward's increase of the squared error, summed over the area that the groups cover. n is the shortest axis of a
/// group's lead, and apart(i, j) a term of the caller for the leads i and j, at least 0. Cheap pairs merge first, in
/// rounds. The result is the same on any number of threads.
///
/// Errors  ShapeError for a cloud with arrays of different sizes; ValueError for a count of 0, for parameters that are
///         not positive, and for a Gaussian with a number that is not finite.
/// Source  Ward, "Hierarchical Grouping to Optimize an Objective Function", 1963.
template <HostExecutor E, class Apart>
[[nodiscard]] GaussianGroups gaussian_groups(E& executor, const GaussianCloud<float>& cloud, std::size_t count,
                                             const GroupParams& params, const Apart& apart) {
    constexpr auto where = "gaussian_groups";
    check_gaussians(where, "cloud", cloud.view(), cloud.size());
    check_value(count > 0, where, "count is 0, expected at least 1");
    check_value(params.neighbours > 0 && params.share > 0 && params.length > 0 && params.thickness > 0, where,
                "neighbours, share, length and thickness must be positive");
    return detail::GroupMerger<E, Apart>(executor, cloud, params, apart).merge(count);
}
template <HostExecutor E>
[[nodiscard]] GaussianGroups gaussian_groups(E& executor, const GaussianCloud<float>& cloud, std::size_t count,
                                             const GroupParams& params = {}) {
    return gaussian_groups(executor, cloud, count, params, [](std::uint32_t, std::uint32_t) { return 0.0; });
}

} // namespace gsh
