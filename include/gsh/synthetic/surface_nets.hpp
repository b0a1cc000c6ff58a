// SPDX-License-Identifier: Apache-2.0
/// @file  Surface nets: a triangle mesh from a signed distance on a rectilinear grid of any spacing.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// A closed triangle mesh, counter-clockwise seen from outside.
struct TriangleMesh {
    std::vector<vec3<double>> vertices;
    std::vector<std::array<int, 3>> faces;
};

/// Grid lines of a rectilinear grid per axis, ascending.
struct GridLines {
    std::vector<double> x, y, z;
};

/// Grid lines from low to high whose local spacing is spacing(position).
template <class Spacing>
[[nodiscard]] std::vector<double> graded_lines(double low, double high, const Spacing& spacing) {
    std::vector<double> lines{low};
    while (lines.back() < high) {
        const double half_way = lines.back() + 0.5 * spacing(lines.back());
        lines.push_back(lines.back() + spacing(half_way));
    }
    return lines;
}

namespace detail {

/// For each set of inside corners of a cell: the number of sheets of the surface in the cell, and the sheet of each of
/// the twelve edges (-1: not crossed). Corner bits are x, y << 1, z << 2. Edge e lies along axis e / 4; bits 0 and 1 of
/// e are its offsets along the next two axes. Where inside corners are diagonally opposite on a square, the surface
/// passes between them. The rule is symmetric, so both cells at the square agree.
class CellSheets {
public:
    CellSheets() {
        for (unsigned mask = 0; mask < 256; ++mask) fill(mask);
    }
    [[nodiscard]] int count(unsigned mask) const { return count_[mask]; }
    [[nodiscard]] int sheet(unsigned mask, int edge) const { return sheet_[mask][static_cast<std::size_t>(edge)]; }

    [[nodiscard]] static std::array<unsigned, 2> corners(int edge) {
        const unsigned axis = static_cast<unsigned>(edge) / 4, e = static_cast<unsigned>(edge);
        const unsigned low = ((e & 1u) << ((axis + 1) % 3)) | (((e >> 1) & 1u) << ((axis + 2) % 3));
        return {low, low | (1u << axis)};
    }

private:
    void fill(unsigned mask) {
        std::array<int, 12> group{};
        const auto inside = [&](unsigned corner) { return ((mask >> corner) & 1u) != 0; };
        const auto unite = [&](int a, int b) {
            const int from = group[static_cast<std::size_t>(a)], to = group[static_cast<std::size_t>(b)];
            for (int& g : group)
                if (g == from) g = to;
        };
        for (int e = 0; e < 12; ++e) {
            const auto [a, b] = corners(e);
            group[static_cast<std::size_t>(e)] = inside(a) != inside(b) ? e : -1;
        }
        for (unsigned axis = 0; axis < 3; ++axis)
            for (unsigned side = 0; side < 2; ++side) { // a face of the cell, with four edges
                std::vector<int> crossed;
                for (int e = 0; e < 12; ++e) {
                    const auto [a, b] = corners(e);
                    if (((a >> axis) & 1u) == side && ((b >> axis) & 1u) == side &&
                        group[static_cast<std::size_t>(e)] >= 0)
                        crossed.push_back(e);
                }
                for (const int e : crossed)
                    for (const int f : crossed) {
                        const auto [a, b] = corners(e);
                        const auto [c, d] = corners(f);
                        const unsigned in_e = inside(a) ? a : b, in_f = inside(c) ? c : d;
                        if (crossed.size() == 2 || in_e == in_f) unite(e, f);
                    }
            }
        std::vector<int> seen;
        for (std::size_t e = 0; e < 12; ++e) {
            sheet_[mask][e] = -1;
            if (group[e] < 0) continue;
            const auto found = std::find(seen.begin(), seen.end(), group[e]);
            sheet_[mask][e] = static_cast<int>(found - seen.begin());
            if (found == seen.end()) seen.push_back(group[e]);
        }
        count_[mask] = static_cast<int>(seen.size());
    }

    std::array<std::array<int, 12>, 256> sheet_{};
    std::array<int, 256> count_{};
};

} // namespace detail

/// Polygonises distance(p) = 0. Each cell has one vertex per sheet of the surface in it, and each crossed grid edge has
/// a quad (two triangles) around it. Blocks of cells that cannot contain the surface are skipped.
///
/// Errors  ValueError if the surface reaches the grid's border, where the mesh would be open.
/// Source  Gibson, "Constrained Elastic Surface Nets", 1998, without the relaxation. Several vertices per cell separate
///         sheets of the surface, as in Nielson, "Dual Marching Cubes", 2004.
template <class Distance>
[[nodiscard]] TriangleMesh surface_nets(const GridLines& lines, const Distance& distance) {
    constexpr std::size_t block = 8;
    constexpr double safety = 1.7; // distances are estimates, so blocks near the surface are kept
    const std::size_t nx = lines.x.size(), ny = lines.y.size(), nz = lines.z.size();
    const auto at = [&](std::size_t i, std::size_t j, std::size_t k) { return i + nx * (j + ny * k); };
    const auto point = [&](std::size_t i, std::size_t j, std::size_t k) {
        return vec3<double>(lines.x[i], lines.y[j], lines.z[k]);
    };

    // Values at grid points; in skipped blocks only their sign is used.
    std::vector<float> values(nx * ny * nz);
    for (std::size_t k0 = 0; k0 < nz; k0 += block)
        for (std::size_t j0 = 0; j0 < ny; j0 += block)
            for (std::size_t i0 = 0; i0 < nx; i0 += block) {
                const std::size_t i1 = std::min(i0 + block, nx), j1 = std::min(j0 + block, ny),
                                  k1 = std::min(k0 + block, nz);
                const vec3<double> low = point(i0, j0, k0),
                                   high = point(std::min(i1, nx - 1), std::min(j1, ny - 1), std::min(k1, nz - 1));
                const double centre = distance((low + high) * 0.5);
                const bool skip = std::abs(centre) > safety * 0.5 * length(high - low);
                for (std::size_t k = k0; k < k1; ++k)
                    for (std::size_t j = j0; j < j1; ++j)
                        for (std::size_t i = i0; i < i1; ++i)
                            values[at(i, j, k)] = static_cast<float>(skip ? centre : distance(point(i, j, k)));
            }

    const detail::CellSheets sheets;
    const auto inside_mask = [&](std::size_t cell) {
        unsigned mask = 0;
        for (unsigned corner = 0; corner < 8; ++corner) {
            const std::size_t there = cell + (corner & 1u) + nx * ((corner >> 1) & 1u) + nx * ny * (corner >> 2);
            mask |= (values[there] < 0 ? 1u : 0u) << corner;
        }
        return mask;
    };
    TriangleMesh mesh;
    std::vector<std::int32_t> first_vertex(nx * ny * nz, -1); // of a cell, by its low corner
    for (std::size_t k = 0; k + 1 < nz; ++k)
        for (std::size_t j = 0; j + 1 < ny; ++j)
            for (std::size_t i = 0; i + 1 < nx; ++i) {
                const unsigned mask = inside_mask(at(i, j, k));
                if (mask == 0 || mask == 255) continue;
                check_value(i > 0 && j > 0 && k > 0 && i + 2 < nx && j + 2 < ny && k + 2 < nz, "surface_nets",
                            "the surface reaches the border of the grid; extend its lines");
                first_vertex[at(i, j, k)] = static_cast<std::int32_t>(mesh.vertices.size());
                std::array<vec3<double>, 4> sum{};
                std::array<double, 4> crossings{};
                for (int e = 0; e < 12; ++e) {
                    const int sheet = sheets.sheet(mask, e);
                    if (sheet < 0) continue;
                    const auto [a, b] = detail::CellSheets::corners(e);
                    const auto corner = [&](unsigned c) {
                        return std::array<std::size_t, 3>{i + (c & 1u), j + ((c >> 1) & 1u), k + (c >> 2)};
                    };
                    const auto [ai, aj, ak] = corner(a);
                    const auto [bi, bj, bk] = corner(b);
                    const double va = values[at(ai, aj, ak)], vb = values[at(bi, bj, bk)];
                    const vec3<double> pa = point(ai, aj, ak), pb = point(bi, bj, bk);
                    sum[static_cast<std::size_t>(sheet)] += pa + (pb - pa) * (va / (va - vb));
                    crossings[static_cast<std::size_t>(sheet)] += 1;
                }
                for (std::size_t sheet = 0; sheet < static_cast<std::size_t>(sheets.count(mask)); ++sheet)
                    mesh.vertices.push_back(sum[sheet] / crossings[sheet]);
            }

    // A crossed edge along `axis` from low to high corner: its four cells, in outward-facing order.
    for (std::size_t k = 1; k + 1 < nz; ++k)
        for (std::size_t j = 1; j + 1 < ny; ++j)
            for (std::size_t i = 1; i + 1 < nx; ++i)
                for (std::size_t axis = 0; axis < 3; ++axis) {
                    const std::size_t step[3] = {1, nx, nx * ny}, here = at(i, j, k);
                    const bool inside = values[here] < 0;
                    if (inside == (values[here + step[axis]] < 0)) continue;
                    const std::size_t u = step[(axis + 1) % 3], v = step[(axis + 2) % 3];
                    const auto vertex = [&](std::size_t cell, int offset) { // offset of the edge within that cell
                        const int sheet = sheets.sheet(inside_mask(cell), static_cast<int>(4 * axis) + offset);
                        return first_vertex[cell] + sheet;
                    };
                    std::array<int, 4> q = {vertex(here, 0), vertex(here - u, 1), vertex(here - u - v, 3),
                                            vertex(here - v, 2)};
                    if (!inside) std::swap(q[1], q[3]);
                    const auto square = [&](int a, int b) {
                        const vec3<double> d = mesh.vertices[static_cast<std::size_t>(q[static_cast<std::size_t>(a)])] -
                                               mesh.vertices[static_cast<std::size_t>(q[static_cast<std::size_t>(b)])];
                        return dot(d, d);
                    };
                    if (square(0, 2) <= square(1, 3)) {
                        mesh.faces.push_back({q[0], q[1], q[2]});
                        mesh.faces.push_back({q[0], q[2], q[3]});
                    } else {
                        mesh.faces.push_back({q[0], q[1], q[3]});
                        mesh.faces.push_back({q[1], q[2], q[3]});
                    }
                }
    return mesh;
}

} // namespace gsh
