// SPDX-License-Identifier: Apache-2.0
/// @file  Joins tracks of one person: in one camera over gaps, and in several cameras by the agreement of their rays.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/person_sights.hpp>
#include <gsh/fit/person_tracks.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace gsh {

/// Tracks that belong to one person, by their number.
struct TrackGroup {
    std::vector<std::size_t> tracks;
    double weight = 0; ///< sum over the sights of the person's size as a share of the image's height
};

/// Groups of tracks, and how they grow.
///
/// Two tracks of one camera may be the same person if they share no moment. How likely they are is measured by how far
/// the person lies from where the velocity before the gap, and that after it, put it. Two tracks of different cameras
/// are the same person if their rays meet in their common frames, and are not if they do not. Groups with the largest
/// sum of evidence are joined first, until none has evidence that speaks for it.
///
/// Source  Keuper et al., "Efficient Decomposition of Image and Mesh Graphs by Lifted Multicuts", 2015: greedy additive
///         edge contraction; with pairs that must not be joined.
class TrackGroups {
public:
    /// `tracks` are of all cameras. They stay the caller's.
    TrackGroups(Span<const Camera<double>> cameras, Span<const PersonSight> sights, Span<const PersonTrack> tracks)
        : cameras_(cameras), sights_(sights), tracks_(tracks) {
        for (std::size_t i = 0; i < tracks.size(); ++i) {
            TrackGroup group{.tracks = {i}};
            for (const std::size_t s : tracks[i])
                group.weight += sights[s].size / std::max(1, cameras[sights[s].camera].height);
            groups_.push_back(std::move(group));
        }
        find_evidence();
        join_while([&] { return most_evident(); });
    }

    /// Joins groups that the time between them explains, those with the smallest steps first, as long as `wanted`
    /// returns true and a step is smaller than `most`, in units of what is usual for its time.
    template <class Wanted>
    void join_distant(double most, const Wanted& wanted) {
        join_while([&]() -> std::optional<std::pair<std::size_t, std::size_t>> {
            if (!wanted()) return std::nullopt;
            std::optional<std::pair<std::size_t, std::size_t>> best;
            double least = most;
            for (std::size_t a = 0; a < groups_.size(); ++a)
                for (std::size_t b = a + 1; b < groups_.size(); ++b)
                    if (const double found = step(a, b); found < least) least = found, best = {a, b};
            return best;
        });
    }

    /// The groups, heaviest first.
    [[nodiscard]] std::vector<TrackGroup> groups() const {
        std::vector<TrackGroup> result;
        for (const TrackGroup& group : groups_)
            if (!group.tracks.empty()) result.push_back(group);
        std::stable_sort(result.begin(), result.end(),
                         [](const TrackGroup& a, const TrackGroup& b) { return a.weight > b.weight; });
        return result;
    }

private:
    Span<const Camera<double>> cameras_;
    Span<const PersonSight> sights_;
    Span<const PersonTrack> tracks_;
    std::vector<TrackGroup> groups_; // those that were joined to others are empty
    std::vector<double> evidence_;   // [groups, groups] for being one person; below 0: against; -infinity: impossible

    static constexpr double impossible = -std::numeric_limits<double>::infinity();

    [[nodiscard]] const PersonSight& first(std::size_t i) const { return sights_[tracks_[i].front()]; }
    [[nodiscard]] const PersonSight& last(std::size_t i) const { return sights_[tracks_[i].back()]; }

    /// How far the later of two tracks of one camera lies from where the earlier one leads, and the reverse, in units
    /// of what is usual for the time between them.
    [[nodiscard]] double link(std::size_t i, std::size_t k) const {
        if (last(k).frame < first(i).frame) std::swap(i, k);
        const PersonTrack &before = tracks_[i], &after = tracks_[k];
        // The last or the first sights may be wrong: up to two of longer tracks do not count.
        const auto spare = [](const PersonTrack& track) { return std::min<std::size_t>(2, track.size() / 4); };
        double least = std::numeric_limits<double>::infinity();
        for (std::size_t less = 0; less <= spare(before); ++less)
            for (std::size_t later = 0; later <= spare(after); ++later) {
                const PersonTrack a(before.begin(), before.end() - static_cast<std::ptrdiff_t>(less)),
                    b(after.begin() + static_cast<std::ptrdiff_t>(later), after.end());
                const PersonSight &from = sights_[a.back()], &to = sights_[b.front()];
                const double gap = to.time - from.time;
                constexpr double longest = 0.7; // seconds, for which a velocity is believed
                const double led = std::min(gap, longest);
                const vec2<double> ahead = track_velocity(sights_, a, true), behind = track_velocity(sights_, b, false);
                const double distance =
                    0.5 * (image_distance(from, to, ahead * led) + image_distance(from, to, behind * led));
                const double resized = std::abs(std::log(from.size / to.size));
                double found = std::max(distance / (0.1 + 0.5 * gap), resized / (0.2 + 0.5 * gap));
                if (ahead != vec2<double>(0) && behind != vec2<double>(0)) { // nobody turns round while hidden
                    const double turned = std::hypot(ahead.x - behind.x, ahead.y - behind.y);
                    found = std::hypot(found, turned / std::max(from.size, to.size) / (0.3 + 0.5 * gap));
                }
                least = std::min(least, found);
            }
        return least;
    }

    /// Of two tracks of one camera.
    [[nodiscard]] double evidence_of_times(std::size_t i, std::size_t k) const {
        if (first(i).frame <= last(k).frame && first(k).frame <= last(i).frame) return impossible;
        const double gap = std::max(first(i).time - last(k).time, first(k).time - last(i).time);
        constexpr double weight = 10, fades = 1, longest = 1.5; // frames; seconds
        return gap > longest ? 0 : weight * std::exp(-gap / fades) * (1 - std::min(3.0, link(i, k)));
    }

    /// How rays of two tracks of different cameras meet.
    struct Meeting {
        double frames = 0, metres = 0; ///< in common; the median distance of rays
    };
    [[nodiscard]] Meeting meeting(std::size_t i, std::size_t k) const {
        std::vector<double> distances;
        const PersonTrack &a = tracks_[i], &b = tracks_[k];
        for (std::size_t x = 0, y = 0; x < a.size() && y < b.size();) {
            const PersonSight &p = sights_[a[x]], &q = sights_[b[y]];
            if (p.frame == q.frame)
                if (const auto distance = ray_distance(cameras_[p.camera], p, cameras_[q.camera], q))
                    distances.push_back(*distance);
            const bool advance_a = p.frame <= q.frame, advance_b = q.frame <= p.frame;
            x += advance_a, y += advance_b;
        }
        const auto frames = static_cast<double>(distances.size());
        return {frames, median(std::move(distances))};
    }

    void find_evidence() {
        const std::size_t n = tracks_.size();
        evidence_.assign(n * n, 0);
        std::vector<Meeting> meetings(n * n);
        std::vector<double> nearest; // of each track, the distance of the partner in another camera that fits best
        for (std::size_t i = 0; i < n; ++i) {
            for (std::size_t k = i + 1; k < n; ++k)
                if (first(i).camera != first(k).camera) meetings[i * n + k] = meetings[k * n + i] = meeting(i, k);
            double least = std::numeric_limits<double>::infinity();
            for (std::size_t k = 0; k < n; ++k)
                if (meetings[i * n + k].frames > 0) least = std::min(least, meetings[i * n + k].metres);
            if (std::isfinite(least)) nearest.push_back(least);
        }
        // What is near depends on the detector, the calibration, and clocks that differ by up to two frames.
        const double usual = std::clamp(3 * median(std::move(nearest)), 0.04, 0.25);
        for (std::size_t i = 0; i < n; ++i)
            for (std::size_t k = i + 1; k < n; ++k) {
                double& found = evidence_[i * n + k];
                const Meeting& met = meetings[i * n + k];
                constexpr double most_frames = 40; // neighbours err alike
                if (first(i).camera == first(k).camera)
                    found = evidence_of_times(i, k);
                else
                    found = std::min(most_frames, met.frames) * (1 - std::min(3.0, met.metres / usual));
                evidence_[k * n + i] = found;
            }
    }

    [[nodiscard]] std::optional<std::pair<std::size_t, std::size_t>> most_evident() const {
        std::optional<std::pair<std::size_t, std::size_t>> best;
        double most = 0;
        const std::size_t n = groups_.size();
        for (std::size_t a = 0; a < n; ++a)
            for (std::size_t b = a + 1; b < n; ++b)
                if (evidence_[a * n + b] > most) most = evidence_[a * n + b], best = {a, b};
        return best;
    }

    /// The mean over cameras that both groups know of the link between their tracks that are nearest in time; infinite
    /// if there is none, or if evidence speaks against them.
    [[nodiscard]] double step(std::size_t a, std::size_t b) const {
        constexpr double none = std::numeric_limits<double>::infinity(), slight = -3;
        if (groups_[a].tracks.empty() || groups_[b].tracks.empty() || evidence_[a * groups_.size() + b] < slight)
            return none;
        double sum = 0, count = 0;
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            double nearest = none, found = 0;
            for (const std::size_t i : groups_[a].tracks)
                for (const std::size_t k : groups_[b].tracks) {
                    if (first(i).camera != c || first(k).camera != c) continue;
                    const double gap = std::max(first(i).time - last(k).time, first(k).time - last(i).time);
                    if (gap < nearest) nearest = gap, found = link(i, k);
                }
            if (nearest < none) sum += found, count += 1;
        }
        return count > 0 ? sum / count : none;
    }

    template <class Next>
    void join_while(const Next& next) {
        const std::size_t n = groups_.size();
        while (const auto pair = next()) {
            const auto [a, b] = *pair;
            groups_[a].tracks.insert(groups_[a].tracks.end(), groups_[b].tracks.begin(), groups_[b].tracks.end());
            std::sort(groups_[a].tracks.begin(), groups_[a].tracks.end());
            groups_[a].weight += groups_[b].weight;
            groups_[b] = {};
            for (std::size_t c = 0; c < n; ++c) {
                if (c == a) continue;
                evidence_[a * n + c] = c == b ? impossible : evidence_[a * n + c] + evidence_[b * n + c];
                evidence_[c * n + a] = evidence_[a * n + c];
                evidence_[b * n + c] = evidence_[c * n + b] = impossible;
            }
        }
    }
};

} // namespace gsh
