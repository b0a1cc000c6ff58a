// SPDX-License-Identifier: Apache-2.0
/// @file  Masks of fitted people, without what is not a person, and where they lack parts of a body.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/nearest_points.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/mask_view.hpp>
#include <gsh/fit/outlines.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// What mending changed in a mask, as shares of the body's area in it.
struct MaskChange {
    double removed = 0; ///< of the person's surroundings that the mask held
    double hidden = 0;  ///< of the body that it lacks
};

/// Which pixels of a photograph a fitted body claims.
struct MaskClaim {
    std::vector<std::uint8_t> body;    // [pixels] 1 where the body is
    std::vector<std::uint8_t> core;    // [pixels] 1 where it surely is: inside of its outline by more than 2.5 cm
    std::vector<std::uint8_t> usual;   // [pixels] 1 where masks usually show the person
    std::vector<std::uint8_t> allowed; // [pixels] 1 where a mask may show the person, or clothes and hair
    std::size_t area = 0;              ///< pixels of the body
    int width = 0;                     ///< of the photograph, pixels
    double margin = 0;                 ///< 2.5 cm at the body, pixels
    bool believed = true;              ///< if not, the claim only protects what is there: nothing is hidden
};

/// The claims of all people in a photograph as a grey image, by which masks can be cut anew: 255 where a body surely
/// is, 170 where masks usually show the person, 85 where a mask may, and 0 elsewhere.
///
/// Shapes  result as large as the claims.
inline std::vector<std::uint8_t> image_of_claims(const std::vector<MaskClaim>& claims);

/// Mends the mask of a photograph, one byte a pixel, by the claims of all people in it. The mask is cut where nobody's
/// claim allows it, if `cut`. Nothing is cut where the mask also lacks more than 3% of a body that is believed: then
/// this body may be in the wrong place. `hidden` becomes 255 where the body of somebody who is believed surely is while
/// the mask has nobody, and in the rest of the limb around; else 0. Something is in front there, or the mask is wrong.
///
/// Shapes  mask and hidden [pixels], as large as the claims.
/// Errors  ShapeError for another size.
inline MaskChange mend_mask(const std::vector<MaskClaim>& claims, Span<std::uint8_t> mask, Span<std::uint8_t> hidden,
                            bool cut = true);

/// Mends masks by the fitted body.
///
/// Clothes and hair stand off the body by about the same distance at the same place of it in all photographs; a thing
/// in the background, a shadow or another person touches the mask in some. For each point of the surface, the distances
/// of the masks' outlines from it are collected over all photographs in which it lies on the outline, together with
/// those of its neighbours, about a hand's breadth around. The distance that three of ten stay below is how far clothes
/// usually stand off there; 3 cm more is how far a mask may reach; beyond, it is not believed. Inside of the body, by
/// more than 2.5 cm, a mask that says background is not believed, either: whether the photograph shows the person there
/// is not known.
class MaskMender {
public:
    MaskMender(const BodyModel& model, const FittedBody& body, const OutlineSamples& samples)
        : model_(&model), body_(&body), samples_(&samples), seen_(samples.size()) {}

    /// Collects the distances of one photograph's mask.
    void watch(const FrameNumbers& numbers, Span<const double> betas, const Camera<double>& camera,
               const MaskView& mask) {
        const FrameKinematics kinematics(*body_, numbers, betas);
        for (const RimPoint& point : samples_->rim(*body_, kinematics, betas, camera, 1))
            if (const auto distance = OutlineSamples::mask_distance(point, mask, reach))
                seen_[point.sample].push_back(*distance / point.pixels_per_metre);
        reaches_.clear();
    }

    /// What the posed body claims of a photograph; `vertices` is its mesh in the world.
    [[nodiscard]] MaskClaim claim(const FrameNumbers& numbers, Span<const double> betas, const Camera<double>& camera,
                                  Span<const vec3<double>> vertices) {
        if (reaches_.empty()) decide();
        cpu::Serial backend;
        const MeshImage image = rasterize_mesh(backend, vertices, model_->faces, camera);
        const int width = image.width, height = image.height;
        MaskClaim result;
        result.body.assign(image.size(), 0);
        result.allowed = result.usual = result.core = result.body;
        const auto stamp = [&](std::vector<std::uint8_t>& on, std::uint8_t value, double x, double y, double radius) {
            for (int v = std::max(0, static_cast<int>(y - radius));
                 v <= std::min(height - 1, static_cast<int>(y + radius)); ++v)
                for (int u = std::max(0, static_cast<int>(x - radius));
                     u <= std::min(width - 1, static_cast<int>(x + radius)); ++u) {
                    const double dx = u + 0.5 - x, dy = v + 0.5 - y;
                    if (dx * dx + dy * dy <= radius * radius)
                        on[static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                           static_cast<std::size_t>(u)] = value;
                }
        };
        // The surroundings of the silhouette: what is near its border on both sides.
        double pixels_per_metre = 0, count = 0;
        const FrameKinematics kinematics(*body_, numbers, betas);
        const std::vector<RimPoint> rim = samples_->rim(*body_, kinematics, betas, camera, 1);
        for (const RimPoint& point : rim) pixels_per_metre += point.pixels_per_metre, count += 1;
        if (count == 0) return result;
        pixels_per_metre /= count;
        result.width = width, result.margin = inside_margin * pixels_per_metre;
        for (std::size_t i = 0; i < image.size(); ++i)
            if (image.covers(i))
                ++result.area, result.body[i] = result.core[i] = result.usual[i] = result.allowed[i] = 1;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const auto at = [&](int u, int v) {
                    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width) + static_cast<std::size_t>(u);
                };
                if (!image.covers(at(x, y))) continue;
                const auto bare = [&](int u, int v) {
                    return u >= 0 && v >= 0 && u < width && v < height && !image.covers(at(u, v));
                };
                if (!bare(x - 1, y) && !bare(x + 1, y) && !bare(x, y - 1) && !bare(x, y + 1)) continue;
                stamp(result.allowed, 1, x + 0.5, y + 0.5, least_reach * pixels_per_metre);
                stamp(result.core, 0, x + 0.5, y + 0.5, result.margin);
            }
        for (const RimPoint& point : rim) {
            const auto grow = [&](std::vector<std::uint8_t>& on, double metres) {
                stamp(on, 1, point.pixel.x, point.pixel.y, metres * point.pixels_per_metre);
            };
            if (usual_[point.sample] > 0) grow(result.usual, usual_[point.sample]);
            if (reaches_[point.sample] > least_reach) grow(result.allowed, reaches_[point.sample]);
        }
        return result;
    }

private:
    static constexpr double reach = 0.3;           // metres, within which an outline is looked for
    static constexpr double least_reach = 0.03;    // metres: the fit errs by a centimetre or two
    static constexpr double inside_margin = 0.025; // metres

    const BodyModel* model_;
    const FittedBody* body_;
    const OutlineSamples* samples_;
    std::vector<std::vector<double>> seen_; // [samples] metres, outwards
    std::vector<double> reaches_, usual_;   // [samples], or none before decide

    void decide() {
        std::vector<vec3<double>> places;
        for (std::size_t i = 0; i < samples_->size(); ++i) places.push_back(samples_->rest(i));
        const NearestPoints nearest(places);
        reaches_.assign(samples_->size(), least_reach), usual_.assign(samples_->size(), 0);
        constexpr std::size_t neighbours = 60, fewest = 8;
        for (std::size_t i = 0; i < places.size(); ++i) {
            std::vector<double> distances;
            for (const auto& [squared, other] : nearest.nearest(places[i], neighbours))
                distances.insert(distances.end(), seen_[other].begin(), seen_[other].end());
            if (distances.size() < fewest) continue;
            const auto rank = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() * 3 / 10);
            std::nth_element(distances.begin(), rank, distances.end());
            reaches_[i] = std::max(least_reach, *rank + least_reach);
            usual_[i] = *rank;
        }
    }
};

inline std::vector<std::uint8_t> image_of_claims(const std::vector<MaskClaim>& claims) {
    std::vector<std::uint8_t> image;
    for (const MaskClaim& claim : claims) {
        image.resize(claim.body.size(), 0);
        for (std::size_t i = 0; i < image.size(); ++i) {
            const int level = claim.core[i] ? 255 : claim.usual[i] ? 170 : claim.allowed[i] ? 85 : 0;
            image[i] = std::max(image[i], static_cast<std::uint8_t>(level));
        }
    }
    return image;
}

inline MaskChange mend_mask(const std::vector<MaskClaim>& claims, Span<std::uint8_t> mask, Span<std::uint8_t> hidden,
                            bool cut) {
    MaskChange change;
    std::size_t area = 0;
    std::fill(hidden.begin(), hidden.end(), std::uint8_t(0));
    check_size("mend_mask", "hidden", hidden.size(), mask.size(), "one byte a pixel");
    for (const MaskClaim& claim : claims) {
        check_size("mend_mask", "mask", mask.size(), claim.body.size(), "one byte a pixel");
        area += claim.area;
        if (!claim.believed) continue;
        std::size_t lacking = 0; // pixels of the body where the mask has nobody
        for (std::size_t i = 0; i < mask.size(); ++i) lacking += claim.body[i] && mask[i] < 128;
        constexpr double most_lacking = 0.03;
        cut = cut && static_cast<double>(lacking) <= most_lacking * static_cast<double>(claim.area);
    }
    if (area == 0) return change; // nobody is in view
    for (std::size_t i = 0; i < mask.size(); ++i) {
        bool allowed = false, core = false;
        for (const MaskClaim& claim : claims)
            allowed = allowed || claim.allowed[i], core = core || (claim.believed && claim.core[i]);
        if (!allowed && cut) {
            change.removed += mask[i] / 255.0;
            mask[i] = 0;
        } else if (core && mask[i] >= 128) {
            mask[i] = 255; // soft masks are soft at their outline alone
        }
    }
    for (const MaskClaim& claim : claims) {
        if (!claim.believed || claim.area == 0) continue;
        const int width = claim.width, height = static_cast<int>(mask.size()) / width;
        const auto lacks = [&](int x, int y) {
            if (x < 0 || y < 0 || x >= width || y >= height) return false;
            const std::size_t i =
                static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
            return claim.core[i] && mask[i] < 128;
        };
        const double radius = 2 * claim.margin; // the outline is one margin away, and may be wrong by another
        const int reach = static_cast<int>(radius);
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                if (!lacks(x, y)) continue;
                const bool inner = lacks(x - 1, y) && lacks(x + 1, y) && lacks(x, y - 1) && lacks(x, y + 1);
                const int around = inner ? 0 : reach; // the discs of the border cover all that is around
                for (int v = std::max(0, y - around); v <= std::min(height - 1, y + around); ++v)
                    for (int u = std::max(0, x - around); u <= std::min(width - 1, x + around); ++u) {
                        const std::size_t i =
                            static_cast<std::size_t>(v) * static_cast<std::size_t>(width) + static_cast<std::size_t>(u);
                        if ((u - x) * (u - x) + (v - y) * (v - y) <= radius * radius && claim.allowed[i] &&
                            mask[i] < 128)
                            hidden[i] = 255;
                    }
            }
    }
    for (const std::uint8_t value : hidden) change.hidden += value != 0;
    change.removed /= static_cast<double>(area);
    change.hidden /= static_cast<double>(area);
    return change;
}

} // namespace gsh
