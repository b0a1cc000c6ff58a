// SPDX-License-Identifier: Apache-2.0
/// @file  A prior view: a depth or normal map with its camera and the pose of the body in it.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>
#include <gsh/prior/orthographic_camera.hpp>

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace gsh {

/// Estimators that crop a person use parallel projection; those that keep the photograph's pixels use its pinhole
/// camera.
using PriorCamera = std::variant<OrthographicCamera, Camera<double>>;

/// Values at pixels, and a mask of the valid ones.
struct PriorMap {
    Image<double> values;     // [channels, height, width]; 0 where the mask is 0
    Image<std::uint8_t> mask; // [1, height, width]; 1 where the value is valid
};

/// A depth or normal map of a body, made by a renderer or an estimator.
///
/// Shapes  map of 1 channel: depth, camera z in metres. Of 3: unit normals.
/// Frame   normals are in the camera's frame (x right, y down, z forward): a surface that faces the viewer has
///         n·ray < 0. A map of the far side in the front view's pixels, as in ICON and ECON, has n·ray > 0.
struct PriorView {
    PriorCamera camera;
    PriorMap map;
    std::vector<Affine<double>> bones; // [J] world from canonical in the view's frame; empty: the canonical pose
};

/// Throws unless camera and map have the same size, the map has `channels`, and all valid values are finite.
inline void check_prior_view(std::string_view where, std::string_view name, const PriorView& view, int channels) {
    const auto [height, width] = std::visit(
        [&](const auto& camera) {
            check_camera(where, std::string(name) + ".camera", camera);
            return std::array{camera.height, camera.width};
        },
        view.camera);
    check_image(where, std::string(name) + ".map.values", view.map.values.view(), channels, height, width);
    check_image(where, std::string(name) + ".map.mask", view.map.mask.view(), 1, height, width);
    const std::size_t pixels = view.map.mask.data.size();
    for (std::size_t i = 0; i < view.map.values.data.size(); ++i)
        if (view.map.mask.data[i % pixels] && !std::isfinite(view.map.values.data[i]))
            throw ValueError(std::string(where) + ": " + std::string(name) + ".map.values[" + std::to_string(i) +
                             "] is not finite; clear its mask");
}

/// The depth of a mesh. `bones` give the mesh's pose; leave them empty for the canonical mesh.
///
/// Errors  those of rasterize_mesh.
template <HostExecutor E>
[[nodiscard]] PriorView depth_view(E& executor, Span<const vec3<double>> vertices,
                                   Span<const std::array<int, 3>> faces, const PriorCamera& camera,
                                   std::vector<Affine<double>> bones = {}) {
    const MeshImage seen = std::visit(
        [&](const auto& any) { return rasterize_mesh(executor, vertices, faces, any); }, camera);
    PriorView view{camera, {Image<double>(1, seen.height, seen.width), seen.mask()}, std::move(bones)};
    view.map.values.data = seen.depth;
    return view;
}

/// The smooth normals of a mesh, area-weighted at the vertices. A face seen from behind (the inside of a sleeve) has
/// the normal of its visible side.
template <HostExecutor E>
[[nodiscard]] PriorView normal_view(E& executor, Span<const vec3<double>> vertices,
                                    Span<const std::array<int, 3>> faces, const PriorCamera& camera,
                                    std::vector<Affine<double>> bones = {});

/// Depth from the front, back, left and right of a canonical mesh, in this order.
template <HostExecutor E>
[[nodiscard]] std::vector<PriorView> four_depth_views(E& executor, Span<const vec3<double>> vertices,
                                                      Span<const std::array<int, 3>> faces,
                                                      const SideViewParams& params = {}) {
    std::vector<PriorView> views;
    for (const BodySide side : {BodySide::front, BodySide::back, BodySide::left, BodySide::right})
        views.push_back(depth_view(executor, vertices, faces, side_camera(vertices, side, params)));
    return views;
}

/// Normals from the front and the back of a canonical mesh, in this order.
template <HostExecutor E>
[[nodiscard]] std::vector<PriorView> two_normal_views(E& executor, Span<const vec3<double>> vertices,
                                                      Span<const std::array<int, 3>> faces,
                                                      const SideViewParams& params = {}) {
    std::vector<PriorView> views;
    for (const BodySide side : {BodySide::front, BodySide::back})
        views.push_back(normal_view(executor, vertices, faces, side_camera(vertices, side, params)));
    return views;
}

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The direction of the ray to a camera-space point.
[[nodiscard]] inline vec3<double> sight(const OrthographicCamera&, const vec3<double>&) { return {0, 0, 1}; }
[[nodiscard]] inline vec3<double> sight(const Camera<double>&, const vec3<double>& p) { return p; }

} // namespace detail

template <HostExecutor E>
PriorView normal_view(E& executor, Span<const vec3<double>> vertices, Span<const std::array<int, 3>> faces,
                      const PriorCamera& camera, std::vector<Affine<double>> bones) {
    return std::visit(
        [&](const auto& any) {
            const MeshImage seen = rasterize_mesh(executor, vertices, faces, any);
            const auto normals = interpolate_attribute<vec3<double>>(seen, faces, vertex_normals(vertices, faces));
            PriorView view{camera, {Image<double>(3, seen.height, seen.width), seen.mask()}, std::move(bones)};
            for (std::size_t i = 0; i < seen.size(); ++i) {
                if (!seen.covers(i)) continue;
                const auto& face = faces[static_cast<std::size_t>(seen.triangle[i])];
                vec3<double> corners[3];
                for (std::size_t k = 0; k < 3; ++k) corners[k] = vertices[static_cast<std::size_t>(face[k])];
                const vec3<double> flat = any.R * cross(corners[1] - corners[0], corners[2] - corners[0]);
                vec3<double> normal = any.R * normals[i];
                if (!(length(normal) > 0)) normal = flat; // if the smooth normals cancel out
                if (dot(flat, detail::sight(any, to_camera(any, corners[0]))) > 0) normal = -normal;
                normal = normalize(normal);
                for (int k = 0; k < 3; ++k) view.map.values.view().row(k, 0)[i] = normal[k];
            }
            return view;
        },
        camera);
}

} // namespace gsh
