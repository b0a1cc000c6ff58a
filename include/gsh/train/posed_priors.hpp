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

/// φ_n's views: the estimator's normals, each with its frame's bones.
/// Errors  ValueError for a frame that there is not, or a map that does not lie on the body; what check_prior_view
///         says.
template <CpuBackend B>
[[nodiscard]] std::vector<PriorView> posed_normals(B& backend, const SeenPerson& person,
                                                   const EstimatedPriors& estimated);

/// φ_d's views: the estimator's depths, then those that are integrated from normals which ask for it, with the depth of
/// the body's posed mesh as prior.
/// Errors  the same; for differences of depth also ValueError for depths half a metre off the body: other units.
template <CpuBackend B>
[[nodiscard]] std::vector<PriorView> posed_depths(B& backend, const SeenPerson& person,
                                                  const EstimatedPriors& estimated,
                                                  DepthFeature feature = DepthFeature::difference);

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
std::vector<PriorView> posed_normals(B& backend, const SeenPerson& person, const EstimatedPriors& estimated) {
    std::vector<PriorView> views;
    for (const EstimatedView& estimate : estimated.normals) {
        views.push_back(detail::with_bones(person, estimate, 3));
        if (estimate.view.bones.empty()) detail::check_overlap(estimate, detail::mesh_depth(backend, person, estimate));
    }
    return views;
}

template <CpuBackend B>
std::vector<PriorView> posed_depths(B& backend, const SeenPerson& person, const EstimatedPriors& estimated,
                                    DepthFeature feature) {
    std::vector<PriorView> views;
    for (const EstimatedView& estimate : estimated.depths) {
        views.push_back(detail::with_bones(person, estimate, 1));
        if (!estimate.view.bones.empty()) continue;
        const PriorView mesh = detail::mesh_depth(backend, person, estimate);
        detail::check_overlap(estimate, mesh);
        if (feature == DepthFeature::difference) detail::check_depths(estimate, mesh);
    }
    for (const EstimatedView& estimate : estimated.normals) {
        if (!estimate.integrate) continue;
        check_value(estimate.view.bones.empty(), estimate.name,
                    "brings its own bones; to integrate it, name the frame instead: the posed mesh says where it lies");
        const PriorView normals = detail::with_bones(person, estimate, 3);
        const PriorView mesh = detail::mesh_depth(backend, person, estimate);
        detail::check_overlap(estimate, mesh);
        views.push_back(integrate_normals(normals, &mesh).view);
    }
    return views;
}

} // namespace gsh
