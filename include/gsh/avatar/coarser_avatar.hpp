// SPDX-License-Identifier: Apache-2.0
/// @file  An avatar with fewer Gaussians, for small pictures: neighbours that look alike and move alike are merged.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/gaussian_groups.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/merged_gaussian.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace gsh {

/// How Gaussians of an avatar are merged.
struct CoarserParams {
    GroupParams groups = {};
    /// Metres by which a Gaussian is apart from one that moves with entirely different bones. A merged one would move
    /// between both.
    double skin_length = 0.05;
};

namespace detail {

/// Σ_j min(w_aj, w_bj) of the skinning weights of two points: 1 if they are equal, 0 if the points share no bone.
[[nodiscard]] inline double shared_weight(const SkinWeightTable<double>& skin, std::size_t a, std::size_t b) {
    const std::size_t K = skin.influences;
    double shared = 0;
    for (std::size_t i = a * K; i < (a + 1) * K && skin.weights[i] > 0; ++i)
        for (std::size_t j = b * K; j < (b + 1) * K && skin.weights[j] > 0; ++j)
            if (skin.joints[i] == skin.joints[j]) shared += std::min(skin.weights[i], skin.weights[j]);
    return shared;
}

/// Rows of numbers for each group: the mean of its members' rows, weighted by their masses.
template <class Element>
class GroupMeans {
public:
    explicit GroupMeans(const GaussianGroups& groups) : groups_(&groups), masses_(groups.size()) {
        for (std::size_t i = 0; i < groups.group.size(); ++i) masses_[groups.group[i]] += groups.masses[i];
    }

    /// A row has `width` elements. Groups of a single Gaussian keep its row bit for bit.
    [[nodiscard]] std::vector<Element> of(const std::vector<Element>& rows, std::size_t width) const {
        if (rows.empty()) return {};
        std::vector<Sum> sums(groups_->size() * width, Sum(0));
        for (std::size_t i = 0; i < groups_->group.size(); ++i) {
            const std::size_t g = groups_->group[i];
            const double share = groups_->masses[i] / masses_[g];
            for (std::size_t k = 0; k < width; ++k) sums[g * width + k] += Sum(rows[i * width + k]) * share;
        }
        std::vector<Element> means;
        means.reserve(sums.size());
        for (const Sum& sum : sums) means.push_back(Element(sum));
        return means;
    }

private:
    using Sum = std::conditional_t<std::is_arithmetic_v<Element>, double, vec3<double>>;

    const GaussianGroups* groups_;
    std::vector<double> masses_; // [G]
};

/// The skinning weights of each group: the mean of its members' weights, of which the largest stay.
[[nodiscard]] inline SkinWeightTable<double> merged_skin(const SkinWeightTable<double>& skin,
                                                         const GaussianGroups& groups, std::size_t joint_count) {
    const auto [starts, members] = groups.members();
    SkinWeightBuilder builder(skin.influences);
    std::vector<double> row(joint_count);
    for (std::size_t g = 0; g < groups.size(); ++g) {
        std::fill(row.begin(), row.end(), 0.0);
        for (std::size_t m = starts[g]; m < starts[g + 1]; ++m)
            for (std::size_t k = members[m] * skin.influences; k < (members[m] + 1) * skin.influences; ++k)
                row[skin.joints[k]] += groups.masses[members[m]] * skin.weights[k];
        builder.add(row);
        builder.finish_point();
    }
    return builder.table();
}

/// The merged Gaussians. A group of one keeps its Gaussian bit for bit.
[[nodiscard]] inline GaussianCloud<float> merged_cloud(const GaussianCloud<float>& cloud,
                                                       const GaussianGroups& groups) {
    GaussianCloud<float> result(groups.size(), cloud.sh_degree);
    std::vector<std::uint32_t> sizes(groups.size());
    for (const std::uint32_t g : groups.group) ++sizes[g];
    for (std::size_t g = 0; g < groups.size(); ++g) {
        const std::uint32_t lead = groups.leads[g];
        if (sizes[g] == 1) {
            result.means[g] = cloud.means[lead], result.quats[g] = cloud.quats[lead];
            result.log_scales[g] = cloud.log_scales[lead], result.opacity_logits[g] = cloud.opacity_logits[lead];
            continue;
        }
        const PlainGaussian merged = gaussian_of(groups.mixtures[g]);
        result.means[g] = vec3<float>(merged.mean);
        result.quats[g] = {static_cast<float>(merged.q.w), static_cast<float>(merged.q.x),
                           static_cast<float>(merged.q.y), static_cast<float>(merged.q.z)};
        result.log_scales[g] = vec3<float>(merged.log_scale);
        result.opacity_logits[g] = static_cast<float>(merged.opacity_logit);
    }
    result.sh = GroupMeans<vec3<float>>(groups).of(cloud.sh, static_cast<std::size_t>(sh_basis_count(cloud.sh_degree)));
    return result;
}

} // namespace detail

/// A cloud with `count` Gaussians at most, for scenes without a rig: neighbours that look alike are merged.
/// Errors  those of gaussian_groups.
template <HostExecutor E>
[[nodiscard]] GaussianCloud<float> coarser_cloud(E& executor, const GaussianCloud<float>& cloud, std::size_t count,
                                                 const GroupParams& params = {}) {
    return detail::merged_cloud(cloud, gaussian_groups(executor, cloud, count, params));
}

/// The avatar with `count` Gaussians, or the same one if it has no more. It has the body, the joints, the light, the
/// deformation and the pixel filter of `avatar`, and its motions.
///
/// Gaussians merge in the canonical pose (gaussian_groups). A merged one has the moments and the coverage of the
/// mixture (GaussianMixture). The mean of its members, weighted by their masses, gives its
///
/// - SH coefficients, ambient occlusion and mean irradiance;
/// - numbers of the occlusion field: sums of the first layer, in which the mean is that of the encoding;
/// - skinning weights. Of these, the largest stay, as many as the avatar has for a Gaussian, and sum to 1 again.
///
/// It is attached to the triangle of its lead, whose shape, expression and normal it follows. A level can be made of
/// any finer one. Colours are averaged before they are clamped, and apart from ambient occlusion and light. What is
/// shown is therefore the mean of the members only as far as these are alike.
///
/// Errors  ShapeError if rig, Gaussians and their attributes differ in number; those of gaussian_groups.
template <HostExecutor E>
[[nodiscard]] AvatarData coarser_avatar(E& executor, const AvatarData& avatar, std::size_t count,
                                        const CoarserParams& params = {}) {
    constexpr auto where = "coarser_avatar";
    const std::size_t N = avatar.gaussians.size();
    check_size(where, "rig", avatar.rig.point_count(), N, "one point per Gaussian");
    check_skin(where, avatar.rig.skin.view(), N);
    if (!avatar.ao.empty()) check_size(where, "ao", avatar.ao.size(), N, "one per Gaussian, or none");
    if (!avatar.mean_irradiance.empty())
        check_size(where, "mean_irradiance", avatar.mean_irradiance.size(), N, "one per Gaussian, or none");
    if (avatar.occlusion_field) check_occlusion_field(where, *avatar.occlusion_field, N, avatar.rig.joint_count());
    check_value(params.skin_length >= 0, where, "skin_length must not be negative");
    check_value(count > 0, where, "count is 0, expected at least 1");
    if (count >= N) return avatar;

    const double apart = params.skin_length / params.groups.length;
    const GaussianGroups groups =
        gaussian_groups(executor, avatar.gaussians, count, params.groups, [&](std::uint32_t a, std::uint32_t b) {
            const double differs = (1 - detail::shared_weight(avatar.rig.skin, a, b)) * apart;
            return differs * differs;
        });
    const detail::GroupMeans<float> means(groups);
    AvatarData coarser = avatar;
    coarser.gaussians = detail::merged_cloud(avatar.gaussians, groups);
    coarser.rig.triangles.clear(), coarser.rig.barycentric.clear();
    for (const std::uint32_t lead : groups.leads) {
        coarser.rig.triangles.push_back(avatar.rig.triangles[lead]);
        coarser.rig.barycentric.push_back(avatar.rig.barycentric[lead]);
    }
    coarser.rig.skin = detail::merged_skin(avatar.rig.skin, groups, avatar.rig.joint_count());
    coarser.ao = means.of(avatar.ao, 1);
    coarser.mean_irradiance = means.of(avatar.mean_irradiance, 1);
    if (avatar.occlusion_field)
        coarser.occlusion_field->neurons =
            means.of(avatar.occlusion_field->neurons, static_cast<std::size_t>(avatar.occlusion_field->width));
    return coarser;
}

} // namespace gsh
