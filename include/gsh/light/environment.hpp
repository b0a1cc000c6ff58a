// SPDX-License-Identifier: Apache-2.0
/// @file  Converts an environment image, which shows the light from every direction, to a few lights.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/nonnegative.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// Settings of environment_light.
struct EnvironmentParams {
    std::size_t directions = 24;  ///< at most this many; they stand for the broad part of the light
    std::size_t points = 4;       ///< at most this many; they stand for suns and lamps
    double point_angle = 0.17;    ///< radians; a sun or lamp is not farther than this from its middle (10 degrees)
    double point_share = 0.04;    ///< of all light; a sun or lamp has at least this, above what surrounds it
    double distance = 100;        ///< metres; of the points from `center`
    vec3<double> center{0, 0, 0}; ///< where the people are
    double turn = 0;              ///< radians; turns the light about +y, from +z towards +x
};

/// The direction in which an equirectangular image of the given size shows a point; pixel coordinates, the centre of
/// the first pixel is (0.5, 0.5). The centre of the image is -z, its right quarter +x, its upper edge +y: what a camera
/// sees that looks along -z. An upright person who faces +z faces away from the centre.
[[nodiscard]] inline vec3<double> environment_direction(const vec2<double>& pixel, int height, int width) {
    const double longitude = (2 * pixel.x / width - 1) * std::numbers::pi;
    const double latitude = (0.5 - pixel.y / height) * std::numbers::pi;
    return {std::cos(latitude) * std::sin(longitude), std::sin(latitude), -std::cos(latitude) * std::cos(longitude)};
}

/// Checks an equirectangular image of radiances.
/// Errors  ShapeError unless it has 1 or 3 channels and is twice as wide as high; ValueError for a value that is
///         negative or not finite, or if all are zero.
inline void check_environment(std::string_view where, const ImageView<const float>& radiance) {
    const std::string size = std::to_string(radiance.width) + " x " + std::to_string(radiance.height);
    if (radiance.height < 1 || radiance.width != 2 * radiance.height)
        throw ShapeError(std::string(where) + ": the image is " + size +
                         " pixels, expected twice as wide as high (equirectangular, all directions)");
    if (radiance.channels != 1 && radiance.channels != 3)
        throw ShapeError(std::string(where) + ": the image has " + std::to_string(radiance.channels) +
                         " channels, expected 1 or 3");
    check_size(where, "the image", radiance.data.size(), radiance.size());
    bool lit = false;
    for (std::size_t i = 0; i < radiance.data.size(); ++i) {
        const float value = radiance.data[i];
        if (!std::isfinite(value) || value < 0) {
            const auto pixel = i % radiance.plane_size(), width = static_cast<std::size_t>(radiance.width);
            throw ValueError(std::string(where) + ": pixel (" + std::to_string(pixel % width) + ", " +
                             std::to_string(pixel / width) + ") is " + detail::number_text(value) +
                             ", expected a finite number, not negative");
        }
        lit = lit || value > 0;
    }
    check_value(lit, where, "the image is black everywhere; there is no light in it");
}

/// The grey light of an equirectangular image, as at most `points` points and `directions` directions without gloss.
///
/// 1. Suns and lamps. Where light in a small cone exceeds its surroundings by a share of all light, the excess becomes
///    a point far away: it has gloss, and shadows with narrow edges. Its intensity is the excess.
/// 2. The rest is divided into regions, each nearest to one of the directions, and the directions move to the
///    power-weighted means of their regions (k-means on the sphere). They have broad shadows and no gloss.
/// 3. The directions' intensities are fitted to the irradiance of the rest, which is summed over the image for 256
///    normals:  min over I >= 0 of  Σ_n (Σ_k I_k max(0, n·d_k) - E(n))² + small (I_k - power_k)².
///
/// The mean irradiance over all normals is then scaled to 1, that of even_light; the image's own unit has no meaning.
///
/// Shapes  radiance [1 or 3, height, 2 height], linear light. RGB counts by its luminance: LightView is grey.
/// Frame   environment_direction.
/// Errors  those of check_environment; ValueError for settings out of range.
/// Source  Rec. 709 for luminance; Debevec, "A Median Cut Algorithm for Light Probe Sampling", 2005, for lights from
///         the regions of an image, here by k-means.
[[nodiscard]] inline LightData environment_light(const ImageView<const float>& radiance,
                                                 const EnvironmentParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Parts of the sphere, with the light that comes from each.
struct EnvironmentCells {
    std::vector<vec3<double>> dirs;    ///< unit, of the middle
    std::vector<vec3<double>> moments; ///< ∫ L ω dω
    std::vector<double> powers;        ///< ∫ L dω
    std::vector<double> angles;        ///< ∫ dω, steradians

    [[nodiscard]] std::size_t size() const { return dirs.size(); }
    [[nodiscard]] double power() const {
        double sum = 0;
        for (const double p : powers) sum += p;
        return sum;
    }
    [[nodiscard]] double irradiance(const vec3<double>& normal) const {
        double sum = 0;
        for (const vec3<double>& moment : moments) sum += std::max(0.0, dot(normal, moment));
        return sum;
    }
};

/// Pixels of an image, or blocks of pixels if it is larger than 256 x 128.
inline EnvironmentCells environment_cells(const ImageView<const float>& radiance, double turn) {
    const int H = radiance.height, W = radiance.width, rows = std::min(H, 128), columns = 2 * rows;
    const auto count = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
    EnvironmentCells cells{std::vector<vec3<double>>(count, vec3<double>(0)),
                           std::vector<vec3<double>>(count, vec3<double>(0)), std::vector<double>(count, 0.0),
                           std::vector<double>(count, 0.0)};
    const double cosine = std::cos(turn), sine = std::sin(turn);
    for (int y = 0; y < H; ++y) {
        const double above = std::sin((0.5 - double(y) / H) * std::numbers::pi);
        const double below = std::sin((0.5 - double(y + 1) / H) * std::numbers::pi);
        const double angle = 2 * std::numbers::pi / W * (above - below);
        for (int x = 0; x < W; ++x) {
            const vec3<double> d = environment_direction({x + 0.5, y + 0.5}, H, W);
            const vec3<double> dir{cosine * d.x + sine * d.z, d.y, cosine * d.z - sine * d.x};
            double light = radiance.at(0, y, x);
            if (radiance.channels == 3)
                light = 0.2126 * light + 0.7152 * double(radiance.at(1, y, x)) + 0.0722 * double(radiance.at(2, y, x));
            const auto row = static_cast<std::size_t>(std::int64_t(y) * rows / H);
            const auto cell = row * static_cast<std::size_t>(columns) +
                              static_cast<std::size_t>(std::int64_t(x) * columns / W);
            cells.dirs[cell] += dir * angle, cells.angles[cell] += angle;
            cells.moments[cell] += dir * (light * angle), cells.powers[cell] += light * angle;
        }
    }
    for (vec3<double>& dir : cells.dirs) dir = normalize(dir);
    return cells;
}

/// A direction with its irradiance on a facing surface.
struct EnvironmentLight {
    vec3<double> dir;
    double intensity;
};

/// Takes suns and lamps out of the cells.
inline std::vector<EnvironmentLight> take_lamps(EnvironmentCells& cells, const EnvironmentParams& params) {
    const double total = cells.power();
    const double inside = std::cos(params.point_angle), around = std::cos(2 * params.point_angle);
    std::vector<double> radiance(cells.size());
    for (std::size_t c = 0; c < cells.size(); ++c) radiance[c] = cells.powers[c] / cells.angles[c];
    std::vector<EnvironmentLight> lamps;
    constexpr int most_tries = 64; // places that are bright but too weak
    for (int tried = 0; tried < most_tries && lamps.size() < params.points; ++tried) {
        const auto brightest = static_cast<std::size_t>(std::max_element(radiance.begin(), radiance.end()) -
                                                        radiance.begin());
        const vec3<double> middle = cells.dirs[brightest];
        std::vector<std::size_t> region;
        double ring_power = 0, ring_angle = 0;
        for (std::size_t c = 0; c < cells.size(); ++c) {
            const double cosine = dot(cells.dirs[c], middle);
            if (cosine >= inside) region.push_back(c);
            else if (cosine >= around) ring_power += radiance[c] * cells.angles[c], ring_angle += cells.angles[c];
        }
        if (!(ring_angle > 0)) break; // cells are wider than a lamp
        const double level = ring_power / ring_angle;
        double excess = 0;
        vec3<double> moment(0);
        for (const std::size_t c : region) {
            if (!(radiance[c] > level)) continue;
            const double part = 1 - level / radiance[c];
            excess += cells.powers[c] * part, moment += cells.moments[c] * part;
        }
        const bool lamp = excess >= params.point_share * total && length(moment) > 0;
        if (lamp) lamps.push_back({normalize(moment), length(moment)});
        for (const std::size_t c : region) {
            if (!(radiance[c] > level)) continue;
            const double keep = level / radiance[c];
            if (lamp) cells.powers[c] *= keep, cells.moments[c] = cells.moments[c] * keep;
            radiance[c] = level;
        }
    }
    return lamps;
}

/// Directions for the light of all cells, with the power of the region of each.
inline std::vector<EnvironmentLight> soft_directions(const EnvironmentCells& cells, std::size_t count) {
    std::vector<vec3<double>> centers = even_directions(count), moments(count);
    std::vector<double> powers(count), farthest(count);
    std::vector<std::size_t> outlier(count);
    const double negligible = 1e-3 * cells.power() / static_cast<double>(count);
    constexpr int rounds = 24;
    for (int round = 0; round < rounds; ++round) {
        std::fill(moments.begin(), moments.end(), vec3<double>(0));
        std::fill(powers.begin(), powers.end(), 0.0), std::fill(farthest.begin(), farthest.end(), 0.0);
        for (std::size_t c = 0; c < cells.size(); ++c) {
            if (!(cells.powers[c] > 0)) continue;
            std::size_t nearest = 0;
            double cosine = -2;
            for (std::size_t k = 0; k < count; ++k)
                if (const double value = dot(centers[k], cells.dirs[c]); value > cosine) cosine = value, nearest = k;
            moments[nearest] += cells.moments[c], powers[nearest] += cells.powers[c];
            const double spread = cells.powers[c] * (1 - cosine);
            if (spread >= farthest[nearest]) farthest[nearest] = spread, outlier[nearest] = c;
        }
        std::vector<double> spreads(count); // of regions: power less the length of the moment
        for (std::size_t k = 0; k < count; ++k) {
            spreads[k] = powers[k] - length(moments[k]);
            if (powers[k] > negligible && length(moments[k]) > 0) centers[k] = normalize(moments[k]);
        }
        if (round >= rounds / 2) continue;
        // A region without light takes over a part of the widest one.
        for (std::size_t k = 0; k < count; ++k) {
            if (powers[k] > negligible) continue;
            const auto widest = static_cast<std::size_t>(std::max_element(spreads.begin(), spreads.end()) -
                                                         spreads.begin());
            if (!(spreads[widest] > 0)) break;
            centers[k] = cells.dirs[outlier[widest]];
            spreads[widest] = 0; // once per round
        }
    }
    std::vector<EnvironmentLight> lights;
    for (std::size_t k = 0; k < count; ++k)
        if (powers[k] > 0) lights.push_back({centers[k], powers[k]});
    return lights;
}

/// Fits the intensities of lights, which are their start, to the irradiance of the cells.
inline void fit_irradiance(const EnvironmentCells& cells, std::vector<EnvironmentLight>& lights) {
    const std::size_t K = lights.size();
    std::vector<double> A(K * K, 0.0), gradient(K, 0.0); // of the squared error, divided by 2
    for (const vec3<double>& normal : even_directions(256)) {
        const double expected = cells.irradiance(normal);
        std::vector<double> cosines(K);
        double error = -expected;
        for (std::size_t k = 0; k < K; ++k) {
            cosines[k] = std::max(0.0, dot(normal, lights[k].dir));
            error += cosines[k] * lights[k].intensity;
        }
        for (std::size_t i = 0; i < K; ++i) {
            gradient[i] += cosines[i] * error;
            for (std::size_t j = 0; j < K; ++j) A[i * K + j] += cosines[i] * cosines[j];
        }
    }
    // The start counts a little: lights that are close to each other share as their regions do.
    for (std::size_t k = 0; k < K; ++k) A[k * K + k] *= 1.01;
    std::vector<double> intensities;
    for (const EnvironmentLight& light : lights) intensities.push_back(light.intensity);
    descend_nonnegative<double>(A, gradient, intensities);
    for (std::size_t k = 0; k < K; ++k) lights[k].intensity = intensities[k];
}

} // namespace detail

inline LightData environment_light(const ImageView<const float>& radiance, const EnvironmentParams& params) {
    constexpr std::string_view where = "environment_light";
    check_environment(where, radiance);
    check_value(params.directions >= 1 && params.directions <= 256, where,
                std::to_string(params.directions) + " directions, expected 1 to 256");
    check_value(params.points <= 64, where, std::to_string(params.points) + " points, expected at most 64");
    check_value(params.point_angle > 0 && params.point_angle < 0.7, where,
                "point_angle is " + detail::number_text(params.point_angle) +
                    ", expected radians above 0 and below 0.7");
    check_value(params.distance > 0 && params.distance < 1e4, where,
                "distance is " + detail::number_text(params.distance) + ", expected metres above 0 and below 10000");
    check_value(std::isfinite(params.turn), where, "turn is not finite");

    detail::EnvironmentCells cells = detail::environment_cells(radiance, params.turn);
    std::vector<detail::EnvironmentLight> lamps = detail::take_lamps(cells, params);
    std::vector<detail::EnvironmentLight> soft;
    if (cells.power() > 0) {
        soft = detail::soft_directions(cells, params.directions);
        detail::fit_irradiance(cells, soft);
    }
    double sum = 0;
    for (const auto* lights : {&lamps, &soft})
        for (const auto& light : *lights) sum += light.intensity;
    const double scale = 4 / sum; // the mean of max(0, cosine) over all normals is 1 / 4
    std::erase_if(soft, [&](const auto& light) { return !(light.intensity > 1e-7 * sum); });

    LightData result;
    for (const auto& lamp : lamps) {
        result.points.push_back(params.center + lamp.dir * params.distance);
        result.log_intensities.push_back(std::log(scale * lamp.intensity * params.distance * params.distance));
    }
    for (const auto& light : soft) {
        result.directions.push_back(light.dir);
        result.log_intensities.push_back(std::log(scale * light.intensity));
    }
    return result;
}

} // namespace gsh
