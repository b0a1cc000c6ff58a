// SPDX-License-Identifier: Apache-2.0
/// @file  What an estimator says about a person: maps of normals and depth, each with the frame that it was made from.
#pragma once

#include <gsh/prior/prior_view.hpp>

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// A map of an estimator and the moment that it shows. Which bones go with a frame, whoever makes the features knows:
/// the rig may have fewer joints than the captured body.
struct EstimatedView {
    PriorView view;
    std::optional<std::size_t> frame; ///< of the person's motion; without one the view's own bones hold
    std::string name;                 ///< for messages: "priors.json: views[2]"
    bool integrate = false;           ///< normals seen from their own side: make a depth view of them, too

    /// A view that brings its bones, or is of the canonical pose.
    EstimatedView(PriorView seen = {}) : view(std::move(seen)), name("an estimated view") {}
    EstimatedView(PriorView seen, std::optional<std::size_t> at, std::string called, bool makes_depth = false)
        : view(std::move(seen)), frame(at), name(std::move(called)), integrate(makes_depth) {}
};

/// Views of an estimator, beside those of the body's mesh or in their place.
struct EstimatedPriors {
    std::vector<EstimatedView> depths, normals;
};

} // namespace gsh
