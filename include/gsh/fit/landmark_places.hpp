// SPDX-License-Identifier: Apache-2.0
/// @file  Learns where a detector's landmarks lie on bodies, from photographs in which the poses are known.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_bones.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

/// Sightings of landmarks on bodies whose poses are known, collected over captures and people.
///
/// A landmark's offset o minimises the distances across the rays, Σ ρ(|R_cam (x_j + R_j o) + t - its ray|²), which are
/// linear in o; ρ is Geman-McClure's, which ignores outliers, with a scale of 1.5 times the median distance. Points of
/// the right side count as mirrored ones of the left, so that both sides share one offset.
class LandmarkSightings {
public:
    /// Adds every keypoint of `confidence` or more. The person must be the only one in each photograph.
    void add(const BodyModel& body, const Motion& motion, const std::vector<Camera<double>>& cameras,
             const std::vector<PhotoKeypoints>& photos, double confidence = 0.5) {
        const std::vector<int> joints = joints_by_name(body);
        std::vector<Affine<double>> bones; // [T, J]
        std::vector<vec3<double>> places;  // [T, J]
        for_each_pose(body, motion, [&](std::size_t, Span<const Affine<double>> at, Span<const vec3<double>> rest) {
            for (std::size_t j = 0; j < rest.size(); ++j) bones.push_back(at[j]), places.push_back(at[j](rest[j]));
        });
        for (const PhotoKeypoints& photo : photos) {
            if (photo.people.size() != 1) continue;
            const Camera<double>& camera = cameras[photo.camera];
            for (const Keypoint& point : photo.people[0].points) {
                if (point.confidence < confidence) continue;
                const vec2<double> ray{(point.pixel.x - camera.cx) / camera.fx,
                                       (point.pixel.y - camera.cy) / camera.fy};
                const bool right = point.landmark % 2 == 1;
                const auto row = static_cast<std::size_t>(point.landmark / 2);
                const int smplx = right ? mirrored_smplx_joint(landmark_places[row].joint) : landmark_places[row].joint;
                const std::size_t bone = photo.frame * body.joint_count() +
                                         static_cast<std::size_t>(joints[static_cast<std::size_t>(smplx)]);
                const mat3<double> turn = camera.R * bones[bone].linear;
                const vec3<double> place = to_camera(camera, places[bone]);
                Sighting seen;
                for (int k = 0; k < 3; ++k) { // r = start + Σ rows o
                    const double sign = right && k == 0 ? -1 : 1;
                    seen.x[k] = sign * (turn[k].x - ray.x * turn[k].z);
                    seen.y[k] = sign * (turn[k].y - ray.y * turn[k].z);
                }
                seen.start = {place.x - ray.x * place.z, place.y - ray.y * place.z};
                sightings_[row].push_back(seen);
            }
        }
    }

    struct Place {
        vec3<double> offset{0}; ///< metres, of the left side
        double spread = 0;      ///< median distance across the ray, metres
        std::size_t count = 0;  ///< sightings; below 8 there is no place
    };
    /// Where a row of landmark_places lies.
    [[nodiscard]] Place place(std::size_t row) const {
        const std::vector<Sighting>& sightings = sightings_.at(row);
        Place result{.count = sightings.size()};
        if (sightings.size() < 8) return result;
        std::vector<double> distances(sightings.size());
        for (int pass = 0; pass < 30; ++pass) {
            for (std::size_t i = 0; i < sightings.size(); ++i)
                distances[i] = std::hypot(sightings[i].start.x + dot(sightings[i].x, result.offset),
                                          sightings[i].start.y + dot(sightings[i].y, result.offset));
            result.spread = median(distances);
            const double scale = 1.5 * result.spread + 1e-4;
            mat3<double> A(1e-9);
            vec3<double> b(0);
            for (std::size_t i = 0; i < sightings.size(); ++i) {
                const Sighting& seen = sightings[i];
                const double d = distances[i] / scale, weight = 1 / ((1 + d * d) * (1 + d * d));
                A += (outer(seen.x, seen.x) + outer(seen.y, seen.y)) * weight;
                b += (seen.x * seen.start.x + seen.y * seen.start.y) * weight;
            }
            result.offset = inverse(A) * b * -1.0;
        }
        return result;
    }

private:
    /// The distance across a ray is start + (x · offset, y · offset).
    struct Sighting {
        vec3<double> x, y;
        vec2<double> start;
    };
    std::array<std::vector<Sighting>, landmark_places.size()> sightings_;
};

} // namespace gsh
