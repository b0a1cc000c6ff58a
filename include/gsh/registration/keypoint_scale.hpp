// SPDX-License-Identifier: Apache-2.0
/// @file  Tells keypoints that were found in images of another size, by the joints of estimated poses.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/body/motion_landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace gsh {

/// The factor of each camera by which its keypoints lie farther from the image's corner than the joints that they show:
/// 0.5 if they were found in images of half the size. No value if there is no clear one: a factor must differ from 1 by
/// a quarter, explain the distances between keypoints and joints to 40% or less, and these must be large, 5% of the
/// image's height. Poses of an estimator therefore have none.
///
/// Shapes  result [cameras]; posed [P], the people's estimated landmarks.
[[nodiscard]] inline std::vector<std::optional<double>> keypoint_scales(const std::vector<PhotoKeypoints>& found,
                                                                        const std::vector<Camera<double>>& cameras,
                                                                        const std::vector<MotionLandmarks>& posed);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Sums over pairs of a keypoint k and its joint's pixel p.
struct ScaleSums {
    double kp = 0, pp = 0, kk = 0, count = 0;

    void add(const vec2<double>& k, const vec2<double>& p, double weight) {
        const auto product = [](const vec2<double>& a, const vec2<double>& b) { return a.x * b.x + a.y * b.y; };
        kp += weight * product(k, p), pp += weight * product(p, p), kk += weight * product(k, k), count += weight;
    }
    void add(const ScaleSums& other) { kp += other.kp, pp += other.pp, kk += other.kk, count += other.count; }
    [[nodiscard]] double scale() const { return pp > 0 ? kp / pp : 0; }
    /// Root of the mean square of k - s p.
    [[nodiscard]] double distance(double s) const {
        return count > 0 ? std::sqrt(std::fmax(0.0, kk - 2 * s * kp + s * s * pp) / count) : 0;
    }
    /// Distance of k / s to p, s being the scale.
    [[nodiscard]] double misfit() const { return distance(scale()) / scale(); }
};

} // namespace detail

inline std::vector<std::optional<double>> keypoint_scales(const std::vector<PhotoKeypoints>& found,
                                                          const std::vector<Camera<double>>& cameras,
                                                          const std::vector<MotionLandmarks>& posed) {
    std::vector<detail::ScaleSums> sums(cameras.size());
    for (const PhotoKeypoints& photo : found) {
        const Camera<double>& camera = cameras[photo.camera];
        std::optional<detail::ScaleSums> best; // of all people and detections, those whose shapes agree most
        for (const MotionLandmarks& body : posed)
            for (const Detection& person : photo.people) {
                detail::ScaleSums pair;
                std::size_t points = 0;
                for (const Keypoint& point : person.points) {
                    if (!body.has(point.landmark)) continue;
                    const vec3<double> x = to_camera(camera, body.at(photo.frame, point.landmark));
                    if (x.z < 0.01) continue;
                    pair.add(point.pixel, to_pixel(camera, x), point.confidence), ++points;
                }
                if (points >= 4 && pair.scale() > 0 && (!best || pair.misfit() < best->misfit())) best = pair;
            }
        if (best) sums[photo.camera].add(*best);
    }
    std::vector<std::optional<double>> scales(cameras.size());
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const double scale = sums[c].scale(), apart = sums[c].distance(1);
        if (!(scale > 0) || (scale > 0.8 && scale < 1.25)) continue;
        if (apart > 0.05 * cameras[c].height && sums[c].misfit() < 0.4 * apart) scales[c] = scale;
    }
    return scales;
}

} // namespace gsh
