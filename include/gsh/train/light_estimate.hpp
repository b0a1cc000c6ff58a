// SPDX-License-Identifier: Apache-2.0
/// @file  Estimates the light of a capture from its photographs and the posed mesh, before an avatar is trained.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/color.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/nonnegative.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/train/light_samples.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// Settings of a light estimate.
struct LightEstimateParams {
    std::size_t points = 4, directions = 12; ///< of the result
    std::size_t candidates = 128;            ///< places among which the points are found, on a sphere about the people
    double distance = 4;                     ///< metres; its radius
    std::size_t frames = 24;                 ///< at most this many are read, evenly spread over the photographed ones
    std::size_t photos_per_frame = 4;        ///< at most
    std::size_t vertices = 3000;             ///< at most, of each person
    bool shadows = true;                     ///< LightData::shadows of the result
    int rounds = 12;                         ///< of light and albedo in turns
    std::uint64_t seed = 0;
};

/// The light of a capture, and how well it explains the samples.
struct LightEstimate {
    LightData light;
    std::size_t samples = 0; ///< colours of mesh vertices that were read from photographs
    double psnr = 0;         ///< of these colours in sRGB, albedo times light against the photographs
    double psnr_even = 0;    ///< the same with one colour per vertex and no light
};

namespace detail {

/// Albedos and intensities in turns, each by weighted least squares. Returns the intensities; the mean irradiance of
/// all colours is 1. psnr receives the fit's. T is the type of the sums; a template, so that Eigen's products are
/// compiled only where a light is estimated.
template <std::floating_point T>
[[nodiscard]] Eigen::VectorX<T> fit_intensities(const LightSamples& samples, const Eigen::MatrixXf& G, int rounds,
                                                T& psnr) {
    const Eigen::Index lights = G.rows();
    Eigen::VectorX<T> x = Eigen::VectorX<T>::Ones(lights);
    std::vector<vec3<double>> albedo(samples.vertices), numerator(samples.vertices);
    std::vector<double> denominator(samples.vertices);
    Eigen::VectorXf E;
    for (int round = 0;; ++round) {
        E = G.transpose() * x.template cast<float>();
        double mean = 0;
        for (const auto& color : samples.colors) mean += E[color.row];
        mean /= static_cast<double>(samples.colors.size());
        check_value(mean > 0, "estimate_light", "no light reaches any vertex that a photograph shows");
        x /= mean, E /= static_cast<float>(mean);
        std::fill(numerator.begin(), numerator.end(), vec3<double>(0));
        std::fill(denominator.begin(), denominator.end(), 1e-12);
        for (const auto& color : samples.colors) {
            const double e = E[color.row], w = color.weight;
            numerator[color.vertex] += vec3<double>(color.linear) * (w * e);
            denominator[color.vertex] += w * e * e;
        }
        for (std::size_t v = 0; v < samples.vertices; ++v) albedo[v] = numerator[v] * (1 / denominator[v]);
        if (round == rounds) break;

        const auto rows = static_cast<std::size_t>(G.cols());
        Eigen::VectorXf alpha = Eigen::VectorXf::Zero(G.cols()), beta = alpha;
        for (const auto& color : samples.colors) {
            const vec3<double>& a = albedo[color.vertex];
            alpha[color.row] += static_cast<float>(color.weight * dot(a, a));
            beta[color.row] += static_cast<float>(color.weight * dot(a, vec3<double>(color.linear)));
        }
        Eigen::MatrixX<T> A = Eigen::MatrixX<T>::Zero(lights, lights);
        constexpr std::size_t block = 4096; // sums of blocks in float, then in double
        for (std::size_t first = 0; first < rows; first += block) {
            const auto begin = static_cast<Eigen::Index>(first);
            const auto count = static_cast<Eigen::Index>(std::min(block, rows - first));
            const Eigen::MatrixXf scaled =
                G.middleCols(begin, count) * alpha.segment(begin, count).cwiseSqrt().asDiagonal();
            A += (scaled * scaled.transpose()).template cast<T>();
        }
        A.diagonal().array() += 1e-6 * A.diagonal().mean() + 1e-12;
        Eigen::VectorX<T> gradient = A * x - (G * beta).template cast<T>();
        descend_nonnegative<T>({A.data(), static_cast<std::size_t>(A.size())},
                               {gradient.data(), static_cast<std::size_t>(gradient.size())},
                               {x.data(), static_cast<std::size_t>(x.size())});
        if (!(x.maxCoeff() > 0)) x.setOnes();
    }
    double squared = 0;
    for (const auto& color : samples.colors)
        for (int c = 0; c < 3; ++c) {
            const double predicted = std::clamp(albedo[color.vertex][c] * static_cast<double>(E[color.row]), 0.0, 1.0);
            const double error = linear_to_srgb(predicted) - linear_to_srgb(static_cast<double>(color.linear[c]));
            squared += error * error;
        }
    psnr = -10 * std::log10(std::max(squared / (3 * static_cast<double>(samples.colors.size())), 1e-12));
    return x;
}

/// The mean of the people's roots in `frames`, over the roots that a photograph of their frame shows. A person outside
/// of the cameras' view therefore does not move it. If no photograph shows a root, it is the mean of all.
[[nodiscard]] inline vec3<double> middle_of_people(Span<const LitPerson> people, Span<const Photo> photos,
                                                   const std::vector<std::size_t>& frames) {
    std::vector<vec3<double>> all, shown;
    for (const std::size_t frame : frames)
        for (const LitPerson& person : people) {
            const vec3<double>& root = all.emplace_back(person.motion->transl[frame] + person.rig->joints[0]);
            if (std::any_of(photos.begin(), photos.end(), [&](const Photo& photo) {
                    const vec3<double> local = to_camera(photo.camera, root);
                    if (photo.frame != frame || !(local.z > 0)) return false;
                    const vec2<double> pixel = to_pixel(photo.camera, local);
                    return pixel.x > 0 && pixel.y > 0 && pixel.x < photo.camera.width && pixel.y < photo.camera.height;
                }))
                shown.push_back(root);
        }
    const std::vector<vec3<double>>& roots = shown.empty() ? all : shown;
    vec3<double> sum(0);
    for (const vec3<double>& root : roots) sum += root * (1 / static_cast<double>(roots.size()));
    return sum;
}

/// The places of the strongest points: the strongest candidate, moved to the centre of the light within half a radian
/// of it, then the strongest of the rest, and so on. Fewer candidates with light give fewer places; the rest are even.
inline std::vector<vec3<double>> strongest_places(const std::vector<vec3<double>>& directions,
                                                  const Eigen::VectorXd& strength, std::size_t count) {
    std::vector<double> left(directions.size());
    for (std::size_t k = 0; k < left.size(); ++k) left[k] = strength[static_cast<Eigen::Index>(k)];
    std::vector<vec3<double>> places;
    const std::vector<vec3<double>> even = even_directions(count);
    while (places.size() < count) {
        const auto best = static_cast<std::size_t>(std::max_element(left.begin(), left.end()) - left.begin());
        if (!(left[best] > 0)) {
            places.push_back(even[places.size()]);
            continue;
        }
        vec3<double> sum(0);
        for (std::size_t k = 0; k < left.size(); ++k)
            if (dot(directions[k], directions[best]) > std::cos(0.5)) sum += directions[k] * left[k], left[k] = 0;
        places.push_back(normalize(sum));
    }
    return places;
}

} // namespace detail

/// Finds the light under which people were photographed. Colours of mesh vertices are read from the photographs in
/// which they are seen, and explained as albedo(vertex) times Σ light_k visibility · cosine / distance², by least
/// squares with intensities that are not negative. The strongest of many candidates become the points; points and
/// directions are then fitted again. The light is the same in all frames and for all people.
///
/// Units   the mean irradiance of the colours is 1, so that albedos are about the colours in the photographs.
/// Errors  ValueError if no vertex is seen in any photograph, for a body without triangles, a photograph of a frame
///         that a motion does not have, and settings out of range.
/// Source  our own; the inverse problem is that of "inverse rendering" with known geometry, solved in turns.
template <Backend B>
[[nodiscard]] LightEstimate estimate_light(B& backend, Span<const LitPerson> people, Span<const Photo> photos,
                                           const LightEstimateParams& params = {}) {
    constexpr std::string_view where = "estimate_light";
    check_value(!people.empty() && !photos.empty(), where, "there are no people or no photographs");
    check_value(params.points + params.directions > 0, where, "points and directions are 0, expected a light");
    check_value(params.points == 0 || params.candidates > 0, where, "candidates is 0, expected places for the points");
    check_value(params.distance > 0 && std::isfinite(params.distance), where, "distance must be above 0 metres");
    // Frames: evenly spread over the photographed ones.
    std::vector<std::size_t> frames;
    for (const Photo& photo : photos) frames.push_back(photo.frame);
    for (const LitPerson& person : people)
        for (const std::size_t frame : frames)
            check_value(frame < person.motion->frame_count(), where,
                        "a photograph is of frame " + std::to_string(frame) + ", a motion has " +
                            std::to_string(person.motion->frame_count()) + " frames");
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    if (frames.size() > params.frames) {
        std::vector<std::size_t> some;
        for (std::size_t k = 0; k < params.frames; ++k) some.push_back(frames[k * frames.size() / params.frames]);
        frames = std::move(some);
    }
    const vec3<double> center = detail::middle_of_people(people, photos, frames);
    const std::vector<vec3<double>> around = even_directions(params.candidates);
    LightData candidates{.points = {},
                         .directions = even_directions(params.directions),
                         .log_intensities = std::vector<double>(params.candidates + params.directions, 0),
                         .gloss = {},
                         .shadows = params.shadows};
    for (const vec3<double>& direction : around) candidates.points.push_back(center + direction * params.distance);

    LightEstimate estimate;
    detail::PosedPeople<B> posed(backend, people, params.vertices, params.seed, center, 2 * params.distance);
    detail::LightSamples samples = detail::read_samples(posed, photos, frames, candidates, params.photos_per_frame);
    check_value(!samples.colors.empty(), where,
                "no vertex of a mesh is seen inside the mask (alpha of at least " +
                    std::to_string(detail::solid_alpha) +
                    ") of any photograph, so there are no colours to find the light from; check cameras, poses and "
                    "masks");
    Eigen::MatrixXf G = samples.irradiances(candidates);
    const Eigen::VectorXd found = detail::fit_intensities(samples, G, params.rounds, estimate.psnr);
    const Eigen::VectorXd strength = found.cwiseProduct(G.rowwise().mean().cast<double>());

    LightData& light = estimate.light;
    for (const vec3<double>& place : detail::strongest_places(around, strength, params.points))
        light.points.push_back(center + place * params.distance);
    light.directions = candidates.directions;
    light.shadows = params.shadows;
    light.log_intensities.assign(light.size(), 0);
    samples = detail::read_samples(posed, photos, frames, light, params.photos_per_frame);
    G = samples.irradiances(light);
    const Eigen::VectorXd fitted = detail::fit_intensities(samples, G, params.rounds, estimate.psnr);
    estimate.samples = samples.colors.size();
    std::ignore = detail::fit_intensities(samples, Eigen::MatrixXf::Ones(1, G.cols()), 0, estimate.psnr_even);

    // An intensity of zero has no logarithm: the least is a thousandth of the mean irradiance. The strongest point
    // comes first, for it is the unit of a LearnedLight.
    for (std::size_t k = 0; k < light.size(); ++k) {
        const double unit = k < light.points.size() ? params.distance * params.distance : 1;
        light.log_intensities[k] = std::log(std::max(fitted[static_cast<Eigen::Index>(k)], 1e-3 * unit));
    }
    if (params.points > 0) {
        const auto points_end = light.log_intensities.begin() + static_cast<std::ptrdiff_t>(params.points);
        const auto strongest = std::max_element(light.log_intensities.begin(), points_end);
        std::swap(light.points[0], light.points[static_cast<std::size_t>(strongest - light.log_intensities.begin())]);
        std::swap(light.log_intensities[0], *strongest);
    }
    light.gloss = even_light(1, 0, center, params.distance).gloss;
    return estimate;
}

} // namespace gsh
