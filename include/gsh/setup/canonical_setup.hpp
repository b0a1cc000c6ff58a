// SPDX-License-Identifier: Apache-2.0
/// @file  Makes rig, samples and priors of an avatar from a body, its motion and a configuration.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_merge.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/body/vertex_samples.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/prior/prior_view.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/setup/posed_priors.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// The canonical body of a configuration: samples of its surface, their rig, and the priors of their fields.
struct CanonicalSetup {
    Motion motion; ///< in the rig's joints
    SurfaceSamples samples;
    RigData rig;
    CanonicalPriors priors;
};

/// Samples `count` points on the body in the motion's shape, and makes their rig and priors. Estimated views, if there
/// are any, replace those of the mesh; their frames are frames of `motion`. A body without triangles gets a sample per
/// vertex, and neither region nor features.
///
/// Errors  ValueError: region lists that name no vertex, nothing to sample, views that do not fit the body.
template <HostExecutor E>
[[nodiscard]] CanonicalSetup make_canonical_setup(E& executor, const BodyModel& body, const Motion& motion,
                                                  const Configuration& config, std::size_t count, std::uint64_t seed,
                                                  const RegionLists& regions = {},
                                                  const EstimatedPriors& estimated = {}) {
    std::optional<BodyModel> merged;
    CanonicalSetup setup{.motion = motion, .samples = {}, .rig = {}, .priors = {}};
    if (config.joints == JointSet::trunk_and_limbs) {
        const std::vector<int> kept = trunk_and_limbs(body);
        merged = merge_joints(body, kept);
        setup.motion = merge_joints(motion, kept);
    }
    const BodyModel& mover = merged ? *merged : body;
    const std::vector<vec3<double>> vertices = shaped_vertices(body, motion.betas);

    if (body.faces.empty()) {
        setup.samples = sample_vertices(mover, vertices);
        setup.rig = make_rig(mover, motion.betas, setup.samples);
        return setup;
    }

    std::optional<RegionMask> mask; // of the whole body; a merged one has fewer parts
    if (config.has_regions()) mask = region_mask(body, vertices, regions, config.region);
    const std::vector<double> per_vertex = config.region_samples ? mask->samples_per_vertex()
                                                                 : std::vector<double>(vertices.size(), 1.0);
    SurfaceSampleParams samples = config.samples;
    samples.total = count;
    setup.samples = sample_surface(mover, vertices, per_vertex, mix_bits(seed), samples);
    setup.rig = make_rig(mover, motion.betas, setup.samples);

    const std::size_t N = setup.samples.size();
    if (config.fine_levels == FineLevels::none) setup.priors.region.assign(N, 0.0);
    if (config.fine_levels == FineLevels::region) {
        constexpr double least = 1e-3; // below this τ becomes 0; above, it is rescaled so that there is no step
        setup.priors.region = mask->at(setup.samples);
        for (double& tau : setup.priors.region) tau = std::clamp((tau - least) / (1 - least), 0.0, 1.0);
    }
    std::vector<std::pair<std::size_t, std::vector<double>>> columns;
    const auto& skin = setup.samples.weights.view();
    auto posed = posed_priors(executor, {body, motion, mover, setup.motion}, estimated,
                              {config.depth_prior, config.normal_prior, config.prior.depth});
    if (config.depth_prior) {
        std::vector<PriorView>& views = posed.depths;
        if (views.empty()) views = four_depth_views(executor, vertices, body.faces);
        columns.emplace_back(views.size(), depth_features(setup.samples.positions, views, skin, config.prior));
    }
    if (config.normal_prior) {
        std::vector<PriorView>& views = posed.normals;
        if (views.empty()) views = two_normal_views(executor, vertices, body.faces);
        columns.emplace_back(3 * views.size(), normal_features(setup.samples.positions, views, skin));
    }
    for (std::size_t i = 0; i < N; ++i)
        for (const auto& [width, values] : columns)
            setup.priors.features.insert(setup.priors.features.end(),
                                         values.begin() + static_cast<std::ptrdiff_t>(i * width),
                                         values.begin() + static_cast<std::ptrdiff_t>((i + 1) * width));
    return setup;
}

} // namespace gsh
