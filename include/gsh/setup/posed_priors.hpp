// SPDX-License-Identifier: Apache-2.0
/// @file  An estimator's views with the bones of the frames that they show, checked against the posed body.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/prior/estimated_view.hpp>
#include <gsh/prior/normal_integration.hpp>
#include <gsh/prior/prior_features.hpp>
#include <gsh/prior/prior_view.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The person in an estimator's maps. `body` is the captured body, whose mesh the maps show. `mover` is the body that
/// moves the Gaussians; the samples' weights belong to its joints. Both are the same unless joints were merged.
struct SeenPerson {
    const BodyModel& body;
    const Motion& motion;
    const BodyModel& mover;
    const Motion& mover_motion;
};

/// Which features are made of an estimator's views. Maps of other kinds are not checked.
struct PosedPriorsParams {
    bool depths = true, normals = true;
    DepthFeature feature = DepthFeature::difference;
};

/// Views with the bones of their frames. `depths`, for φ_d, are the estimator's depths, then depths integrated from the
/// normal maps with EstimatedView::integrate, with the depth of the posed mesh as prior. `normals`, for φ_n, are its
/// normals.
struct PosedPriors {
    std::vector<PriorView> depths, normals;
};

/// Poses the person for each of the estimator's views, and compares the map with the mesh.
/// Errors  ValueError for a frame that does not exist, a map that does not lie on the body, bones in a view that is to
///         be integrated, or, for differences of depth, depths more than half a metre off the body, which have other
///         units; those of check_prior_view.
template <HostExecutor E>
[[nodiscard]] PosedPriors posed_priors(E& executor, const SeenPerson& person, const EstimatedPriors& estimated,
                                       const PosedPriorsParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

[[nodiscard]] inline PosedBody pose_at(const BodyModel& body, const Motion& motion, std::size_t frame) {
    return pose_body(body, motion.pose_at(frame), motion.transl[frame], motion.betas, motion.expression_at(frame));
}

/// The view with the bones of its frame. Checks the view by itself.
[[nodiscard]] inline PriorView with_bones(const SeenPerson& person, const EstimatedView& estimate, int channels) {
    PriorView view = estimate.view;
    check_prior_view(estimate.name, "view", view, channels);
    if (!estimate.frame) return view;
    check_value(*estimate.frame < person.motion.frame_count(), estimate.name,
                "frame is " + std::to_string(*estimate.frame) + ", the motion has " +
                    std::to_string(person.motion.frame_count()) + " frames");
    view.bones = pose_at(person.mover, person.mover_motion, *estimate.frame).bones;
    return view;
}

/// The depth of the person's mesh in the view's camera. Not for a view with bones of its own.
template <HostExecutor E>
[[nodiscard]] PriorView mesh_depth(E& executor, const SeenPerson& person, const EstimatedView& estimate) {
    const auto vertices = estimate.frame ? pose_at(person.body, person.motion, *estimate.frame).vertices
                                         : shaped_vertices(person.body, person.motion.betas);
    return depth_view(executor, vertices, person.body.faces, estimate.view.camera);
}

/// Throws if map and body hardly overlap: the map is of another frame, camera or crop.
inline void check_overlap(const EstimatedView& estimate, const PriorView& mesh) {
    const auto &map = estimate.view.map.mask.data, &body = mesh.map.mask.data;
    std::size_t of_map = 0, of_body = 0, both = 0;
    for (std::size_t i = 0; i < map.size(); ++i)
        of_map += map[i] != 0, of_body += body[i] != 0, both += map[i] && body[i];
    check_value(of_body > 0, estimate.name,
                "its camera sees nothing of the body in that pose; is it another frame or camera?");
    check_value(10 * both > std::min(of_map, of_body), estimate.name,
                "its map does not lie on the body: of " + std::to_string(of_map) + " pixels that count and " +
                    std::to_string(of_body) + " that show the body " + std::to_string(both) +
                    " are the same; is it of another frame, camera or crop?");
}

/// Throws if depths have other units, or no scale.
inline void check_depths(const EstimatedView& estimate, const PriorView& mesh) {
    constexpr double most = 0.5; // metres
    std::vector<double> off;
    const PriorMap& map = estimate.view.map;
    for (std::size_t i = 0; i < map.mask.data.size(); ++i)
        if (map.mask.data[i] && mesh.map.mask.data[i]) off.push_back(map.values.data[i] - mesh.map.values.data[i]);
    const double behind = median(std::move(off));
    check_value(std::abs(behind) <= most, estimate.name,
                "its depths are " + detail::number_text(behind) +
                    " m behind the body's in the median, expected within half a metre: the camera's z, in metres");
}

} // namespace detail

template <HostExecutor E>
PosedPriors posed_priors(E& executor, const SeenPerson& person, const EstimatedPriors& estimated,
                         const PosedPriorsParams& params) {
    PosedPriors posed;
    if (params.depths)
        for (const EstimatedView& estimate : estimated.depths) {
            posed.depths.push_back(detail::with_bones(person, estimate, 1));
            if (!estimate.view.bones.empty()) continue;
            const PriorView mesh = detail::mesh_depth(executor, person, estimate);
            detail::check_overlap(estimate, mesh);
            if (params.feature == DepthFeature::difference) detail::check_depths(estimate, mesh);
        }
    for (const EstimatedView& estimate : estimated.normals) {
        const bool integrate = params.depths && estimate.integrate;
        if (!params.normals && !integrate) continue;
        check_value(!integrate || estimate.view.bones.empty(), estimate.name,
                    "brings its own bones; to integrate it, name the frame instead: the posed mesh says where it lies");
        PriorView view = detail::with_bones(person, estimate, 3);
        if (estimate.view.bones.empty()) {
            const PriorView mesh = detail::mesh_depth(executor, person, estimate);
            detail::check_overlap(estimate, mesh);
            if (integrate) posed.depths.push_back(integrate_normals(view, &mesh).view);
        }
        if (params.normals) posed.normals.push_back(std::move(view));
    }
    return posed;
}

} // namespace gsh
