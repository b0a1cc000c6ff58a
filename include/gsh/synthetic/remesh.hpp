// SPDX-License-Identifier: Apache-2.0
/// @file  Coarsens the closed mesh of a signed distance to given edge lengths, with well-shaped triangles.
#pragma once

#include <gsh/synthetic/surface_nets.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <utility>
#include <vector>

namespace gsh {

/// ∇distance by forward differences, not normalised; `value` is distance(p).
template <class Distance>
[[nodiscard]] vec3<double> distance_gradient(const Distance& distance, const vec3<double>& p, double value) {
    constexpr double h = 2e-5;
    return vec3<double>(distance(p + vec3<double>(h, 0, 0)) - value, distance(p + vec3<double>(0, h, 0)) - value,
                        distance(p + vec3<double>(0, 0, h)) - value) /
           h;
}

namespace detail {

/// A mesh with a list of the faces around each vertex, for edge collapses and flips. A collapse leaves deleted faces
/// (first index -1). Every operation preserves a closed manifold.
class EditableMesh {
public:
    explicit EditableMesh(TriangleMesh mesh) : mesh_(std::move(mesh)), around_(mesh_.vertices.size()) {
        for (std::size_t f = 0; f < mesh_.faces.size(); ++f)
            for (int v : mesh_.faces[f]) around_[index(v)].push_back(static_cast<int>(f));
    }

    [[nodiscard]] std::size_t vertex_count() const { return mesh_.vertices.size(); }
    [[nodiscard]] bool alive(int v) const { return !around_[index(v)].empty(); }
    [[nodiscard]] vec3<double>& position(int v) { return mesh_.vertices[index(v)]; }
    [[nodiscard]] double edge_length(int a, int b) { return length(position(a) - position(b)); }

    /// The neighbours of v, each once, in a fixed order.
    [[nodiscard]] std::vector<int> neighbours(int v) const {
        std::vector<int> ring;
        for (int f : around_[index(v)])
            for (int w : face(f))
                if (w != v && std::find(ring.begin(), ring.end(), w) == ring.end()) ring.push_back(w);
        return ring;
    }

    /// Area-weighted normal at v, not normalised.
    [[nodiscard]] vec3<double> normal(int v) {
        vec3<double> n(0);
        for (int f : around_[index(v)]) n += face_normal(face(f));
        return n;
    }

    /// Merges b into a at position `to`. Returns false and changes nothing if that would pinch the surface, invert a
    /// triangle or make an edge longer than longest(midpoint).
    template <class Longest>
    bool collapse(int a, int b, const vec3<double>& to, const Longest& longest) {
        const std::vector<int> ring_a = neighbours(a), ring_b = neighbours(b);
        std::size_t shared = 0;
        for (int w : ring_b) {
            shared += static_cast<std::size_t>(std::count(ring_a.begin(), ring_a.end(), w));
            // A third neighbour must keep at least three neighbours.
            if (around_[index(w)].size() <= 3 && std::count(ring_a.begin(), ring_a.end(), w)) return false;
        }
        if (shared != 2) return false; // the link condition
        for (const auto* ring : {&ring_a, &ring_b})
            for (int w : *ring)
                if (w != a && w != b && length(position(w) - to) > longest(position(w))) return false;
        for (int from : {a, b})
            for (int f : around_[index(from)]) {
                if (has(f, a) && has(f, b)) continue;
                const std::array<int, 3> before = face(f);
                const vec3<double> n = face_normal(before), kept = position(from);
                position(from) = to;
                const vec3<double> m = face_normal(before);
                position(from) = kept;
                if (dot(n, m) < 0.3 * length(n) * length(m) || length(m) < 1e-12) return false;
            }
        for (int f : around_[index(b)]) {
            if (has(f, a)) {
                for (int v : face(f))
                    if (v != b) std::erase(around_[index(v)], f);
                face(f)[0] = -1;
            } else {
                std::replace(face(f).begin(), face(f).end(), b, a);
                around_[index(a)].push_back(f);
            }
        }
        around_[index(b)].clear();
        position(a) = to;
        return true;
    }

    /// Replaces edge ab of faces (a, b, c) and (b, a, d) by cd if that brings valences closer to six.
    void flip_if_better(int a, int b) {
        int first = -1, second = -1;
        for (int f : around_[index(a)])
            if (has(f, b)) (follows(f, a, b) ? first : second) = f;
        if (first < 0 || second < 0) return;
        const int c = third(first, a, b), d = third(second, a, b);
        const auto valence = [&](int v) { return static_cast<int>(around_[index(v)].size()); };
        const auto off = [&](int v, int change) { return std::abs(valence(v) + change - 6); };
        if (off(a, -1) + off(b, -1) + off(c, 1) + off(d, 1) >= off(a, 0) + off(b, 0) + off(c, 0) + off(d, 0)) return;
        if (c == d || valence(a) <= 3 || valence(b) <= 3) return;
        const std::vector<int> ring = neighbours(c);
        if (std::find(ring.begin(), ring.end(), d) != ring.end()) return;
        const vec3<double> old_normal = face_normal(face(first)) + face_normal(face(second));
        const vec3<double> n1 = face_normal({a, d, c}), n2 = face_normal({d, b, c});
        const double l = 0.5 * length(old_normal);
        if (dot(n1, old_normal) < 0.5 * length(n1) * l || dot(n2, old_normal) < 0.5 * length(n2) * l) return;
        if (length(n1) < 0.05 * l || length(n2) < 0.05 * l) return; // avoid slivers
        face(first) = {a, d, c};
        face(second) = {d, b, c};
        std::erase(around_[index(a)], second);
        std::erase(around_[index(b)], first);
        around_[index(c)].push_back(second);
        around_[index(d)].push_back(first);
    }

    /// The remaining vertices and faces, renumbered in order.
    [[nodiscard]] TriangleMesh compact() const {
        TriangleMesh result;
        std::vector<int> renumbered(vertex_count(), -1);
        for (std::size_t v = 0; v < vertex_count(); ++v)
            if (!around_[v].empty()) {
                renumbered[v] = static_cast<int>(result.vertices.size());
                result.vertices.push_back(mesh_.vertices[v]);
            }
        for (const auto& f : mesh_.faces)
            if (f[0] >= 0)
                result.faces.push_back({renumbered[index(f[0])], renumbered[index(f[1])], renumbered[index(f[2])]});
        return result;
    }

private:
    static std::size_t index(int i) { return static_cast<std::size_t>(i); }
    [[nodiscard]] std::array<int, 3>& face(int f) { return mesh_.faces[index(f)]; }
    [[nodiscard]] const std::array<int, 3>& face(int f) const { return mesh_.faces[index(f)]; }
    [[nodiscard]] bool has(int f, int v) const { return face(f)[0] == v || face(f)[1] == v || face(f)[2] == v; }
    [[nodiscard]] bool follows(int f, int a, int b) const {
        const auto& t = face(f);
        return (t[0] == a && t[1] == b) || (t[1] == a && t[2] == b) || (t[2] == a && t[0] == b);
    }
    [[nodiscard]] int third(int f, int a, int b) const { return face(f)[0] + face(f)[1] + face(f)[2] - a - b; }
    [[nodiscard]] vec3<double> face_normal(const std::array<int, 3>& f) {
        return cross(position(f[1]) - position(f[0]), position(f[2]) - position(f[0]));
    }

    TriangleMesh mesh_;
    std::vector<std::vector<int>> around_;
};

} // namespace detail

/// Brings the edges of a mesh of distance(p) = 0 to about edge_length(p). Each round collapses short edges, flips edges
/// towards valence six, moves vertices along the surface to even out their spacing, and projects them back onto it.
/// Edges are never split, so the input must be finer than the target.
///
/// Source  after Botsch and Kobbelt, "A Remeshing Approach to Multiresolution Modeling", 2004.
template <class Distance, class EdgeLength>
[[nodiscard]] TriangleMesh remesh(TriangleMesh input, const Distance& distance, const EdgeLength& edge_length,
                                  int rounds = 5) {
    detail::EditableMesh mesh(std::move(input));
    const int count = static_cast<int>(mesh.vertex_count());
    const auto project = [&](vec3<double> p) {
        const double d = distance(p), limit = 0.5 * edge_length(p);
        const vec3<double> g = distance_gradient(distance, p, d);
        const vec3<double> step = g * (-d / std::max(dot(g, g), 1e-3));
        return p + step * std::min(1.0, limit / std::max(length(step), 1e-12));
    };
    for (int round = 0; round < rounds; ++round) {
        const double shortest = round == 0 ? 0.6 : 0.8; // of the target length; smaller in the first round
        for (int a = 0; a < count; ++a)
            for (bool again = mesh.alive(a); again;) {
                again = false;
                for (int b : mesh.neighbours(a)) {
                    const vec3<double> middle = (mesh.position(a) + mesh.position(b)) * 0.5;
                    if (mesh.edge_length(a, b) >= shortest * edge_length(middle)) continue;
                    const auto longest = [&](const vec3<double>& p) { return 4.0 / 3 * edge_length(p); };
                    if (mesh.collapse(a, b, middle, longest)) {
                        again = true;
                        break;
                    }
                }
            }
        for (int a = 0; a < count; ++a)
            if (mesh.alive(a))
                for (int b : mesh.neighbours(a))
                    if (a < b) mesh.flip_if_better(a, b);
        for (int v = 0; v < count; ++v) {
            if (!mesh.alive(v)) continue;
            vec3<double> mean(0);
            const std::vector<int> ring = mesh.neighbours(v);
            for (int w : ring) mean += mesh.position(w);
            vec3<double> move = mean / static_cast<double>(ring.size()) - mesh.position(v);
            const vec3<double> n = mesh.normal(v);
            move -= n * (dot(n, move) / std::max(dot(n, n), 1e-30)); // tangential component only
            mesh.position(v) = project(mesh.position(v) + move * 0.6);
        }
    }
    return mesh.compact();
}

} // namespace gsh
