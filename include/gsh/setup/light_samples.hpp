// SPDX-License-Identifier: Apache-2.0
/// @file  Colours of mesh vertices in photographs, with the light that reaches them, for the estimate of a light.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/mesh.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/light.hpp>
#include <gsh/light/light_buffers.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/photo/photo.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// One person whose mesh is lit, and casts shadows.
struct LitPerson {
    const RigData* rig = nullptr;
    const Motion* motion = nullptr;
};

namespace detail {

/// Colours of mesh vertices in photographs, and the irradiance that each light of unit intensity gives them.
struct LightSamples {
    struct Color {
        std::uint32_t row; ///< of the irradiances
        vec3<float> linear;
        float weight; ///< squared slope of the sRGB curve, so that errors count as they do on a display
    };
    std::vector<Color> colors;
    std::vector<vec3<float>> positions, normals; // [rows], a row is a vertex in a frame
    std::vector<std::uint32_t> vertex_of;        // [rows]
    std::vector<float> visibility;               // [rows, lights]
    std::size_t vertices = 0;

    [[nodiscard]] Eigen::MatrixXf irradiances(const LightData& light) const {
        const auto rows = static_cast<Eigen::Index>(positions.size());
        const std::size_t lights = light.size(), P = light.points.size();
        Eigen::MatrixXf G(static_cast<Eigen::Index>(lights), rows);
        for (std::size_t r = 0; r < positions.size(); ++r)
            for (std::size_t k = 0; k < lights; ++k) {
                vec3<float> l(k < P ? vec3<float>(light.points[k]) - positions[r]
                                    : vec3<float>(light.directions[k - P]));
                const float squared = dot(l, l);
                G(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(r)) =
                    visibility[r * lights + k] * std::max(0.0f, dot(normals[r], l)) / (squared * std::sqrt(squared));
            }
        return G;
    }
};

/// The meshes of all people in one frame, and the vertices of them that are sampled.
template <Backend B>
class PosedPeople {
public:
    /// At most `most_vertices` of each person are sampled, chosen by `seed`. People farther than `reach` from `center`
    /// in a frame cast no shadow there, because a depth map covers all casters and its texels would become too large.
    PosedPeople(B& backend, Span<const LitPerson> people, std::size_t most_vertices, std::uint64_t seed,
                const vec3<double>& center, double reach)
        : center_(center), reach_(reach), backend_(&backend), people_(people), maps_(backend), casters_(people.size()) {
        for (std::size_t p = 0; p < people.size(); ++p) {
            const BodyModel& body = people[p].rig->body;
            check_value(!body.faces.empty(), "estimate_light", "a body has no triangles, expected a mesh");
            std::vector<std::uint32_t> order =
                shuffled_indices(static_cast<std::uint32_t>(body.vertex_count()), mix_bits(seed + p));
            order.resize(std::min<std::size_t>(order.size(), most_vertices));
            chosen_.push_back(std::move(order));
            const std::vector<vec3<std::uint32_t>> triangles = triangle_indices(body.faces);
            assign(backend, triangles, casters_[p].triangles);
        }
    }

    [[nodiscard]] std::size_t sample_count() const { return total(chosen_); }
    [[nodiscard]] const std::vector<vec3<float>>& positions() const { return positions_; }
    [[nodiscard]] const std::vector<vec3<float>>& normals() const { return normals_; }

    void pose(std::size_t frame) {
        positions_.clear(), normals_.clear();
        for (std::size_t p = 0; p < people_.size(); ++p) {
            const auto& [rig, motion] = people_[p];
            const std::vector<double>& betas = motion->betas.empty() ? rig->betas : motion->betas;
            const std::vector<vec3<double>> vertices =
                pose_body(rig->body, motion->pose_at(frame), motion->transl[frame], betas,
                          motion->expression_at(frame), rig->joints)
                    .vertices;
            const std::vector<vec3<double>> normals = vertex_normals(vertices, rig->body.faces);
            std::vector<vec3<float>> all;
            for (const vec3<double>& vertex : vertices) all.push_back(vec3<float>(vertex));
            casters_[p].present = length(motion->transl[frame] + rig->joints[0] - center_) < reach_;
            assign(*backend_, all, casters_[p].vertices);
            for (const std::uint32_t v : chosen_[p])
                positions_.push_back(all[v]), normals_.push_back(vec3<float>(normals[v]));
        }
        assign(*backend_, positions_, receivers_);
        assign(*backend_, normals_, receiver_normals_);
    }

    /// [samples, lights] on the host.
    [[nodiscard]] std::vector<float> visibility(const LightData& light) {
        light_.upload(*backend_, light);
        std::vector<ShadowCaster<float>> casters;
        for (const Caster& caster : casters_)
            if (caster.present) casters.push_back({caster.vertices, caster.triangles});
        visibility_.resize(positions_.size() * light.size());
        if (!light.shadows) return std::vector<float>(visibility_.size(), 1.0f);
        maps_.forward(casters, light_.view(), receivers_, receiver_normals_, visibility_, cache_);
        return downloaded(*backend_, Span<const float>(visibility_));
    }

private:
    template <class T>
    using Buffer = typename B::template Buffer<T>;
    struct Caster {
        Buffer<vec3<float>> vertices;
        Buffer<vec3<std::uint32_t>> triangles;
        bool present = true;
    };
    static std::size_t total(const std::vector<std::vector<std::uint32_t>>& lists) {
        std::size_t sum = 0;
        for (const auto& list : lists) sum += list.size();
        return sum;
    }

    vec3<double> center_;
    double reach_;
    B* backend_;
    Span<const LitPerson> people_;
    ShadowMaps<B, float> maps_;
    typename ShadowMaps<B, float>::Cache cache_;
    std::vector<Caster> casters_;
    std::vector<std::vector<std::uint32_t>> chosen_; // vertices of each person
    std::vector<vec3<float>> positions_, normals_;   // of the samples, on the host
    LightBuffers<B, float> light_;
    Buffer<vec3<float>> receivers_, receiver_normals_;
    Buffer<float> visibility_;
};

/// Alpha from which a pixel counts as the person's alone. Masks of JPEG files and of matting do not reach 255
/// everywhere inside.
inline constexpr std::uint8_t solid_alpha = 250;

/// The colour of a photograph at a pixel position, bilinear in linear light. False near the mask's edge, where the
/// nearest pixels in any direction are not the person's, and where a channel is overexposed.
[[nodiscard]] inline bool read_color(const Photo& photo, const vec2<double>& pixel, vec3<float>& linear) {
    constexpr int margin = 2;
    const int x = static_cast<int>(std::floor(pixel.x - 0.5)), y = static_cast<int>(std::floor(pixel.y - 0.5));
    const int width = photo.camera.width, height = photo.camera.height;
    if (x < margin || y < margin || x + 1 + margin >= width || y + 1 + margin >= height) return false;
    const auto at = [&](int column, int row) { return photo.pixel(column, row); };
    for (const int dy : {-margin, 0, 1, 1 + margin})
        for (const int dx : {-margin, 0, 1, 1 + margin})
            if (at(x + dx, y + dy)[3] < solid_alpha) return false;
    const double u = pixel.x - 0.5 - x, v = pixel.y - 0.5 - y;
    for (int c = 0; c < 3; ++c) {
        const auto value = [&](int dx, int dy) { return srgb_to_linear(at(x + dx, y + dy)[c] / 255.0); };
        const double mixed = (value(0, 0) * (1 - u) + value(1, 0) * u) * (1 - v) +
                             (value(0, 1) * (1 - u) + value(1, 1) * u) * v;
        if (mixed > 0.95) return false;
        linear[c] = static_cast<float>(mixed);
    }
    return true;
}

/// Reads colours of the samples in `frames`, from at most `most_photos` photographs of each, and their visibilities
/// from a light.
template <Backend B>
[[nodiscard]] LightSamples read_samples(PosedPeople<B>& people, Span<const Photo> photos,
                                        const std::vector<std::size_t>& frames, const LightData& light,
                                        std::size_t most_photos) {
    LightSamples samples;
    samples.vertices = people.sample_count();
    const std::size_t S = samples.vertices, K = light.size();
    for (const std::size_t frame : frames) {
        std::vector<const Photo*> views;
        for (const Photo& photo : photos)
            if (photo.frame == frame) views.push_back(&photo);
        if (views.size() > most_photos) { // evenly spread, beginning elsewhere in each frame
            std::vector<const Photo*> some;
            for (std::size_t k = 0; k < most_photos; ++k)
                some.push_back(views[(frame + k * views.size() / most_photos) % views.size()]);
            views = std::move(some);
        }
        std::vector<HeldPhoto> held;
        for (const Photo* photo : views) held.emplace_back(*photo);
        people.pose(frame);
        LightData eyes; // a camera sees what a light at its centre would reach
        for (const Photo* photo : views) eyes.points.push_back(photo->camera.center());
        eyes.log_intensities.assign(eyes.size(), 0);
        const std::vector<float> seen = people.visibility(eyes), lit = people.visibility(light);
        for (std::size_t s = 0; s < S; ++s) {
            const vec3<double> position(people.positions()[s]), normal(people.normals()[s]);
            std::uint32_t row = UINT32_MAX; // made when the first colour of the sample is read
            for (std::size_t k = 0; k < views.size(); ++k) {
                const Camera<double>& camera = views[k]->camera;
                const vec3<double> to_eye = eyes.points[k] - position, local = to_camera(camera, position);
                vec3<float> linear;
                if (seen[s * views.size() + k] < 0.95f || dot(normal, to_eye) < 0.3 * length(to_eye) || local.z <= 0 ||
                    !read_color(*held[k], to_pixel(camera, local), linear))
                    continue;
                if (row == UINT32_MAX) {
                    row = static_cast<std::uint32_t>(samples.positions.size());
                    samples.positions.push_back(people.positions()[s]);
                    samples.normals.push_back(people.normals()[s]);
                    samples.vertex_of.push_back(static_cast<std::uint32_t>(s));
                    samples.visibility.insert(samples.visibility.end(),
                                              lit.begin() + static_cast<std::ptrdiff_t>(s * K),
                                              lit.begin() + static_cast<std::ptrdiff_t>((s + 1) * K));
                }
                double slope = 0;
                linear_to_srgb_backward(std::max(0.01, static_cast<double>(linear.x + linear.y + linear.z) / 3), 1.0,
                                        slope);
                samples.colors.push_back({row, linear, static_cast<float>(slope * slope)});
            }
        }
    }
    return samples;
}

} // namespace detail

} // namespace gsh
