// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"
#include "support/skip.hpp"

#include <gsh/body/geodesic.hpp>
#include <gsh/io/body/body_file.hpp>

#include <functional>
#include <limits>
#include <map>
#include <numeric>
#include <queue>

namespace gsh {
namespace {

constexpr double infinity = GeodesicDistance::unreachable;
using Faces = std::vector<std::array<int, 3>>;

struct Mesh {
    std::vector<vec3<double>> vertices;
    Faces faces;
    [[nodiscard]] GeodesicDistance geodesic() const { return {vertices, faces}; }
};

vec3<double> flat(double x, double y) {
    return {x, y, 0};
}

/// A sheet of columns x rows vertices about `spacing` apart, with random offsets in the plane and random diagonals.
/// `bend` is then applied to each flat point (x, y).
Mesh sheet(int columns, int rows, double spacing, double shake,
           const std::function<vec3<double>(double, double)>& bend = flat) {
    test::Rng rng(3);
    Mesh mesh;
    for (int j = 0; j < rows; ++j)
        for (int i = 0; i < columns; ++i) {
            const bool inner = i > 0 && j > 0 && i + 1 < columns && j + 1 < rows;
            const double dx = rng.uniform(-shake, shake) * inner, dy = rng.uniform(-shake, shake) * inner;
            mesh.vertices.push_back(bend((i + dx) * spacing, (j + dy) * spacing));
        }
    for (int j = 0; j + 1 < rows; ++j)
        for (int i = 0; i + 1 < columns; ++i) {
            const int a = j * columns + i, b = a + 1, c = b + columns, d = a + columns;
            if ((i + j) % 2) mesh.faces.insert(mesh.faces.end(), {{a, b, c}, {a, c, d}});
            else mesh.faces.insert(mesh.faces.end(), {{a, b, d}, {b, c, d}});
        }
    return mesh;
}

/// A unit sphere: an octahedron whose triangles are split n times.
Mesh sphere(int splits) {
    Mesh mesh{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
              {{0, 1, 2}, {1, 3, 2}, {3, 4, 2}, {4, 0, 2}, {1, 0, 5}, {3, 1, 5}, {4, 3, 5}, {0, 4, 5}}};
    for (int n = 0; n < splits; ++n) {
        std::map<std::pair<int, int>, int> middles;
        Faces faces;
        for (const auto& f : mesh.faces) {
            std::array<int, 3> m{};
            for (std::size_t k = 0; k < 3; ++k) {
                const auto ends = std::minmax(f[k], f[(k + 1) % 3]);
                const auto [place, fresh] = middles.try_emplace(ends, static_cast<int>(mesh.vertices.size()));
                if (fresh)
                    mesh.vertices.push_back(normalize(mesh.vertices[static_cast<std::size_t>(ends.first)] +
                                                      mesh.vertices[static_cast<std::size_t>(ends.second)]));
                m[k] = place->second;
            }
            faces.insert(faces.end(), {{f[0], m[0], m[2]}, {f[1], m[1], m[0]}, {f[2], m[2], m[1]}, m});
        }
        mesh.faces = faces;
    }
    return mesh;
}

/// The reference: Dijkstra's algorithm over vertices and `steps` further points on each edge, which are joined straight
/// across triangles. Its distances are slightly too long and never too short.
std::vector<double> subdivided_dijkstra(const Mesh& mesh, Span<const int> sources, std::size_t steps, double reach) {
    std::vector<vec3<double>> points = mesh.vertices;
    std::map<std::pair<int, int>, std::size_t> edges;
    std::vector<std::vector<std::size_t>> on_face, faces_at(mesh.vertices.size());
    for (const auto& f : mesh.faces) {
        auto& ring = on_face.emplace_back();
        for (std::size_t k = 0; k < 3; ++k) {
            const auto ends = std::minmax(f[k], f[(k + 1) % 3]);
            const auto [place, fresh] = edges.try_emplace(ends, points.size());
            for (std::size_t s = 1; fresh && s <= steps; ++s) {
                const double share = static_cast<double>(s) / static_cast<double>(steps + 1);
                points.push_back(mesh.vertices[static_cast<std::size_t>(ends.first)] * (1 - share) +
                                 mesh.vertices[static_cast<std::size_t>(ends.second)] * share);
            }
            ring.push_back(static_cast<std::size_t>(f[k]));
            for (std::size_t s = 0; s < steps; ++s) ring.push_back(place->second + s);
        }
        faces_at.resize(points.size());
        for (const std::size_t p : ring) faces_at[p].push_back(on_face.size() - 1);
    }
    std::vector<double> distances(points.size(), infinity);
    using Item = std::pair<double, std::size_t>;
    std::priority_queue<Item, std::vector<Item>, std::greater<>> queue;
    const auto arrive = [&](std::size_t p, double d) {
        if (d < distances[p]) queue.push({distances[p] = d, p});
    };
    for (const int source : sources) arrive(static_cast<std::size_t>(source), 0);
    while (!queue.empty() && queue.top().first <= reach) {
        const auto [distance, p] = queue.top();
        queue.pop();
        if (distance > distances[p]) continue;
        for (const std::size_t f : faces_at[p])
            for (const std::size_t q : on_face[f]) arrive(q, distance + length(points[q] - points[p]));
    }
    distances.resize(mesh.vertices.size());
    return distances;
}

TEST_CASE("in a plane it is the straight distance, whatever the triangles") {
    for (const double shake : {0.0, 0.1, 0.2}) {
        const Mesh mesh = sheet(23, 17, 0.01, shake);
        for (const std::vector<int>& sources : {std::vector<int>{0}, {200}, {390, 17, 17, 201}}) {
            const auto distances = mesh.geodesic().from(sources);
            for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
                double straight = infinity;
                for (const auto s : sources)
                    straight = std::min(straight, length(mesh.vertices[v] - mesh.vertices[std::size_t(s)]));
                CHECK(distances[v] == doctest::Approx(straight).epsilon(1e-12));
            }
        }
    }
}

TEST_CASE("on a sphere it is the angle, to the order of the triangles' size squared") {
    double coarse = 0;
    for (const int splits : {3, 4, 5}) {
        const Mesh mesh = sphere(splits);
        std::vector<int> cap;
        constexpr double opening = 0.5;
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v)
            if (mesh.vertices[v].z > std::cos(opening)) cap.push_back(static_cast<int>(v));
        const auto from_pole = mesh.geodesic().from(std::vector<int>{2}), from_cap = mesh.geodesic().from(cap);
        double error = 0;
        for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
            if (v == 2) continue;
            const double angle = std::acos(std::clamp(mesh.vertices[v].z, -1.0, 1.0));
            error = std::max(error, std::abs(from_pole[v] / angle - 1));
            if (splits == 5 && angle > opening) {
                CHECK(from_cap[v] < angle - opening + 0.07); // the cap's rim is uneven by up to an edge's length
                CHECK(from_cap[v] > (angle - opening) * 0.99);
            }
        }
        if (coarse > 0) CHECK(error < 0.4 * coarse);
        coarse = error;
    }
    CHECK(coarse < 2e-3);
}

TEST_CASE("a folded strip is as long as before it was folded") {
    // A zigzag whose layers are 1 mm apart in space and 20 cm apart along the strip.
    const double layer = 0.1, gap = 0.001;
    const auto fold = [&](double x, double y) {
        const double n = std::floor(x / (layer + gap)), within = x - n * (layer + gap);
        const bool back = static_cast<int>(n) % 2;
        const double along = std::min(within, layer), up = std::max(within - layer, 0.0);
        return vec3<double>(back ? layer - along : along, n * gap + up, y);
    };
    Mesh straight, folded;
    for (auto* mesh : {&straight, &folded})
        for (int n = 0; n <= 60; ++n)
            for (int j = 0; j <= 5; ++j) {
                const double x = (n / 20) * (layer + gap) + n % 20 * layer / 19;
                mesh->vertices.push_back(mesh == &straight ? vec3<double>(x, 0, 0.02 * j) : fold(x, 0.02 * j));
            }
    for (int n = 0; n < 60; ++n)
        for (int j = 0; j < 5; ++j) {
            const int a = 6 * n + j;
            for (auto* mesh : {&straight, &folded})
                mesh->faces.insert(mesh->faces.end(), {{a, a + 6, a + 7}, {a, a + 7, a + 1}});
        }
    const std::vector<int> start{2};
    const auto before = straight.geodesic().from(start), distances = folded.geodesic().from(start);
    double leak = infinity;
    for (std::size_t v = 0; v < before.size(); ++v) {
        CHECK(before[v] == doctest::Approx(length(straight.vertices[v] - straight.vertices[2])));
        CHECK(distances[v] == doctest::Approx(before[v]).epsilon(1e-9));
        if (distances[v] > 0.19) leak = std::min(leak, length(folded.vertices[v] - folded.vertices[2]));
    }
    CHECK(leak < 0.01); // points that are 19 cm away along the strip and less than 1 cm away in space
}

TEST_CASE("cones: sharp tips are walked round, saddles are walked through") {
    // A fan of equal triangles whose apex angles add up to theta: two points of the rim, phi apart, are a chord
    // apart if phi < pi, and two radii otherwise.
    const int n = 24;
    for (const double lift : {0.9, 0.5, 0.0, -0.6, -1.4}) { // above 0: a cone; below: a ruffled saddle
        Mesh mesh{{vec3<double>(0)}, {}};
        for (int k = 0; k < n; ++k) {
            const double angle = 2 * std::numbers::pi * k / n;
            const double z = lift > 0 || k % 2 ? lift : -lift;
            mesh.vertices.push_back(normalize(vec3<double>(std::cos(angle), std::sin(angle), z)));
            mesh.faces.push_back({0, k + 1, (k + 1) % n + 1});
        }
        const double step = std::acos(dot(mesh.vertices[1], mesh.vertices[2])), theta = n * step;
        const auto distances = mesh.geodesic().from(std::vector<int>{1});
        CHECK((theta > 2 * std::numbers::pi - 1e-9) == (lift <= 0));
        for (int k = 0; k < n; ++k) {
            const double phi = std::min(k, n - k) * step;
            const double expected = phi < std::numbers::pi ? 2 * std::sin(phi / 2) : 2;
            CHECK(distances[static_cast<std::size_t>(k) + 1] == doctest::Approx(expected));
        }
        CHECK(distances[0] == doctest::Approx(1));
    }
}

TEST_CASE("paths bend at the corners of a border") {
    Mesh mesh = sheet(21, 21, 0.05, 0.0); // a square of 1 m, without its upper right quarter
    std::erase_if(mesh.faces, [&](const auto& f) {
        return std::all_of(f.begin(), f.end(), [&](int v) {
            const auto& p = mesh.vertices[static_cast<std::size_t>(v)];
            return p.x > 0.5 - 1e-9 && p.y > 0.5 - 1e-9;
        });
    });
    const int start = 20; // (1, 0)
    const auto distances = mesh.geodesic().from(std::vector<int>{start});
    const vec3<double> corner(0.5, 0.5, 0), from(1, 0, 0);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        const auto& p = mesh.vertices[v];
        if (p.x > 0.5 + 1e-9 && p.y > 0.5 + 1e-9) {
            CHECK(distances[v] == infinity); // has no triangle
        } else {
            const bool seen = p.y <= 0.5 + 1e-9 || p.x + p.y <= 1 + 1e-9; // not behind the corner
            const double round = length(corner - from) + length(p - corner);
            CHECK(distances[v] == doctest::Approx(seen ? length(p - from) : round));
        }
    }
}

TEST_CASE("three sheets at one edge, triangles turned either way") {
    Mesh mesh;
    const int n = 5;
    for (int j = 0; j < n; ++j) mesh.vertices.push_back({0, 0.1 * j, 0}); // the common edge
    for (int page = 0; page < 3; ++page) {
        const double angle = 2.0 * page;
        const int first = static_cast<int>(mesh.vertices.size());
        for (int j = 0; j < n; ++j) mesh.vertices.push_back({0.3 * std::cos(angle), 0.1 * j, 0.3 * std::sin(angle)});
        for (int j = 0; j + 1 < n; ++j) {
            std::array<int, 3> lower = {j, j + 1, first + j}, upper = {j + 1, first + j + 1, first + j};
            if ((page + j) % 2) std::swap(lower[0], lower[2]), std::swap(upper[1], upper[2]);
            mesh.faces.push_back(lower), mesh.faces.push_back(upper);
        }
    }
    const auto distances = mesh.geodesic().from(std::vector<int>{n}); // the lower corner of the first page
    for (int j = 0; j < n; ++j) {
        CHECK(distances[static_cast<std::size_t>(n + j)] == doctest::Approx(0.1 * j));
        CHECK(distances[static_cast<std::size_t>(j)] == doctest::Approx(std::hypot(0.3, 0.1 * j)));
        for (int page = 1; page < 3; ++page)
            CHECK(distances[static_cast<std::size_t>((1 + page) * n + j)] == doctest::Approx(std::hypot(0.6, 0.1 * j)));
    }
}

TEST_CASE("a crumpled surface agrees with a finely subdivided graph, and with itself the other way") {
    test::Rng rng(5);
    const auto crumple = [&](double x, double y) { return vec3<double>(x, y, rng.uniform(-0.006, 0.006)); };
    const Mesh mesh = sheet(18, 18, 0.01, 0.4, crumple);
    const auto geodesic = mesh.geodesic();
    for (const std::vector<int>& sources : {std::vector<int>{7}, {100, 250, 251}}) {
        const auto exact = geodesic.from(sources), close = subdivided_dijkstra(mesh, sources, 12, infinity);
        double mean = 0, shortest = 0;
        for (std::size_t v = 0; v < exact.size(); ++v) {
            shortest = std::min(shortest, close[v] - exact[v]);
            if (exact[v] > 0) mean += (close[v] / exact[v] - 1) / static_cast<double>(exact.size());
        }
        CHECK(shortest > -1e-12); // paths of the graph lie on the surface, so none is shorter
        CHECK(mean < 2e-3);
    }
    const auto there = geodesic.from(std::vector<int>{7}), back = geodesic.from(std::vector<int>{300});
    CHECK(there[300] == doctest::Approx(back[7]).epsilon(1e-12));
    Mesh turned = mesh; // distances do not depend on the order of corners, faces and windings
    std::reverse(turned.faces.begin(), turned.faces.end());
    for (std::size_t f = 0; f < turned.faces.size(); ++f) {
        std::rotate(turned.faces[f].begin(), turned.faces[f].begin() + f % 3, turned.faces[f].end());
        if (f % 2) std::swap(turned.faces[f][0], turned.faces[f][1]);
    }
    const auto again = turned.geodesic().from(std::vector<int>{7});
    for (std::size_t v = 0; v < again.size(); ++v) CHECK(again[v] == doctest::Approx(there[v]).epsilon(1e-12));
}

TEST_CASE("apart is infinitely far; reach cuts off and changes nothing nearer") {
    Mesh mesh = sheet(10, 10, 0.01, 0.2);
    const Mesh other = sheet(4, 4, 0.01, 0.2);
    for (const auto& p : other.vertices) mesh.vertices.push_back(p + vec3<double>(0, 0, 1e-4)); // nearly touching
    for (const auto& f : other.faces) mesh.faces.push_back({f[0] + 100, f[1] + 100, f[2] + 100});
    mesh.vertices.push_back(vec3<double>(0)); // without a triangle
    const auto geodesic = mesh.geodesic();
    CHECK(geodesic.vertex_count() == 117);
    const auto first = geodesic.from(std::vector<int>{0});
    for (std::size_t v = 0; v < 117; ++v) CHECK(std::isfinite(first[v]) == (v < 100));
    const auto both = geodesic.from(std::vector<int>{0, 100, 116});
    CHECK(std::isfinite(both[107]));
    CHECK(both[116] == 0);
    for (const double d : geodesic.from({})) CHECK(d == infinity);
    for (const double reach : {0.0, 0.005, 0.03, 0.08}) {
        const auto near = geodesic.from(std::vector<int>{0}, reach);
        for (std::size_t v = 0; v < 117; ++v) CHECK(near[v] == (first[v] <= reach ? first[v] : infinity));
    }
}

TEST_CASE("triangles without area do no harm") {
    Mesh mesh = sheet(8, 8, 0.01, 0.0);
    const int copy = static_cast<int>(mesh.vertices.size());
    mesh.vertices.push_back(mesh.vertices[27]);
    mesh.faces.push_back({27, copy, 28});     // two corners coincide
    mesh.faces.push_back({26, 27, 28});       // three corners on a line
    mesh.faces.push_back({copy, copy, 63});   // a vertex twice, so it joins nothing
    const auto distances = mesh.geodesic().from(std::vector<int>{0});
    for (std::size_t v = 0; v < distances.size(); ++v)
        CHECK(distances[v] == doctest::Approx(length(mesh.vertices[v])));
}

TEST_CASE("sizes and errors") {
    CHECK(GeodesicDistance(Span<const vec3<double>>(), Span<const std::array<int, 3>>()).from({}).empty());
    const std::vector<vec3<double>> one{vec3<double>(0)};
    CHECK(GeodesicDistance(one, Span<const std::array<int, 3>>()).from(std::vector<int>{0})[0] == 0);
    Mesh mesh = sheet(3, 3, 0.01, 0.0);
    const auto geodesic = mesh.geodesic();
    CHECK_THROWS_AS((void)geodesic.from(std::vector<int>{9}), ValueError);
    CHECK_THROWS_AS((void)geodesic.from(std::vector<int>{-1}), ValueError);
    CHECK_THROWS_AS((void)geodesic.from(std::vector<int>{0}, -1), ValueError);
    CHECK_THROWS_AS((void)geodesic.from(std::vector<int>{0}, std::numeric_limits<double>::quiet_NaN()), ValueError);
    Mesh broken = mesh;
    broken.vertices[4].y = infinity;
    CHECK_THROWS_AS((void)broken.geodesic(), ValueError);
    broken = mesh;
    broken.faces[2][1] = 9;
    CHECK_THROWS_AS((void)broken.geodesic(), ValueError);
}

TEST_CASE("a real body: within 2 % of a finely subdivided graph from face and hands") {
    const auto path = test::shared_data("body/cc0_body_x.npz");
    if (test::skip_without({path})) return;
    const BodyModel body = load_body_model(path);
    const Mesh mesh{body.v_template, body.faces};
    std::vector<int> sources = body.face_vertices;
    for (const auto* hand : {&body.left_hand_vertices, &body.right_hand_vertices})
        sources.insert(sources.end(), hand->begin(), hand->end());
    const auto exact = mesh.geodesic().from(sources, 0.1), close = subdivided_dijkstra(mesh, sources, 8, 0.1);
    double mean = 0, shortest = 0;
    std::size_t count = 0;
    for (std::size_t v = 0; v < exact.size(); ++v) {
        if (!(exact[v] > 0.008 && exact[v] < 0.09)) continue;
        mean += close[v] / exact[v] - 1, ++count;
        shortest = std::min(shortest, close[v] - exact[v]);
    }
    mean /= static_cast<double>(count);
    MESSAGE("the graph is longer by " << 100 * mean << " % in the mean of " << count << " vertices");
    CHECK(count > 1000);
    CHECK(mean < 0.02);
    CHECK(shortest > -1e-12);
}

} // namespace
} // namespace gsh
