// SPDX-License-Identifier: Apache-2.0
/// @file  An estimator's views with the bones of the frames that they show, held against the body in them.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/core/error.hpp>
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

/// Who is in an estimator's maps: the person as captured, whose mesh is seen, and what moves the Gaussians, whose
/// joints the samples' weights are of. Both are the same unless joints were merged.
struct SeenPerson {
    const BodyModel& body;
    const Motion& motion;
    const BodyModel& mover;
    const Motion& mover_motion;
};

/// What is to be made of an estimator's views; what nobody asks for is not looked at.
struct PosedPriorsParams {
    bool depths = true, normals = true;
    DepthFeature feature = DepthFeature::difference;
};

/// Views with the bones of their frames: for φ_d the estimator's depths, then those that are integrated from normals
/// which ask for it, with the depth of the body's posed mesh as prior; for φ_n its normals.
struct PosedPriors {
    std::vector<PriorView> depths, normals;
};

/// Poses the person for each of the estimator's views, and holds the map against the mesh.
/// Errors  ValueError for a frame that there is not, a map that does not lie on the body, bones beside a wish for
///         integration, or, for differences of depth, depths half a metre off the body: other units; what
///         check_prior_view says.
template <CpuBackend B>
[[nodiscard]] PosedPriors posed_priors(B& backend, const SeenPerson& person, const EstimatedPriors& estimated,
                                       const PosedPriorsParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

[[nodiscard]] inline PosedBody pose_at(const BodyModel& body, const Motion& motion, std::size_t frame) {
    return pose_body(body, motion.pose_at(frame), motion.transl[frame], motion.betas, motion.expression_at(frame));
}

/// The view with its bones, checked alone.
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

/// The depth of the person's mesh where the view's map has its pixels. There is none for a view with bones of its own.
template <CpuBackend B>
[[nodiscard]] PriorView mesh_depth(B& backend, const SeenPerson& person, const EstimatedView& estimate) {
    const auto vertices = estimate.frame ? pose_at(person.body, person.motion, *estimate.frame).vertices
                                         : shaped_vertices(person.body, person.motion.betas);
    return depth_view(backend, vertices, person.body.faces, estimate.view.camera);
}

/// Throws where map and body hardly meet: the map of another frame, camera or crop tells the network nonsense.
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

/// Throws where depths are in other units, or of no scale at all.
inline void check_depths(const EstimatedView& estimate, const PriorView& mesh) {
    constexpr double most = 0.5; // metres
    std::vector<double> off;
    const PriorMap& map = estimate.view.map;
    for (std::size_t i = 0; i < map.mask.data.size(); ++i)
        if (map.mask.data[i] && mesh.map.mask.data[i]) off.push_back(map.values.data[i] - mesh.map.values.data[i]);
    const auto middle = off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2);
    std::nth_element(off.begin(), middle, off.end());
    check_value(std::abs(*middle) <= most, estimate.name,
                "its depths are " + std::to_string(*middle) +
                    " m behind the body's in the median, expected within half a metre: the camera's z, in metres");
}

} // namespace detail

template <CpuBackend B>
PosedPriors posed_priors(B& backend, const SeenPerson& person, const EstimatedPriors& estimated,
                         const PosedPriorsParams& params) {
    PosedPriors posed;
    if (params.depths)
        for (const EstimatedView& estimate : estimated.depths) {
            posed.depths.push_back(detail::with_bones(person, estimate, 1));
            if (!estimate.view.bones.empty()) continue;
            const PriorView mesh = detail::mesh_depth(backend, person, estimate);
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
            const PriorView mesh = detail::mesh_depth(backend, person, estimate);
            detail::check_overlap(estimate, mesh);
            if (integrate) posed.depths.push_back(integrate_normals(view, &mesh).view);
        }
        if (params.normals) posed.normals.push_back(std::move(view));
    }
    return posed;
}

} // namespace gsh
