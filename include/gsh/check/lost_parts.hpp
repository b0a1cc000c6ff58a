// SPDX-License-Identifier: Apache-2.0
/// @file  Which parts of a posed body a mask lacks: "the left foot".
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace gsh {

/// The parts of a person, as people call them.
inline constexpr std::array<std::string_view, 14> body_part_names = {
    "head",       "trunk",      "left upper arm", "right upper arm", "left forearm",    "right forearm", "left hand",
    "right hand", "left thigh", "right thigh",    "left lower leg",  "right lower leg", "left foot",     "right foot"};

/// The part that each triangle belongs to, an index into body_part_names: that of the joint with the largest weight.
///
/// Shapes  the result is [F].
/// Errors  ShapeError for a body without the 55 joints of SMPL-X.
[[nodiscard]] inline std::vector<int> body_parts(const BodyModel& body);

/// Pixels of one part in one photograph.
struct PartSight {
    double visible = 0; ///< pixels in which the camera sees the part
    double lost = 0;    ///< those of them that lie outside of the mask, by more than a margin

    /// Whether the mask lacks the part: more than a third of what the camera sees of it.
    [[nodiscard]] bool is_lost() const {
        constexpr double least = 12; // fewer pixels are not worth a word
        return visible >= least && lost > visible / 3;
    }
};

/// Compares a posed body with a mask. Fitted outlines miss masks by a few pixels, so pixels within `margin` of the mask
/// do not count as lost.
///
/// Shapes  vertices [V] in the world; parts [F] of body_parts; the mask has the camera's size.
/// Units   margin in pixels.
/// Errors  ShapeError if sizes disagree.
[[nodiscard]] inline std::array<PartSight, body_part_names.size()>
parts_in_mask(const BodyModel& body, Span<const int> parts, Span<const vec3<double>> vertices,
              const Camera<double>& camera, const Silhouette& mask, int margin);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// For each joint of SMPL-X its part.
inline int part_of_joint(std::size_t joint) {
    constexpr int head = 0, trunk = 1, upper_arm = 2, forearm = 4, hand = 6, thigh = 8, lower_leg = 10, foot = 12;
    constexpr std::array<int, 25> of_body = {
        trunk,   thigh,       thigh + 1, trunk,    lower_leg, lower_leg + 1, trunk, foot,      foot + 1,
        trunk,   foot,        foot + 1,  head,     trunk,     trunk,         head,  upper_arm, upper_arm + 1,
        forearm, forearm + 1, hand,      hand + 1, head,      head,          head};
    constexpr std::size_t right_hand = 40;
    if (joint < of_body.size()) return of_body[joint];
    return joint < right_hand ? hand : hand + 1;
}

/// Pixels within `margin` of the silhouette, along rows and columns.
inline Silhouette widened(Silhouette mask, int margin) {
    mask.invert();
    mask = eroded(mask, margin); // of what is outside
    mask.invert();
    return mask;
}

} // namespace detail

inline std::vector<int> body_parts(const BodyModel& body) {
    constexpr std::size_t joints = 55;
    check_size("body_parts", "joints", body.joint_count(), joints, "parts are named for the joints of SMPL-X");
    std::vector<int> of_vertex(body.vertex_count());
    for (std::size_t v = 0; v < of_vertex.size(); ++v) {
        const double* weights = &body.weights[v * joints];
        of_vertex[v] =
            detail::part_of_joint(static_cast<std::size_t>(std::max_element(weights, weights + joints) - weights));
    }
    std::vector<int> result;
    result.reserve(body.faces.size());
    for (const auto& face : body.faces) result.push_back(of_vertex[static_cast<std::size_t>(face[0])]);
    return result;
}

inline std::array<PartSight, body_part_names.size()> parts_in_mask(const BodyModel& body, Span<const int> parts,
                                                                   Span<const vec3<double>> vertices,
                                                                   const Camera<double>& camera, const Silhouette& mask,
                                                                   int margin) {
    check_size("parts_in_mask", "parts", parts.size(), body.faces.size(), "those of body_parts");
    check_size("parts_in_mask", "mask", mask.inside.size(),
               static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height), "one for each pixel");
    cpu::Serial backend;
    const MeshImage image = rasterize_mesh(backend, vertices, body.faces, camera);
    const Silhouette near_mask = detail::widened(mask, margin);
    std::array<PartSight, body_part_names.size()> result{};
    for (std::size_t i = 0; i < image.size(); ++i) {
        if (!image.covers(i)) continue;
        PartSight& sight = result[static_cast<std::size_t>(parts[static_cast<std::size_t>(image.triangle[i])])];
        sight.visible += 1, sight.lost += !near_mask.inside[i];
    }
    return result;
}

} // namespace gsh
