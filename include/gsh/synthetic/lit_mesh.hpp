// SPDX-License-Identifier: Apache-2.0
/// @file  Shading of a posed mesh by a lamp and a sky, ray by ray.
#pragma once

#include <gsh/body/mesh.hpp>
#include <gsh/synthetic/actor_texture.hpp>
#include <gsh/synthetic/ray_scene.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// A disc lamp, and a hemisphere of sky over a dim floor, in linear light. A white surface that faces the lamp from the
/// origin reflects the radiance `lamp`; one that is lit by the sky alone reflects `sky`.
struct StudioLight {
    vec3<float> position{1.1f, 2.5f, 2.3f}; ///< centre of the lamp, metres
    float radius = 0.35f;                   ///< metres; a larger lamp casts softer shadows
    vec3<float> lamp{1.02f, 0.97f, 0.88f};
    vec3<float> sky{0.27f, 0.30f, 0.35f};
    vec3<float> floor{0.13f, 0.11f, 0.09f};
};

/// A small lamp and a dark room: shadows have sharp edges.
[[nodiscard]] inline StudioLight hard_light() {
    return {.radius = 0.05f,
            .lamp = {1.25f, 1.19f, 1.08f},
            .sky = {0.12f, 0.13f, 0.15f},
            .floor = {0.06f, 0.05f, 0.04f}};
}
/// A large lamp and a bright sky: shadows have no edges.
[[nodiscard]] inline StudioLight soft_light() {
    return {.radius = 1.2f,
            .lamp = {0.42f, 0.40f, 0.36f},
            .sky = {0.62f, 0.69f, 0.80f},
            .floor = {0.30f, 0.26f, 0.21f}};
}

/// Points in [0, 1)² that cover the square evenly for successive `index`, shifted by `key`: Roberts' R2 sequence.
[[nodiscard]] inline std::array<float, 2> even_sample(std::uint64_t key, std::uint64_t index) {
    const auto wrap = [](double x) { return static_cast<float>(std::min(x - std::floor(x), 0.999999)); };
    const double i = static_cast<double>(index);
    return {wrap(random_uniform(key, 0) + 0.7548776662466927 * i),
            wrap(random_uniform(key, 1) + 0.5698402909980532 * i)};
}

/// A mesh for ray casting, lit by a lamp that casts soft shadows of the mesh onto itself.
class LitMesh {
public:
    /// The radiance along a ray; not found if the ray misses the mesh.
    struct Sight {
        bool found = false;
        vec3<float> radiance{0.0f};
    };

    /// vertices and canonical [V] correspond; colours are evaluated at canonical positions. Keeps references to
    /// canonical and faces.
    LitMesh(Span<const vec3<double>> vertices, Span<const vec3<double>> canonical, Span<const std::array<int, 3>> faces,
            const StudioLight& light)
        : vertices_(vertices.begin(), vertices.end()), canonical_(canonical), faces_(faces), light_(light),
          scene_(vertices_, faces) {
        check_size("LitMesh", "canonical", canonical.size(), vertices.size());
        for (const auto& normal : vertex_normals(vertices, faces)) normals_.emplace_back(normal);
    }

    /// Traces one camera ray. `key` and `index` select the samples of the lamp and the sky. `color` is called with the
    /// canonical position. If it takes two arguments, it also receives the face, so that several people in one mesh can
    /// have their own colours.
    template <class Color>
    [[nodiscard]] Sight look(const vec3<float>& eye, const vec3<float>& direction, const Color& color,
                             std::uint64_t key, std::uint64_t index) const {
        const RayHit hit = scene_.closest(eye, direction);
        if (!hit.found) return {};
        const auto& f = faces_[hit.face];
        const auto between = [&](const auto& values) {
            using Value = std::decay_t<decltype(values[0])>;
            using S = typename Value::value_type;
            const S u = S(hit.u), v = S(hit.v);
            return values[corner(f, 0)] * (S(1) - u - v) + values[corner(f, 1)] * u + values[corner(f, 2)] * v;
        };
        const vec3<float> position = between(vertices_), to_eye = normalize(eye - position);
        vec3<float> normal = normalize(between(normals_));
        const float facing = dot(normal, to_eye);
        if (facing < 0) normal = normalize(normal - to_eye * (facing * 1.01f)); // at silhouettes of a faceted mesh
        const vec3<double> canonical = between(canonical_);
        const SurfaceColor surface = [&] {
            if constexpr (std::is_invocable_v<const Color&, vec3<double>, unsigned>) return color(canonical, hit.face);
            else return color(canonical);
        }();
        const vec3<float> albedo(surface.albedo);

        const vec3<float> to_lamp = lamp_direction(position, even_sample(key, index));
        vec3<float> radiance =
            albedo * (light_.floor * 0.25f + sky_light(position, normal, even_sample(key ^ 0x51u, index)));
        const float lambert = dot(normal, normalize(to_lamp));
        if (lambert > 0 && sees(position, normal, to_lamp, 1)) {
            const vec3<float> half_way = normalize(normalize(to_lamp) + to_eye);
            const float falloff = dot(light_.position, light_.position) / dot(to_lamp, to_lamp);
            const float highlight =
                static_cast<float>(surface.gloss) * 0.5f * std::pow(std::max(0.0f, dot(normal, half_way)), 40.0f);
            radiance += light_.lamp * (falloff * lambert) * (albedo + vec3<float>(highlight));
        }
        return {true, radiance};
    }

    /// Visible fraction of the lamp, in [0, 1], from a point of the surface, over `samples` rays.
    [[nodiscard]] float lamp_visibility(std::size_t face, const vec3<float>& barycentric, int samples) const {
        const auto& f = faces_[face];
        const auto between = [&](const auto& values) {
            return values[corner(f, 0)] * barycentric.x + values[corner(f, 1)] * barycentric.y +
                   values[corner(f, 2)] * barycentric.z;
        };
        const vec3<float> position = between(vertices_), normal = normalize(between(normals_));
        int seen = 0;
        for (int k = 0; k < samples; ++k) {
            const vec3<float> to_lamp = lamp_direction(position, even_sample(7, static_cast<std::uint64_t>(k)));
            seen += dot(normal, to_lamp) > 0 && sees(position, normal, to_lamp, 1);
        }
        return static_cast<float>(seen) / static_cast<float>(samples);
    }

private:
    static std::size_t corner(const std::array<int, 3>& f, std::size_t k) { return static_cast<std::size_t>(f[k]); }

    /// The direction to a point of the lamp's disc, which faces the surface.
    [[nodiscard]] vec3<float> lamp_direction(const vec3<float>& from, const std::array<float, 2>& sample) const {
        const vec3<float> axis = light_.position - from;
        const auto [u, v] = frame(normalize(axis));
        const float r = light_.radius * std::sqrt(sample[0]), angle = 2 * std::numbers::pi_v<float> * sample[1];
        return axis + u * (r * std::cos(angle)) + v * (r * std::sin(angle));
    }

    /// One cosine-weighted ray: the radiance of sky or floor, or zero if the mesh occludes it.
    [[nodiscard]] vec3<float> sky_light(const vec3<float>& position, const vec3<float>& normal,
                                        const std::array<float, 2>& sample) const {
        const auto [u, v] = frame(normal);
        const float r = std::sqrt(sample[0]), angle = 2 * std::numbers::pi_v<float> * sample[1];
        const vec3<float> d = u * (r * std::cos(angle)) + v * (r * std::sin(angle)) + normal * std::sqrt(1 - sample[0]);
        if (!sees(position, normal, d, 10)) return vec3<float>(0.0f);
        return light_.floor + (light_.sky - light_.floor) * std::clamp(0.5f + 1.5f * d.y, 0.0f, 1.0f);
    }

    [[nodiscard]] bool sees(const vec3<float>& position, const vec3<float>& normal, const vec3<float>& direction,
                            float far) const {
        return !scene_.occluded(position + normal * 5e-4f, direction, 1e-4f, far);
    }

    /// Two unit vectors that form an orthonormal basis with n.
    [[nodiscard]] static std::pair<vec3<float>, vec3<float>> frame(const vec3<float>& n) {
        const vec3<float> u = normalize(cross(std::abs(n.x) < 0.7f ? vec3<float>(1, 0, 0) : vec3<float>(0, 1, 0), n));
        return {u, cross(n, u)};
    }

    std::vector<vec3<float>> vertices_, normals_;
    Span<const vec3<double>> canonical_;
    Span<const std::array<int, 3>> faces_;
    StudioLight light_;
    RayScene scene_;
};

} // namespace gsh
