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
#include <gsh/photo/photo.hpp>
#include <gsh/setup/light_samples.hpp>

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
    LightParams light = {};                  ///< of the result; `distance` is the radius of the sphere of candidates
    std::size_t candidates = 128;            ///< places among which the points are found, on a sphere about the people
    std::size_t frames = 24;                 ///< at most this many are read, evenly spread over the photographed ones
    std::size_t photos_per_frame = 4;        ///< at most
    std::size_t vertices = 3000;             ///< at most, of each person
    int rounds = 12;                         ///< at most, of Gauss-Newton steps
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

/// The sums over the colours of each row that least squares need.
struct ColorSums {
    std::vector<double> weights;         // [rows] Σ w
    std::vector<vec3<double>> weighted;  // [rows] Σ w c
    Eigen::VectorXf share;               // [rows] the row's colours / all colours
    double squares = 0;                  // Σ w |c|²

    explicit ColorSums(const LightSamples& samples)
        : weights(samples.positions.size()), weighted(samples.positions.size(), vec3<double>(0)),
          share(Eigen::VectorXf::Zero(static_cast<Eigen::Index>(samples.positions.size()))) {
        for (const auto& [row, linear, weight] : samples.colors) {
            const vec3<double> c(linear);
            const double w = weight;
            weights[row] += w, weighted[row] += c * w, squares += w * dot(c, c);
            share[row] += 1 / static_cast<float>(samples.colors.size());
        }
    }
};

/// The albedos that explain the colours best under given irradiances, which are scaled to a mean of 1.
struct AlbedoFit {
    Eigen::VectorXf E;                // [rows] irradiances
    std::vector<vec3<double>> albedo; // [vertices]
    std::vector<double> weights;      // [vertices] Σ w E²
    double error = 0;                 // Σ w |c - albedo E|²

    /// Scales x to a mean irradiance of 1.
    template <std::floating_point T>
    AlbedoFit(const LightSamples& samples, const ColorSums& sums, const Eigen::MatrixXf& G, Eigen::VectorX<T>& x)
        : E(G.transpose() * x.template cast<float>()), albedo(samples.vertices, vec3<double>(0)),
          weights(samples.vertices, 1e-12), error(sums.squares) {
        const float mean = sums.share.dot(E);
        check_value(mean > 0, "estimate_light", "no light reaches any vertex that a photograph shows");
        x /= static_cast<T>(mean), E /= mean;
        for (std::size_t r = 0; r < sums.weights.size(); ++r) {
            const double e = E[static_cast<Eigen::Index>(r)];
            albedo[samples.vertex_of[r]] += sums.weighted[r] * e;
            weights[samples.vertex_of[r]] += sums.weights[r] * e * e;
        }
        for (std::size_t v = 0; v < samples.vertices; ++v) {
            error -= dot(albedo[v], albedo[v]) / weights[v];
            albedo[v] *= 1 / weights[v];
        }
    }

    [[nodiscard]] double psnr(const LightSamples& samples) const {
        double squared = 0;
        for (const auto& color : samples.colors)
            for (int c = 0; c < 3; ++c) {
                const double predicted = albedo[samples.vertex_of[color.row]][c] * static_cast<double>(E[color.row]);
                const double off = linear_to_srgb(std::clamp(predicted, 0.0, 1.0)) -
                                   linear_to_srgb(static_cast<double>(color.linear[c]));
                squared += off * off;
            }
        return -10 * std::log10(std::max(squared / (3 * static_cast<double>(samples.colors.size())), 1e-12));
    }
};

/// The intensities that explain the colours best, by weighted least squares over albedos and intensities that are not
/// negative. The albedos are eliminated, and the rest is solved by Gauss-Newton steps: fitting the two in turns takes
/// hundreds of rounds where light and albedo could stand for each other, and ends with too much light from sides where
/// there is none. The mean irradiance of all colours is 1. psnr receives the fit's. T is the type of the sums; a
/// template, so that Eigen's products are compiled only where a light is estimated.
///
/// Source  Golub, Pereyra, "The Differentiation of Pseudo-Inverses and Nonlinear Least Squares Problems Whose Variables
///         Separate", SIAM J. Numer. Anal. 10(2), 1973; Kaufman's approximation of the derivative.
template <std::floating_point T>
[[nodiscard]] Eigen::VectorX<T> fit_intensities(const LightSamples& samples, const Eigen::MatrixXf& G, int rounds,
                                                T& psnr) {
    const Eigen::Index lights = G.rows(), rows = G.cols();
    const ColorSums sums(samples);
    const Eigen::VectorX<T> unit = (G * sums.share).template cast<T>(); // unit · x = 1

    Eigen::VectorX<T> x = Eigen::VectorX<T>::Ones(lights);
    AlbedoFit fit(samples, sums, G, x);
    for (int round = 0; round < rounds; ++round) {
        // The derivative of albedo E by x, less what a change of the albedo makes up for: of row r of vertex v,
        // |albedo| (G_r - E_r Σ w E G / Σ w E²), the sums over the rows of v.
        Eigen::MatrixXf of_vertex = Eigen::MatrixXf::Zero(lights, static_cast<Eigen::Index>(samples.vertices));
        Eigen::VectorXf alpha(rows), beta(rows);
        for (Eigen::Index r = 0; r < rows; ++r) {
            const auto row = static_cast<std::size_t>(r);
            const std::uint32_t v = samples.vertex_of[row];
            const vec3<double>& a = fit.albedo[v];
            const double w = sums.weights[row], e = fit.E[r];
            of_vertex.col(v) += G.col(r) * static_cast<float>(w * e / fit.weights[v]);
            alpha[r] = static_cast<float>(std::sqrt(w * dot(a, a)));
            beta[r] = static_cast<float>(dot(a, a) * w * e - dot(a, sums.weighted[row]));
        }
        Eigen::MatrixX<T> A = Eigen::MatrixX<T>::Zero(lights, lights);
        constexpr Eigen::Index block = 4096; // sums of blocks in float, then in double
        Eigen::MatrixXf scaled;
        for (Eigen::Index first = 0; first < rows; first += block) {
            scaled = G.middleCols(first, std::min(block, rows - first));
            for (Eigen::Index k = 0; k < scaled.cols(); ++k) {
                const Eigen::Index r = first + k;
                scaled.col(k) -= of_vertex.col(samples.vertex_of[static_cast<std::size_t>(r)]) * fit.E[r];
                scaled.col(k) *= alpha[r];
            }
            A += (scaled * scaled.transpose()).template cast<T>();
        }
        // A common factor of all intensities changes nothing. The step keeps the mean irradiance, which is 1.
        const T size = A.diagonal().mean();
        A += unit * unit.transpose() * (size / unit.squaredNorm());
        A.diagonal().array() += T(1e-6) * size + T(1e-12);
        Eigen::VectorX<T> gradient = (G * beta).template cast<T>(), next = x;
        descend_nonnegative<T>({A.data(), static_cast<std::size_t>(A.size())},
                               {gradient.data(), static_cast<std::size_t>(gradient.size())},
                               {next.data(), static_cast<std::size_t>(next.size())});
        // A step that is too long is halved.
        const double before = fit.error;
        for (T step = 1; step > T(0.05); step /= 2) {
            Eigen::VectorX<T> trial = x + (next - x) * step;
            if (!(trial.maxCoeff() > 0)) continue;
            AlbedoFit after(samples, sums, G, trial);
            if (!(after.error < fit.error)) continue;
            x = std::move(trial), fit = std::move(after);
            break;
        }
        if (!(fit.error < before * (1 - 1e-5))) break;
    }
    psnr = fit.psnr(samples);
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
/// Source  our own; the inverse problem is that of "inverse rendering" with known geometry.
template <Backend B>
[[nodiscard]] LightEstimate estimate_light(B& backend, Span<const LitPerson> people, Span<const Photo> photos,
                                           const LightEstimateParams& params = {}) {
    constexpr std::string_view where = "estimate_light";
    check_value(!people.empty() && !photos.empty(), where, "there are no people or no photographs");
    check_value(params.light.points >= 0 && params.light.directions >= 0 &&
                    params.light.points + params.light.directions > 0,
                where, "points and directions must not be negative, and one of them must be above 0");
    check_value(params.light.points == 0 || params.candidates > 0, where,
                "candidates is 0, expected places for the points");
    check_value(params.light.distance > 0 && std::isfinite(params.light.distance), where,
                "distance must be above 0 metres");
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
                         .directions = even_directions(params.light.directions),
                         .log_intensities = std::vector<double>(params.candidates + params.light.directions, 0),
                         .gloss = {},
                         .shadows = params.light.shadows};
    for (const vec3<double>& direction : around)
        candidates.points.push_back(center + direction * params.light.distance);

    LightEstimate estimate;
    detail::PosedPeople<B> posed(backend, people, params.vertices, params.seed, center, 2 * params.light.distance);
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
    for (const vec3<double>& place : detail::strongest_places(around, strength, params.light.points))
        light.points.push_back(center + place * params.light.distance);
    light.directions = candidates.directions;
    light.shadows = params.light.shadows;
    light.log_intensities.assign(light.size(), 0);
    samples = detail::read_samples(posed, photos, frames, light, params.photos_per_frame);
    G = samples.irradiances(light);
    const Eigen::VectorXd fitted = detail::fit_intensities(samples, G, params.rounds, estimate.psnr);
    estimate.samples = samples.colors.size();
    std::ignore = detail::fit_intensities(samples, Eigen::MatrixXf::Ones(1, G.cols()), 0, estimate.psnr_even);

    // An intensity of zero has no logarithm: the least is a thousandth of the mean irradiance. The strongest point
    // comes first, for it is the unit of a LearnedLight.
    for (std::size_t k = 0; k < light.size(); ++k) {
        const double unit = k < light.points.size() ? params.light.distance * params.light.distance : 1;
        light.log_intensities[k] = std::log(std::max(fitted[static_cast<Eigen::Index>(k)], 1e-3 * unit));
    }
    if (params.light.points > 0) {
        const auto points_end = light.log_intensities.begin() + static_cast<std::ptrdiff_t>(params.light.points);
        const auto strongest = std::max_element(light.log_intensities.begin(), points_end);
        std::swap(light.points[0], light.points[static_cast<std::size_t>(strongest - light.log_intensities.begin())]);
        std::swap(light.log_intensities[0], *strongest);
    }
    light.gloss = even_light(1, 0, center, params.light.distance).gloss;
    return estimate;
}

} // namespace gsh
