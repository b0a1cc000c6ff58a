// SPDX-License-Identifier: Apache-2.0
/// @file  Tells which of the people in each photograph is which person.
#pragma once

#include <gsh/body/keypoints.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/person_sights.hpp>
#include <gsh/fit/person_tracks.hpp>
#include <gsh/fit/track_groups.hpp>
#include <gsh/fit/triangulation.hpp>
#include <gsh/math/assignment.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// Who is who.
struct AssociatedPeople {
    std::size_t count = 0;   ///< people that are told apart; fewer than asked for if there are no more
    std::size_t in_view = 0; ///< people who are seen for a quarter as long, and as large, as the first, or more
    std::vector<std::vector<int>> person_of; ///< [photos] of [people in it]: the person, or -1
};

struct AssociationParams {
    std::optional<std::size_t> count = {}; ///< people to tell apart; found if not given
};

/// Tells who is who in the photographs of a detector that lists people in no order, misses some, and finds things that
/// are no people.
///
/// Stages: (1) people are followed through the frames of each camera, as long as there is no doubt (person_tracks); (2)
/// tracks of half a second or more are joined to people, by what comes before and after gaps, and by the rays of
/// different cameras (TrackGroups); the people are those who are seen longest and largest; (3) in each photograph,
/// everybody gets one of the detections or none, in the cheapest assignment: near the place between the detections
/// before and after, and near the points that other cameras triangulate. Stage 3 runs twice.
///
/// People are numbered from left to right, as they stand in the first photograph that shows the most of them. A single
/// person is the one who is seen longest and largest in the whole video. Of a camera that contradicts the others, a
/// single person keeps the largest, so that a fit can tell how wrong the calibration is.
///
/// Shapes  cameras [C]; photos in any order, at most one for each camera and frame; times [T] ascending, seconds. The
///         result depends neither on the order of the photographs nor on that of the people in them.
/// Errors  ValueError for a camera or frame that does not exist, a photograph that occurs twice, keypoints that are not
///         finite, times that do not ascend, or a count of 0.
[[nodiscard]] inline AssociatedPeople associate_people(const std::vector<Camera<double>>& cameras,
                                                       const std::vector<PhotoKeypoints>& photos,
                                                       const std::vector<double>& times,
                                                       const AssociationParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The people in all photographs, ordered by camera, frame, and place in the image.
inline std::vector<PersonSight> sights_of(const std::vector<Camera<double>>& cameras,
                                          const std::vector<PhotoKeypoints>& photos, const std::vector<double>& times) {
    constexpr const char* where = "associate_people";
    for (std::size_t t = 1; t < times.size(); ++t)
        check_value(times[t] > times[t - 1], where,
                    "frame " + std::to_string(t) + " is not later than the frame before it; times must ascend");
    std::vector<bool> known(cameras.size() * times.size(), false);
    std::vector<PersonSight> sights;
    for (std::size_t i = 0; i < photos.size(); ++i) {
        const PhotoKeypoints& photo = photos[i];
        const std::string of =
            "photograph of camera " + std::to_string(photo.camera) + " and frame " + std::to_string(photo.frame);
        check_value(photo.camera < cameras.size() && photo.frame < times.size(), where,
                    of + ", expected one of " + std::to_string(cameras.size()) + " cameras and " +
                        std::to_string(times.size()) + " frames");
        const std::size_t place = photo.camera * times.size() + photo.frame;
        check_value(!known[place], where, of + " is given twice");
        known[place] = true;
        std::vector<PersonSight> found = people_in_sight(photo, i, times[photo.frame]);
        sights.insert(sights.end(), std::make_move_iterator(found.begin()), std::make_move_iterator(found.end()));
    }
    const auto place = [](const PersonSight& s) { return std::tuple(s.camera, s.frame, s.middle.x, s.middle.y); };
    std::sort(sights.begin(), sights.end(),
              [&](const PersonSight& a, const PersonSight& b) { return place(a) < place(b); });
    return sights;
}

/// The seconds from frame to frame.
inline double frame_seconds(const std::vector<double>& times) {
    return times.size() > 1 ? (times.back() - times.front()) / static_cast<double>(times.size() - 1) : 1;
}

/// Stage 3: who each sight is, from who all others are. Cameras that are not trusted are looked at alone.
class PeopleInPhotos {
public:
    /// The first `wanted` of the people are those that are asked for.
    PeopleInPhotos(Span<const Camera<double>> cameras, std::vector<bool> trusted, Span<const PersonSight> sights,
                   std::size_t people, std::size_t wanted, std::size_t frame_count, double frame_seconds)
        : cameras_(cameras), trusted_(std::move(trusted)), sights_(sights), people_(people), wanted_(wanted),
          frames_(frame_count), memory_(std::max(1.0, 2.5 * frame_seconds)) {}

    [[nodiscard]] std::vector<int> assign(const std::vector<int>& before) const {
        // Where each person is in each camera and frame, or -1.
        std::vector<int> place(people_ * cameras_.size() * frames_, -1);
        const auto at = [&](std::size_t person, std::size_t camera, std::size_t frame) {
            return (person * cameras_.size() + camera) * frames_ + frame;
        };
        for (std::size_t s = 0; s < sights_.size(); ++s)
            if (before[s] >= 0)
                place[at(static_cast<std::size_t>(before[s]), sights_[s].camera, sights_[s].frame)] =
                    static_cast<int>(s);
        std::vector<int> result(sights_.size(), -1);
        for (std::size_t begin = 0; begin < sights_.size();) {
            std::size_t end = begin;
            const std::size_t c = sights_[begin].camera, t = sights_[begin].frame;
            while (end < sights_.size() && sights_[end].camera == c && sights_[end].frame == t) ++end;
            const std::size_t found = end - begin;
            std::vector<double> costs(people_ * found);
            for (std::size_t p = 0; p < people_; ++p) {
                const auto near = [&](int step) -> const PersonSight* { // the nearest sight before or after
                    for (auto f = static_cast<std::ptrdiff_t>(t) + step; f >= 0; f += step) {
                        if (f >= static_cast<std::ptrdiff_t>(frames_)) break;
                        if (const int s = place[at(p, c, static_cast<std::size_t>(f))]; s >= 0) {
                            const PersonSight& sight = sights_[static_cast<std::size_t>(s)];
                            return std::abs(sight.time - sights_[begin].time) <= memory_ ? &sight : nullptr;
                        }
                    }
                    return nullptr;
                };
                const PersonSight *earlier = near(-1), *later = near(1);
                std::vector<const PersonSight*> others; // of the same moment in other cameras
                for (std::size_t k = 0; k < cameras_.size(); ++k)
                    if (const int s = place[at(p, k, t)]; k != c && s >= 0 && trusted_[c] && trusted_[k])
                        others.push_back(&sights_[static_cast<std::size_t>(s)]);
                const std::optional<PersonSight> seen = projected(others, c);
                for (std::size_t k = 0; k < found; ++k) {
                    const PersonSight& sight = sights_[begin + k];
                    const bool kept = before[begin + k] == static_cast<int>(p);
                    constexpr double rival = 0.4; // others may be unjoined tracks of one of those who are wanted
                    costs[p * found + k] = cost(sight, earlier, later, others, seen, kept) + (p < wanted_ ? 0 : rival);
                }
            }
            const std::vector<int> choice = cheapest_assignment(costs, people_, found, 1);
            for (std::size_t p = 0; p < people_; ++p)
                if (choice[p] >= 0) result[begin + static_cast<std::size_t>(choice[p])] = static_cast<int>(p);
            begin = end;
        }
        return result;
    }

private:
    Span<const Camera<double>> cameras_;
    std::vector<bool> trusted_;
    Span<const PersonSight> sights_;
    std::size_t people_, wanted_, frames_;
    double memory_; // seconds

    /// Costs are in units of what is usual; a person does without a detection that costs 1 or more.
    [[nodiscard]] double cost(const PersonSight& sight, const PersonSight* earlier, const PersonSight* later,
                              const std::vector<const PersonSight*>& others, const std::optional<PersonSight>& seen,
                              bool kept) const {
        constexpr double never = 2, bonus = 0.2, alone = 0.5;
        double sum = 0, count = 0;
        if (earlier || later) {
            const double gap =
                std::min(earlier ? sight.time - earlier->time : memory_, later ? later->time - sight.time : memory_);
            if (earlier && later) {
                const double u = (sight.time - earlier->time) / (later->time - earlier->time);
                sum += image_distance(between(*earlier, *later, u), sight) / (0.1 + 0.5 * gap);
            } else {
                sum += image_distance(earlier ? *earlier : *later, sight) / (0.12 + 1.5 * std::min(gap, 0.4));
            }
            count += 1;
        }
        if (seen) {
            constexpr double usual = 0.12; // of the person's size; clocks differ by up to two frames
            sum += image_distance(*seen, sight) / usual, count += 1;
        } else if (others.size() == 1) {
            constexpr double usual = 0.15, doubt = 0.2; // metres; one other camera sees no depth
            if (const auto distance =
                    ray_distance(cameras_[others[0]->camera], *others[0], cameras_[sight.camera], sight))
                sum += *distance / usual + doubt, count += 1;
        }
        if (count == 0) return kept ? alone : never;
        return sum / count - (kept ? bonus : 0);
    }

    /// A person on the way from one sight to another.
    [[nodiscard]] static PersonSight between(const PersonSight& a, const PersonSight& b, double u) {
        PersonSight result = a;
        for (std::size_t k = 0; k < a.points.size(); ++k)
            result.points[k] =
                a.points[k] && b.points[k] ? std::optional(*a.points[k] * (1 - u) + *b.points[k] * u) : std::nullopt;
        result.middle = a.middle * (1 - u) + b.middle * u;
        result.size = std::max(a.size, b.size);
        return result;
    }

    /// What a camera should see of a person whom at least two others see.
    [[nodiscard]] std::optional<PersonSight> projected(const std::vector<const PersonSight*>& others,
                                                       std::size_t camera) const {
        if (others.size() < 2) return std::nullopt;
        PersonSight result;
        vec2<double> low(1e300), high(-1e300);
        double count = 0;
        for (std::size_t k = 0; k < result.points.size(); ++k) {
            std::vector<SightLine> lines;
            for (const PersonSight* other : others)
                if (other->points[k]) lines.push_back({&cameras_[other->camera], *other->points[k]});
            const auto point = triangulate(lines);
            constexpr double most = 0.15; // metres
            if (!point || point->distance > most) continue;
            const vec3<double> x = to_camera(cameras_[camera], point->position);
            if (x.z < 0.1) continue;
            const vec2<double> pixel = to_pixel(cameras_[camera], x);
            result.points[k] = pixel;
            low = {std::min(low.x, pixel.x), std::min(low.y, pixel.y)};
            high = {std::max(high.x, pixel.x), std::max(high.y, pixel.y)};
            result.middle += pixel, count += 1;
        }
        constexpr double fewest = 4;
        if (count < fewest) return std::nullopt;
        result.middle = result.middle / count;
        result.size = std::max(high.x - low.x, high.y - low.y);
        return result;
    }
};

/// The people from left to right in the first photograph that shows the most of them.
inline std::vector<int> left_to_right(Span<const PersonSight> sights, const std::vector<int>& person, int people) {
    std::vector<int> best, order;
    for (std::size_t begin = 0; begin < sights.size();) { // sights of a photograph are in the order of their places
        std::size_t end = begin;
        std::vector<int> here;
        for (; end < sights.size() && sights[end].photo == sights[begin].photo; ++end)
            if (person[end] >= 0) here.push_back(person[end]);
        if (here.size() > best.size()) best = here;
        begin = end;
    }
    order = best;
    for (int p = 0; p < people; ++p)
        if (std::find(best.begin(), best.end(), p) == best.end()) order.push_back(p);
    return order;
}

} // namespace detail

inline AssociatedPeople associate_people(const std::vector<Camera<double>>& cameras,
                                         const std::vector<PhotoKeypoints>& photos, const std::vector<double>& times,
                                         const AssociationParams& params) {
    constexpr const char* where = "associate_people";
    check_value(!params.count || *params.count > 0, where, "the number of people must be at least 1");
    const std::vector<PersonSight> sights = detail::sights_of(cameras, photos, times);
    const double interval = detail::frame_seconds(times);
    AssociatedPeople result;
    for (const PhotoKeypoints& photo : photos) result.person_of.emplace_back(photo.people.size(), -1);

    // Tracks of each camera; the shorter ones wait for stage 3, unless there are no others.
    std::vector<PersonTrack> tracks;
    for (std::size_t begin = 0; begin < sights.size();) {
        std::size_t end = begin;
        while (end < sights.size() && sights[end].camera == sights[begin].camera) ++end;
        for (PersonTrack& track :
             person_tracks(Span<const PersonSight>(sights).subspan(begin, end - begin), interval)) {
            for (std::size_t& s : track) s += begin;
            tracks.push_back(std::move(track));
        }
        begin = end;
    }
    const auto least = std::clamp<std::size_t>(times.size() / 4, 1, 5);
    const auto is_long = [&](const PersonTrack& track) { return track.size() >= least; };
    if (std::any_of(tracks.begin(), tracks.end(), is_long))
        std::erase_if(tracks, [&](const PersonTrack& track) { return !is_long(track); });

    TrackGroups joined(cameras, sights, tracks);
    const auto in_view = [&] {
        constexpr double share = 0.25;
        const auto groups = joined.groups();
        return static_cast<std::size_t>(std::count_if(groups.begin(), groups.end(), [&](const TrackGroup& group) {
            return group.weight >= share * groups[0].weight;
        }));
    };
    joined.join_distant(1, [&] { return in_view() > params.count.value_or(1); });
    result.in_view = in_view();
    if (params.count) joined.join_distant(2, [&] { return in_view() > *params.count; });
    const std::vector<TrackGroup> groups = joined.groups();
    constexpr double least_share = 0.05; // of the heaviest: less is no person
    const auto found = static_cast<std::size_t>(std::count_if(
        groups.begin(), groups.end(), [&](const TrackGroup& g) { return g.weight >= least_share * groups[0].weight; }));
    result.count = std::min(found, params.count.value_or(result.in_view));
    // Others in view take part in the choices of stage 3, so that nobody gets their detections.
    std::vector<int> person(sights.size(), -1);
    std::size_t people = 0;
    for (const TrackGroup& group : groups) {
        constexpr double least_rival = 0.1;
        if (people >= result.count && group.weight < least_rival * groups[0].weight) break;
        for (const std::size_t track : group.tracks)
            for (const std::size_t s : tracks[track]) person[s] = static_cast<int>(people);
        ++people;
    }
    std::vector<bool> trusted(cameras.size(), true);
    if (result.count == 1) {
        trusted.assign(cameras.size(), false);
        for (std::size_t s = 0; s < sights.size(); ++s)
            if (person[s] == 0) trusted[sights[s].camera] = true;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (trusted[c]) continue;
            const auto shows = [&](std::size_t track) { return sights[tracks[track][0]].camera == c; };
            const auto heaviest = std::find_if(groups.begin(), groups.end(), [&](const TrackGroup& group) {
                return std::any_of(group.tracks.begin(), group.tracks.end(), shows);
            });
            if (heaviest == groups.end()) continue;
            for (const std::size_t track : heaviest->tracks)
                if (shows(track))
                    for (const std::size_t s : tracks[track]) person[s] = 0;
        }
    }
    const detail::PeopleInPhotos in_photos(cameras, trusted, sights, people, result.count, times.size(), interval);
    for (int pass = 0; pass < 2; ++pass) person = in_photos.assign(person);
    for (int& p : person)
        if (p >= static_cast<int>(result.count)) p = -1;

    const std::vector<int> order = detail::left_to_right(sights, person, static_cast<int>(result.count));
    std::vector<int> number(result.count, 0);
    for (std::size_t k = 0; k < order.size(); ++k) number[static_cast<std::size_t>(order[k])] = static_cast<int>(k);
    for (std::size_t s = 0; s < sights.size(); ++s)
        if (person[s] >= 0)
            result.person_of[sights[s].photo][sights[s].number] = number[static_cast<std::size_t>(person[s])];
    return result;
}

} // namespace gsh
