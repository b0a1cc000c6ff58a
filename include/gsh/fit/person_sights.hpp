// SPDX-License-Identifier: Apache-2.0
/// @file  Detected people as they are compared with each other: between moments of one camera, and between cameras.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// The landmarks by which people are compared: those of the left side each before its partner of the right side, then
/// those of the middle.
inline constexpr std::size_t sided_sight_points = 20;
inline constexpr std::array<int, sided_sight_points + 2> sight_landmarks = [] {
    constexpr std::array<std::string_view, sided_sight_points / 2> sided{
        "left_ear",  "left_shoulder", "left_elbow", "left_wrist", "left_hip",
        "left_knee", "left_ankle",    "left_heel",  "left_foot",  "left_big_toe"};
    std::array<int, sided_sight_points + 2> result{};
    for (std::size_t k = 0; k < sided.size(); ++k)
        result[2 * k] = landmark_number(sided[k]), result[2 * k + 1] = mirrored_landmark(result[2 * k]);
    result[sided_sight_points] = landmark_number("nose"), result[sided_sight_points + 1] = landmark_number("neck");
    return result;
}();

/// A person in a photograph.
struct PersonSight {
    std::size_t photo = 0, number = 0; ///< which of the photographs, and which of its people
    std::size_t camera = 0, frame = 0;
    double time = 0;                                                          ///< seconds
    std::array<std::optional<vec2<double>>, sight_landmarks.size()> points{}; ///< pixels, where the detector is sure
    vec2<double> middle{0};                                                   ///< of the points
    double size = 0;                                                          ///< longer side of their box, pixels
    double trust = 0;                                                         ///< sum of confidences
};

/// The people of a photograph of whom at least three points are sure. Where two lie on each other, within 4% of their
/// size, a detector has found one person twice: that with the larger sum of confidences stays.
inline std::vector<PersonSight> people_in_sight(const PhotoKeypoints& photo, std::size_t photo_number, double time);

/// How far a person has to be moved to lie on another one in the same camera, after a translation by `moved` pixels:
/// the median distance of shared points, in units of the larger person's size. Left and right count as they fit best,
/// because detectors swap them.
[[nodiscard]] inline double image_distance(const PersonSight& a, const PersonSight& b,
                                           const vec2<double>& moved = vec2<double>(0));

/// How far the rays of a person's points in one camera pass by those of a person in another camera at the same time:
/// the median over shared points, metres, at most 1. Rays that meet behind a camera, and those that meet in a body that
/// is no person's by its size, count as 1: two people of one height have rays that meet, too, but in dwarfs or giants.
/// No value if fewer than four points are shared, or their rays are parallel.
[[nodiscard]] inline std::optional<double> ray_distance(const Camera<double>& camera_a, const PersonSight& a,
                                                        const Camera<double>& camera_b, const PersonSight& b);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The place of a point's partner among sight_landmarks.
[[nodiscard]] constexpr std::size_t mirrored_sight_point(std::size_t point) {
    return point < sided_sight_points ? point ^ 1 : point;
}

/// The median of the numbers that `at` returns for each point, with sides as they are or swapped, whichever is less.
/// No value for fewer than `fewest`.
template <class At>
[[nodiscard]] std::optional<double> median_over_points(std::size_t fewest, const At& at) {
    std::optional<double> least;
    for (const bool swapped : {false, true}) {
        std::vector<double> found;
        for (std::size_t k = 0; k < sight_landmarks.size(); ++k)
            if (const std::optional<double> one = at(k, swapped ? mirrored_sight_point(k) : k)) found.push_back(*one);
        if (found.size() < fewest) continue;
        const double middle = median(std::move(found));
        if (!least || middle < *least) least = middle;
    }
    return least;
}

struct MeetingRays {
    vec3<double> place{0}; ///< between the nearest points of both
    double distance = 0;   ///< metres
    bool before = false;   ///< whether both cameras look towards it
    double sine = 0;       ///< of the angle between the rays
};
/// No value if the rays are parallel within two degrees.
inline std::optional<MeetingRays> meeting_rays(const Camera<double>& camera_a, const vec2<double>& pixel_a,
                                               const Camera<double>& camera_b, const vec2<double>& pixel_b) {
    const auto direction = [](const Camera<double>& camera, const vec2<double>& pixel) {
        return normalize(transposed_times(
            camera.R, vec3<double>((pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy, 1)));
    };
    const vec3<double> u = direction(camera_a, pixel_a), v = direction(camera_b, pixel_b);
    const vec3<double> from = camera_a.center(), apart = camera_b.center() - from;
    const double cosine = dot(u, v), sine2 = 1 - cosine * cosine;
    constexpr double least_sine = 0.035;
    if (sine2 < least_sine * least_sine) return std::nullopt;
    const double s = (dot(apart, u) - cosine * dot(apart, v)) / sine2;
    const double t = (cosine * dot(apart, u) - dot(apart, v)) / sine2;
    const vec3<double> p = from + u * s, q = from + apart + v * t;
    return MeetingRays{(p + q) * 0.5, length(p - q), s > 0.1 && t > 0.1, std::sqrt(sine2)};
}

/// The usual length of a part of an adult between two points of sight_landmarks, metres.
struct SightBone {
    std::size_t from = 0, to = 0;
    double metres = 0;
};
inline constexpr std::array<SightBone, 10> sight_bones{{
    {2, 8, 0.5},
    {3, 9, 0.5}, // shoulder to hip
    {8, 10, 0.41},
    {9, 11, 0.41},
    {10, 12, 0.4},
    {11, 13, 0.4}, // thigh, shank
    {2, 4, 0.28},
    {3, 5, 0.28},
    {4, 6, 0.25},
    {5, 7, 0.25}, // upper arm, forearm
}};

} // namespace detail

inline double image_distance(const PersonSight& a, const PersonSight& b, const vec2<double>& moved) {
    const double size = std::max(a.size, b.size);
    const auto shared = detail::median_over_points(3, [&](std::size_t k, std::size_t l) -> std::optional<double> {
        if (!a.points[k] || !b.points[l]) return std::nullopt;
        const vec2<double> off = *a.points[k] + moved - *b.points[l];
        return std::hypot(off.x, off.y) / size;
    });
    if (shared) return *shared;
    const vec2<double> off = a.middle + moved - b.middle;
    constexpr double doubt = 0.1; // other parts of a person are seen
    return doubt + std::hypot(off.x, off.y) / size;
}

inline std::optional<double> ray_distance(const Camera<double>& camera_a, const PersonSight& a,
                                          const Camera<double>& camera_b, const PersonSight& b) {
    constexpr double most = 1;
    std::array<std::optional<vec3<double>>, sight_landmarks.size()> places;
    const auto distance = detail::median_over_points(4, [&](std::size_t k, std::size_t l) -> std::optional<double> {
        if (!a.points[k] || !b.points[l]) return std::nullopt;
        const auto meeting = detail::meeting_rays(camera_a, *a.points[k], camera_b, *b.points[l]);
        if (!meeting) return std::nullopt;
        constexpr double steep = 0.2;                                    // flatter rays do not tell the depth
        if (k == l && meeting->sine > steep) places[k] = meeting->place; // a swap of sides changes lengths by little
        return meeting->before ? std::min(most, meeting->distance) : most;
    });
    if (!distance) return std::nullopt;
    std::vector<double> ratios;
    for (const auto& [from, to, metres] : detail::sight_bones)
        if (places[from] && places[to]) ratios.push_back(length(*places[from] - *places[to]) / metres);
    constexpr double smallest = 0.45, largest = 1.6; // of an adult: a child of three, and errors of rays
    if (ratios.size() >= 3)
        if (const double ratio = median(ratios); ratio < smallest || ratio > largest) return most;
    return distance;
}

inline std::vector<PersonSight> people_in_sight(const PhotoKeypoints& photo, std::size_t photo_number, double time) {
    constexpr double least_confidence = 0.3, same = 0.04;
    constexpr std::size_t fewest = 3;
    std::vector<PersonSight> people;
    for (std::size_t n = 0; n < photo.people.size(); ++n) {
        PersonSight sight{
            .photo = photo_number, .number = n, .camera = photo.camera, .frame = photo.frame, .time = time};
        vec2<double> low(1e300), high(-1e300);
        double count = 0;
        for (const Keypoint& point : photo.people[n].points) {
            check_value(std::isfinite(point.pixel.x) && std::isfinite(point.pixel.y), "associate_people",
                        "photograph of camera " + std::to_string(photo.camera) + " and frame " +
                            std::to_string(photo.frame) + " has a keypoint that is not finite");
            const auto place = std::find(sight_landmarks.begin(), sight_landmarks.end(), point.landmark);
            if (place == sight_landmarks.end() || point.confidence < least_confidence) continue;
            sight.points[static_cast<std::size_t>(place - sight_landmarks.begin())] = point.pixel;
            sight.trust += point.confidence;
            low = {std::min(low.x, point.pixel.x), std::min(low.y, point.pixel.y)};
            high = {std::max(high.x, point.pixel.x), std::max(high.y, point.pixel.y)};
            sight.middle += point.pixel, count += 1;
        }
        sight.size = std::max(high.x - low.x, high.y - low.y);
        if (count < fewest || !(sight.size > 0)) continue;
        sight.middle = sight.middle / count;
        people.push_back(std::move(sight));
    }
    const auto rank = [](const PersonSight& s) { return std::tuple(-s.trust, s.middle.x, s.middle.y); };
    std::sort(people.begin(), people.end(),
              [&](const PersonSight& a, const PersonSight& b) { return rank(a) < rank(b); });
    std::vector<PersonSight> different;
    for (PersonSight& sight : people)
        if (std::none_of(different.begin(), different.end(),
                         [&](const PersonSight& other) { return image_distance(sight, other) < same; }))
            different.push_back(std::move(sight));
    return different;
}

} // namespace gsh
