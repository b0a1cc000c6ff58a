// SPDX-License-Identifier: Apache-2.0
/// @file  Which part of which posed body each pixel shows, to evaluate faces, hands and people separately.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A part of a mesh: the triangles with all corners in a list of vertices.
struct MeshRegion {
    std::string name;          ///< "face"
    std::vector<int> vertices; ///< in any order
};

/// The region of each triangle, [F]: the first whose list contains all three corners, or -1.
/// Errors  ValueError for a vertex or a corner out of range.
[[nodiscard]] inline std::vector<int> triangle_regions(std::size_t vertex_count, Span<const std::array<int, 3>> faces,
                                                       Span<const MeshRegion> regions) {
    constexpr std::string_view where = "triangle_regions";
    const auto check_vertex = [&](int v, const std::string& owner) {
        check_value(v >= 0 && static_cast<std::size_t>(v) < vertex_count, where,
                    owner + " names vertex " + std::to_string(v) + ", expected an index below " +
                        std::to_string(vertex_count));
    };
    for (std::size_t f = 0; f < faces.size(); ++f)
        for (const int v : faces[f]) check_vertex(v, "faces[" + std::to_string(f) + "]");
    std::vector<int> result(faces.size(), -1);
    std::vector<bool> inside(vertex_count);
    for (std::size_t r = 0; r < regions.size(); ++r) {
        inside.assign(vertex_count, false);
        for (const int v : regions[r].vertices) {
            check_vertex(v, "region '" + regions[r].name + "'");
            inside[static_cast<std::size_t>(v)] = true;
        }
        const auto holds = [&](int v) { return inside[static_cast<std::size_t>(v)]; };
        for (std::size_t f = 0; f < faces.size(); ++f)
            if (result[f] < 0 && holds(faces[f][0]) && holds(faces[f][1]) && holds(faces[f][2]))
                result[f] = static_cast<int>(r);
    }
    return result;
}

/// The region that each pixel of a view shows.
struct RegionLabels {
    static constexpr int nothing = -2; ///< no body
    static constexpr int rest = -1;    ///< the body outside all regions

    int height = 0, width = 0;
    std::vector<int> labels; // [height, width] index of a region, or one of the above

    /// 1 where the pixel shows `region`, else 0: a mask for loss/metrics.hpp.
    [[nodiscard]] Image<std::uint8_t> mask(int region) const {
        Image<std::uint8_t> result(1, height, width);
        for (std::size_t i = 0; i < labels.size(); ++i) result.data[i] = labels[i] == region;
        return result;
    }
    /// 1 where `person`, a photograph's alpha, exceeds 1/2 and no region is seen: trunk and limbs, clothed or not.
    /// Shapes  person [1, height, width].
    template <class T>
    [[nodiscard]] Image<std::uint8_t> remainder(const ImageView<T>& person) const {
        check_image("RegionLabels::remainder", "person", person, 1, height, width);
        Image<std::uint8_t> result(1, height, width);
        for (std::size_t i = 0; i < labels.size(); ++i)
            result.data[i] = labels[i] < 0 && static_cast<double>(person.data[i]) > 0.5;
        return result;
    }
};

/// Labels a view by the nearest triangle at each pixel's centre: a hand behind the back, or behind another body in the
/// same mesh, has no pixels.
///
/// Shapes  vertices [V] posed, as of pose_body; faces [F].
/// Errors  as rasterize_mesh and triangle_regions.
template <HostExecutor E>
[[nodiscard]] RegionLabels region_labels(E& executor, Span<const vec3<double>> vertices,
                                         Span<const std::array<int, 3>> faces, const Camera<double>& camera,
                                         Span<const MeshRegion> regions) {
    const std::vector<int> region_of = triangle_regions(vertices.size(), faces, regions);
    const MeshImage seen = rasterize_mesh(executor, vertices, faces, camera);
    RegionLabels result{seen.height, seen.width, std::vector<int>(seen.size(), RegionLabels::nothing)};
    for (std::size_t i = 0; i < seen.size(); ++i)
        if (seen.covers(i)) result.labels[i] = region_of[static_cast<std::size_t>(seen.triangle[i])];
    return result;
}

/// The posed mesh of one person in a scene of several people.
struct LabelledBody {
    Span<const vec3<double>> vertices;    // [V]
    Span<const std::array<int, 3>> faces; // [F]
    Span<const MeshRegion> regions = {};
};

/// Labels a view of several people. The labels of each person are those of region_labels, with `nothing` where another
/// person is in front. Of surfaces at equal depth, the first person's is visible.
/// Errors  as region_labels.
template <HostExecutor E>
[[nodiscard]] std::vector<RegionLabels> people_labels(E& executor, Span<const LabelledBody> people,
                                                      const Camera<double>& camera) {
    std::vector<vec3<double>> vertices;
    std::vector<std::array<int, 3>> faces;
    std::vector<int> region_of;
    std::vector<std::size_t> person_of; // of each face
    for (std::size_t p = 0; p < people.size(); ++p) {
        const auto& [own_vertices, own_faces, regions] = people[p];
        const std::vector<int> own = triangle_regions(own_vertices.size(), own_faces, regions);
        const int first = static_cast<int>(vertices.size());
        vertices.insert(vertices.end(), own_vertices.begin(), own_vertices.end());
        for (const auto& f : own_faces) faces.push_back({f[0] + first, f[1] + first, f[2] + first});
        region_of.insert(region_of.end(), own.begin(), own.end());
        person_of.insert(person_of.end(), own_faces.size(), p);
    }
    const MeshImage seen = rasterize_mesh(executor, vertices, faces, camera);
    std::vector<RegionLabels> result(
        people.size(), {seen.height, seen.width, std::vector<int>(seen.size(), RegionLabels::nothing)});
    for (std::size_t i = 0; i < seen.size(); ++i) {
        if (!seen.covers(i)) continue;
        const auto f = static_cast<std::size_t>(seen.triangle[i]);
        result[person_of[f]].labels[i] = region_of[f];
    }
    return result;
}

/// A mask for each person of a photograph, 1 where `everybody`, the photograph's alpha, exceeds 1/2 and the pixel
/// belongs to the person. A pixel that a body covers belongs to the visible body. With `clothes`, each other pixel
/// belongs to the person that is reached with the fewest steps from pixel to pixel within the mask. Hair and skirts
/// then have an owner.
///
/// Shapes  labels as of people_labels, one per person; everybody [1, height, width].
template <class T>
[[nodiscard]] std::vector<Image<std::uint8_t>> people_masks(const std::vector<RegionLabels>& labels,
                                                            const ImageView<T>& everybody, bool clothes = true) {
    std::vector<Image<std::uint8_t>> masks;
    if (labels.empty()) return masks;
    const int height = labels[0].height, width = labels[0].width;
    check_image("people_masks", "everybody", everybody, 1, height, width);
    std::vector<int> owner(labels[0].labels.size(), -1);
    std::vector<std::size_t> reached; // in order of distance
    for (std::size_t i = 0; i < owner.size(); ++i)
        for (std::size_t p = 0; p < labels.size(); ++p)
            if (labels[p].labels[i] != RegionLabels::nothing && static_cast<double>(everybody.data[i]) > 0.5)
                owner[i] = static_cast<int>(p), reached.push_back(i);
    for (std::size_t next = 0; clothes && next < reached.size(); ++next) {
        const std::size_t i = reached[next], w = static_cast<std::size_t>(width), x = i % w;
        const auto visit = [&](bool inside, std::size_t neighbour) {
            if (!inside || owner[neighbour] >= 0 || !(static_cast<double>(everybody.data[neighbour]) > 0.5)) return;
            owner[neighbour] = owner[i];
            reached.push_back(neighbour);
        };
        visit(x > 0, i - 1), visit(x + 1 < w, i + 1), visit(i >= w, i - w), visit(i + w < owner.size(), i + w);
    }
    for (std::size_t p = 0; p < labels.size(); ++p) {
        masks.emplace_back(1, height, width);
        for (std::size_t i = 0; i < owner.size(); ++i) masks[p].data[i] = owner[i] == static_cast<int>(p);
    }
    return masks;
}

} // namespace gsh
