// SPDX-License-Identifier: Apache-2.0
/// @file  Maps of normals and depth that an estimator made of a person, each with the frame that it belongs to.
#pragma once

#include <gsh/prior/prior_view.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// An estimator's map and its frame. The bones of that frame are added later by the code that computes the features,
/// because the rig may have fewer joints than the captured body.
struct EstimatedView {
    PriorView view;
    std::optional<std::size_t> frame; ///< of the person's motion; if not set, the view's own bones are used
    std::string name;                 ///< for messages: "priors.json: views[2]"
    bool integrate = false;           ///< also integrate the normals to a depth view; they must face the camera

    /// A view with its own bones, or of the canonical pose.
    EstimatedView(PriorView seen = {}) : view(std::move(seen)), name("an estimated view") {}
    EstimatedView(PriorView seen, std::optional<std::size_t> at, std::string called, bool makes_depth = false)
        : view(std::move(seen)), frame(at), name(std::move(called)), integrate(makes_depth) {}
};

/// An estimator's views, used in addition to those of the body's mesh or instead of them.
struct EstimatedPriors {
    std::vector<EstimatedView> depths, normals;
};

} // namespace gsh
