// SPDX-License-Identifier: Apache-2.0
/// @file  Where the outline of a posed body meets the outline of a mask.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/frame_kinematics.hpp>
#include <gsh/fit/mask_view.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// A point of a posed body's surface that lies on its outline in a view.
struct RimPoint {
    std::size_t sample = 0;   ///< of OutlineSamples
    vec3<double> position{0}; ///< in the world
    vec2<double> pixel{0};
    vec2<double> normal{0}; ///< of the outline in the image, outwards
    double pixels_per_metre = 0;
};

/// A point of the body's outline that should lie on a line of the photograph.
struct OutlinePoint {
    int joint = 0;          ///< with which it moves
    vec3<double> offset{0}; ///< from the joint, in its frame, as posed when it was found
    std::size_t sample = 0; ///< of OutlineSamples
    vec2<double> normal{0}; ///< of the outline in the image, outwards
    vec2<double> target{0}; ///< the mask's outline, pixels
};

/// Points spread evenly over a body's surface, of which some lie on its outline in any view.
class OutlineSamples {
public:
    OutlineSamples(const BodyModel& body, const FittedBody& fitted, std::size_t count = 3000) {
        const std::size_t V = body.vertex_count(), J = body.joint_count();
        std::vector<double> area(V, 0.0);
        std::vector<vec3<double>> normals(V, vec3<double>(0));
        for (const auto& face : body.faces) {
            const auto corner = [&](std::size_t k) { return body.v_template[static_cast<std::size_t>(face[k])]; };
            const vec3<double> twice = cross(corner(1) - corner(0), corner(2) - corner(0));
            for (const int v : face) {
                area[static_cast<std::size_t>(v)] += length(twice) / 6;
                normals[static_cast<std::size_t>(v)] += twice;
            }
        }
        double whole = 0, passed = 0;
        for (const double a : area) whole += a;
        for (std::size_t v = 0; v < V; ++v) {
            const double before = passed;
            passed += area[v];
            const double share = static_cast<double>(count) / whole;
            if (std::floor(before * share) == std::floor(passed * share) || length(normals[v]) == 0) continue;
            Sample sample{.rest = body.v_template[v], .normal = normalize(normals[v]), .bones = {}};
            std::vector<std::pair<double, int>> weights;
            for (std::size_t j = 0; j < J; ++j)
                if (body.weights[v * J + j] > 0) weights.emplace_back(-body.weights[v * J + j], static_cast<int>(j));
            std::sort(weights.begin(), weights.end());
            weights.resize(std::min<std::size_t>(weights.size(), sample.bones.size()));
            double sum = 0;
            for (const auto& [weight, joint] : weights) sum -= weight;
            for (std::size_t k = 0; k < weights.size(); ++k)
                sample.bones[k] = {weights[k].second, -weights[k].first / sum};
            samples_.push_back(sample);
            const auto joint = static_cast<std::size_t>(sample.bones[0].joint);
            const auto S = static_cast<std::size_t>(fitted.shape_count);
            for (std::size_t k = 0; k < S; ++k) {
                const vec3<double> direction = body.shapedirs[v * static_cast<std::size_t>(body.shape_count) + k];
                directions_.push_back(direction);
                relative_.push_back(direction - fitted.directions[joint * S + k]);
            }
        }
    }

    /// How the offset of a sample from its joint, at rest, follows the shape: [S].
    [[nodiscard]] Span<const vec3<double>> directions(std::size_t sample) const {
        const std::size_t S = samples_.empty() ? 0 : relative_.size() / samples_.size();
        return Span<const vec3<double>>(relative_).subspan(sample * S, S);
    }

    [[nodiscard]] std::size_t size() const { return samples_.size(); }
    /// A sample's place on the body at rest.
    [[nodiscard]] const vec3<double>& rest(std::size_t sample) const { return samples_[sample].rest; }

    /// The samples on the outline of a posed body, also where it lies before or behind other parts of the body.
    [[nodiscard]] std::vector<RimPoint> rim(const FittedBody& body, const FrameKinematics& kinematics,
                                            Span<const double> betas, const Camera<double>& camera,
                                            double focal) const {
        const auto S = static_cast<std::size_t>(body.shape_count);
        const std::vector<vec3<double>> rest = body.rest_joints(betas);
        const vec3<double> eye = camera.center();
        std::vector<RimPoint> result;
        for (std::size_t i = 0; i < samples_.size(); ++i) {
            const Sample& sample = samples_[i];
            vec3<double> shaped = sample.rest;
            for (std::size_t k = 0; k < S; ++k) shaped += directions_[i * S + k] * betas[k];
            vec3<double> posed(0), normal(0);
            for (const auto& [joint, weight] : sample.bones) {
                if (weight == 0) continue;
                const auto j = static_cast<std::size_t>(joint);
                posed += kinematics.point(j, shaped - rest[j]) * weight;
                normal += kinematics.rotation(j) * sample.normal * weight;
            }
            normal = normalize(normal);
            constexpr double grazing = 0.12; // sine of the angle between sight and surface
            if (std::abs(dot(normalize(posed - eye), normal)) > grazing) continue;
            const vec3<double> x = to_camera(camera, posed), n = camera.R * normal;
            if (x.z < 0.1) continue;
            const vec2<double> across{n.x - x.x / x.z * n.z, n.y - x.y / x.z * n.z};
            const double size = std::hypot(across.x, across.y);
            if (size < 0.5) continue;
            result.push_back({i,
                              posed,
                              {focal * camera.fx * x.x / x.z + camera.cx, focal * camera.fy * x.y / x.z + camera.cy},
                              across * (1 / size),
                              focal * camera.fx / x.z});
        }
        return result;
    }

    /// How far the mask's outline lies outside of a point of the body's, in pixels along the normal: the nearest place
    /// within `reach` metres where the mask ends. No value if there is none, as for an arm before the trunk.
    [[nodiscard]] static std::optional<double> mask_distance(const RimPoint& point, const MaskView& mask,
                                                             double reach) {
        const auto at = [&](int step) {
            return mask.at(point.pixel.x + point.normal.x * step, point.pixel.y + point.normal.y * step);
        };
        const int steps = std::max(2, static_cast<int>(std::ceil(reach * point.pixels_per_metre)));
        std::optional<double> nearest;
        double before = at(-steps);
        for (int k = 1 - steps; k <= steps; ++k) {
            const double here = at(k);
            if (before >= 0.5 && here < 0.5) {
                const double place = k - 1 + (before - 0.5) / (before - here);
                if (!nearest || std::abs(place) < std::abs(*nearest)) nearest = place;
            }
            before = here;
        }
        return nearest;
    }

    /// Points of the outline of a posed body that have the mask's outline before or behind them, at most `reach` metres
    /// away.
    [[nodiscard]] std::vector<OutlinePoint> find(const FittedBody& body, const FrameNumbers& numbers,
                                                 Span<const double> betas, const Camera<double>& camera, double focal,
                                                 const MaskView& mask, double reach) const {
        const FrameKinematics kinematics(body, numbers, betas);
        std::vector<OutlinePoint> result;
        for (const RimPoint& point : rim(body, kinematics, betas, camera, focal)) {
            const std::optional<double> distance = mask_distance(point, mask, reach);
            if (!distance) continue;
            const int joint = samples_[point.sample].bones[0].joint;
            const auto j = static_cast<std::size_t>(joint);
            result.push_back({joint, transposed_times(kinematics.rotation(j), point.position - kinematics.joint(j)),
                              point.sample, point.normal, point.pixel + point.normal * *distance});
        }
        return result;
    }

private:
    struct Bone {
        int joint = 0;
        double weight = 0;
    };
    struct Sample {
        vec3<double> rest, normal;
        std::array<Bone, 4> bones;
    };
    std::vector<Sample> samples_;
    std::vector<vec3<double>> directions_; // [samples, S] of the point
    std::vector<vec3<double>> relative_;   // [samples, S] of the point relative to its joint
};

} // namespace gsh
