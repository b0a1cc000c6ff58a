// SPDX-License-Identifier: Apache-2.0
/// @file  A few Gaussians on random triangles under a random light, for tests of light.
#pragma once

#include "support/gradient.hpp"

#include <gsh/light/lit_splats.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::test {

/// Vertices within a metre of the origin, Gaussians on random triangles of them, points two to four metres away.
template <class T>
struct LitScene {
    std::size_t N, V;
    std::vector<vec3<T>> points, directions, vertices, base, normals, center;
    std::vector<T> log_intensities, gloss, visibility;
    std::vector<std::array<int, 3>> triangles;
    std::vector<vec3<double>> barycentric;

    LitScene(std::size_t count, std::size_t P, std::size_t D, bool glossy, std::uint64_t seed,
             std::size_t vertex_count = 50)
        : N(count), V(vertex_count) {
        Rng rng(seed);
        const auto number = [&](double low, double high) { return static_cast<T>(rng.uniform(low, high)); };
        for (std::size_t k = 0; k < P; ++k) points.push_back(vec3<T>(normalize(rng.vec()) * rng.uniform(2, 4)));
        for (std::size_t k = 0; k < D; ++k) directions.push_back(vec3<T>(normalize(rng.vec())));
        for (std::size_t k = 0; k < P + D; ++k) log_intensities.push_back(number(-1, 1));
        if (glossy) gloss = {number(-1, 0), number(1, 3)};
        for (std::size_t v = 0; v < V; ++v) {
            vertices.push_back(vec3<T>(rng.vec()));
            normals.push_back(vec3<T>(normalize(rng.vec())));
        }
        for (std::size_t n = 0; n < V * (P + D); ++n) visibility.push_back(number(0, 1));
        for (std::size_t i = 0; i < N; ++i) {
            base.push_back(vec3<T>(rng.vec(0.1, 0.9)));
            const auto vertex = [&] { return static_cast<int>(rng.below(V)); };
            const int a = vertex(), b = vertex(), c = vertex();
            triangles.push_back({a, b, c});
            const vec3<double> w = rng.vec(0.1, 1);
            barycentric.push_back(w * (1 / (w.x + w.y + w.z)));
        }
        center.push_back(vec3<T>(rng.vec(2, 3)));
    }

    LightView<const T> light() const { return {points, directions, log_intensities, gloss}; }
    LitSplatsInput<T> input() const { return {light(), vertices, normals, visibility, base, center[0]}; }
    LitSplatsGradient<T> view() {
        return {{points, directions, log_intensities, gloss}, vertices, normals, base, center};
    }
    void clear() {
        for (auto* values : {&points, &vertices, &base, &normals, &center})
            std::fill(values->begin(), values->end(), vec3<T>(T(0)));
        for (auto* values : {&log_intensities, &gloss}) std::fill(values->begin(), values->end(), T(0));
    }
    template <class B>
    LitSplats<B, T> splats(B& backend) const {
        return {backend, V, triangles, barycentric};
    }
};

template <class T>
std::vector<vec3<T>> color_gradient(std::size_t count, std::uint64_t seed) {
    Rng rng(seed);
    std::vector<vec3<T>> values;
    for (std::size_t i = 0; i < count; ++i) values.push_back(vec3<T>(rng.vec()));
    return values;
}

} // namespace gsh::test
