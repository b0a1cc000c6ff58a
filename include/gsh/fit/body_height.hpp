// SPDX-License-Identifier: Apache-2.0
/// @file  How tall a body stands, as a function of its shape.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gsh {

/// Height of the body at rest, and how it follows the shape: that between its highest and its lowest vertex.
///
/// Units   metres.
struct BodyHeight {
    double mean = 0;
    std::vector<double> directions; // [S]

    BodyHeight(const BodyModel& body, int shape_count) {
        std::size_t low = 0, high = 0;
        for (std::size_t v = 0; v < body.vertex_count(); ++v) {
            if (body.v_template[v].y < body.v_template[low].y) low = v;
            if (body.v_template[v].y > body.v_template[high].y) high = v;
        }
        mean = body.v_template[high].y - body.v_template[low].y;
        const auto S = static_cast<std::size_t>(body.shape_count);
        for (std::size_t k = 0; k < static_cast<std::size_t>(shape_count); ++k)
            directions.push_back(body.shapedirs[high * S + k].y - body.shapedirs[low * S + k].y);
    }

    [[nodiscard]] double of(Span<const double> betas) const {
        double height = mean;
        for (std::size_t k = 0; k < std::min(betas.size(), directions.size()); ++k) height += directions[k] * betas[k];
        return height;
    }
};

} // namespace gsh
