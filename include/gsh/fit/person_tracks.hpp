// SPDX-License-Identifier: Apache-2.0
/// @file  Follows people through the frames of one camera, as far as there is no doubt who is who.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/fit/person_sights.hpp>
#include <gsh/math/assignment.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// Sights of one person in one camera, as indices, in the order of their frames.
using PersonTrack = std::vector<std::size_t>;

/// The velocity at the end of a track, or at its begin, in pixels a second: the medians of the slopes between each two
/// of at most five sights in 0.6 seconds, so that one of them may be wrong. Zero for fewer than three.
///
/// Source  Sen, "Estimates of the regression coefficient based on Kendall's tau", 1968.
[[nodiscard]] inline vec2<double> track_velocity(Span<const PersonSight> sights, const PersonTrack& track,
                                                 bool at_end) {
    const auto sight = [&](std::size_t k) -> const PersonSight& {
        return sights[at_end ? track[track.size() - 1 - k] : track[k]];
    };
    std::size_t count = 0;
    while (count < std::min<std::size_t>(5, track.size()) && std::abs(sight(count).time - sight(0).time) <= 0.6)
        ++count;
    if (count < 3) return vec2<double>(0);
    std::vector<double> xs, ys;
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = a + 1; b < count; ++b) {
            const vec2<double> slope = (sight(b).middle - sight(a).middle) * (1 / (sight(b).time - sight(a).time));
            xs.push_back(slope.x), ys.push_back(slope.y);
        }
    return {median(std::move(xs)), median(std::move(ys))};
}

/// Follows people from frame to frame: each goes on, at its velocity, to one of the people in the next frame, in the
/// cheapest assignment of all. A track ends where another choice is nearly as good, as where two people cross, or one
/// of them hides the other: who is who there is decided by what comes before and after. A person who is missed for 0.35
/// seconds at most is found again.
///
/// Shapes  sights are those of one camera, in the order of their frames; each is in exactly one of the tracks, which
///         are in the order of their first frames.
[[nodiscard]] inline std::vector<PersonTrack> person_tracks(Span<const PersonSight> sights, double frame_seconds) {
    struct Followed {
        PersonTrack track;
        bool open = true;    // may go on
        bool hidden = false; // ended without a successor: may stand behind another person
    };
    const double reach = std::max(0.35, 1.5 * frame_seconds), memory = std::max(1.0, reach);
    constexpr double clearly = 1.5, margin = 0.06; // of the person's size: what crosses nearer is in doubt
    std::vector<Followed> all;
    std::vector<std::size_t> recent; // of `all`, that were seen within `memory`
    for (std::size_t begin = 0; begin < sights.size();) {
        std::size_t end = begin;
        while (end < sights.size() && sights[end].frame == sights[begin].frame) ++end;
        const double now = sights[begin].time;
        const std::size_t found = end - begin;
        std::erase_if(recent, [&](std::size_t i) {
            const double gap = now - sights[all[i].track.back()].time;
            if (gap > reach && all[i].open) all[i].open = false, all[i].hidden = true;
            return gap > memory || (!all[i].open && !all[i].hidden);
        });
        // Distances, and the same in units of how far a person may move in this time.
        std::vector<double> distances(recent.size() * found), costs(recent.size() * found, 2.0);
        for (std::size_t r = 0; r < recent.size(); ++r) {
            const Followed& from = all[recent[r]];
            const PersonSight& last = sights[from.track.back()];
            const double gap = now - last.time;
            const vec2<double> velocity = track_velocity(sights, from.track, true), moved = velocity * gap;
            const bool known = velocity != vec2<double>(0);
            const double most = std::min(known ? 0.12 + gap : 0.2 + 1.5 * gap, 0.6);
            for (std::size_t k = 0; k < found; ++k) {
                double& distance = distances[r * found + k];
                distance = image_distance(last, sights[begin + k], moved);
                if (from.open) costs[r * found + k] = distance / most;
            }
        }
        const std::vector<int> next = cheapest_assignment(costs, recent.size(), found, 1);
        std::vector<bool> taken(found, false);
        std::vector<std::size_t> doubtful; // tracks that end here
        for (std::size_t r = 0; r < recent.size(); ++r) {
            if (next[r] < 0) continue;
            const auto chosen = static_cast<std::size_t>(next[r]);
            const double rival = clearly * distances[r * found + chosen] + margin;
            bool doubt = false;
            for (std::size_t k = 0; k < found; ++k) doubt |= k != chosen && distances[r * found + k] < rival;
            for (std::size_t other = 0; other < recent.size(); ++other)
                if (other != r && distances[other * found + chosen] < rival) {
                    doubt = true;
                    if (next[other] < 0) all[recent[other]].open = false, all[recent[other]].hidden = true;
                }
            if (doubt)
                doubtful.push_back(recent[r]);
            else
                taken[chosen] = true, all[recent[r]].track.push_back(begin + chosen);
        }
        for (const std::size_t i : doubtful) all[i].open = false;
        for (std::size_t k = 0; k < found; ++k)
            if (!taken[k]) recent.push_back(all.size()), all.push_back({.track = {begin + k}});
        begin = end;
    }
    std::vector<PersonTrack> tracks;
    for (Followed& followed : all) tracks.push_back(std::move(followed.track));
    return tracks;
}

} // namespace gsh
