// SPDX-License-Identifier: Apache-2.0
/// @file  Searches for the reading of a capture's files under which masks and posed bodies agree best.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/check/capture_hypotheses.hpp>
#include <gsh/check/capture_looks.hpp>
#include <gsh/check/capture_reading.hpp>
#include <gsh/check/capture_views.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/spread.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <set>
#include <utility>
#include <vector>

namespace gsh {

struct CaptureSearchParams {
    std::size_t views = 48;       ///< number of images on which hypotheses are tried; at least 3 of each camera
    int coarse_size = 256;        ///< pixels along the longer side while hypotheses are tried
    int fine_size = 1080;         ///< the same for the reported values; larger images are reduced
    double gain = 0.04;           ///< smallest improvement of the IoU for a hypothesis to be accepted
    double remaining = 0.7;       ///< largest remaining fraction of 1 - IoU for a hypothesis to be accepted
    double convincing = 0.6;      ///< IoU below which no hypothesis is accepted
    double inverted_border = 0.6; ///< a mask is taken as inverted if it covers more than this fraction of the border
    int rounds = 6;               ///< largest number of combined faults
};

/// Greedy search over readings. Each round renders every hypothesis: single conventions of cameras, poses and images,
/// and sizes and shifts from a short line search. Hypotheses about poses are tried for all people together and for each
/// person alone. The hypothesis with the largest gain is accepted for the cameras where its gain is clear, and the next
/// round starts from the result.
template <HostExecutor E>
class CaptureSearch {
public:
    using Views = std::vector<CaptureView>;

    CaptureSearch(E& executor, const Capture& capture, const std::vector<CheckedPerson>& people,
                  const CaptureSearchParams& params)
        : looks_(executor, capture, people), capture_(capture), params_(params), border_(capture.cameras.size(), 0) {}

    [[nodiscard]] CaptureReading as_given() const {
        return {std::vector<MotionReading>(looks_.people().size()),
                std::vector<CameraReading>(capture_.cameras.size())};
    }

    [[nodiscard]] CaptureLooks<E>& looks() { return looks_; }

    [[nodiscard]] bool is_clear(double given, double mended) const {
        return mended - given >= params_.gain && 1 - mended <= params_.remaining * (1 - given);
    }

    /// Evaluates the images with the files as given.
    [[nodiscard]] std::vector<ViewLook> look(const Views& views) {
        auto looks = looks_.look(views, as_given(), params_.fine_size);
        std::vector<double> count(border_.size(), 0);
        for (std::size_t i = 0; i < views.size(); ++i)
            border_[views[i].camera] += looks[i].border_share, count[views[i].camera] += 1;
        for (std::size_t c = 0; c < border_.size(); ++c) border_[c] /= std::max(1.0, count[c]);
        return looks;
    }
    /// Mean over the images of the last call of look.
    [[nodiscard]] double border_share(std::size_t camera) const { return border_[camera]; }

    /// A few views of each camera, evenly spaced.
    [[nodiscard]] Views choose_views(const Views& usable) const {
        return detail::spread_views(usable, capture_.cameras.size(), params_.views);
    }

    /// IoU of each view under a reading, -1 if it has no pose.
    [[nodiscard]] std::vector<double> fine(const Views& views, const CaptureReading& reading) {
        return looks_.overlaps(looks_.look(views, reading, params_.fine_size));
    }

    /// The best reading, on views with usable masks.
    [[nodiscard]] CaptureReading run(const Views& views) {
        CaptureReading reading = as_given();
        for (std::size_t c = 0; c < border_.size(); ++c)
            reading.cameras[c].inverted_mask = border_[c] > params_.inverted_border;
        for (int round = 0; round < params_.rounds; ++round)
            if (!improve(views, reading)) break;
        refine_shifts(views, reading);
        return reading;
    }

private:
    CaptureLooks<E> looks_;
    const Capture& capture_;
    CaptureSearchParams params_;
    std::vector<double> border_;

    using Candidate = detail::CaptureHypothesis;
    using People = detail::SuspectedPeople;

    /// Accepts the candidate with the largest gain; returns false if none is clearly better.
    bool improve(const Views& views, CaptureReading& reading);

    void add_measured(const Views& views, const CaptureReading& reading, const std::vector<ViewLook>& looks,
                      std::vector<Candidate>& candidates);
    [[nodiscard]] CaptureReading resized(const Views& views, const CaptureReading& reading,
                                         const std::vector<ViewLook>& looks, const People& people);
    [[nodiscard]] CaptureReading zoomed(const Views& views, const CaptureReading& reading,
                                        const std::vector<ViewLook>& looks);
    [[nodiscard]] CaptureReading displaced(const Views& views, const CaptureReading& reading,
                                           std::vector<ViewLook> looks, const People& people);
    [[nodiscard]] CaptureReading shifted(const Views& views, const CaptureReading& reading, int size, int first_step);
    void refine_shifts(const Views& views, CaptureReading& reading);

    [[nodiscard]] std::vector<std::size_t> all_cameras() const {
        std::vector<std::size_t> all(capture_.cameras.size());
        for (std::size_t c = 0; c < all.size(); ++c) all[c] = c;
        return all;
    }
};

// -------------------------------------------------------------------------------------------------------------

template <HostExecutor E>
bool CaptureSearch<E>::improve(const Views& views, CaptureReading& reading) {
    constexpr double tie = 0.01; // IoU
    looks_.start_from(reading.motions);
    const auto looks = looks_.look(views, reading, params_.coarse_size);
    const std::vector<double> base = looks_.overlaps(looks);
    std::vector<bool> open(capture_.cameras.size(), false);
    for (const std::size_t c : all_cameras()) {
        const bool seen = std::any_of(views.begin(), views.end(), [&](const CaptureView& v) { return v.camera == c; });
        open[c] = seen && looks_.means(views, base, base, {c}).first <= 1 - params_.gain;
    }
    if (std::count(open.begin(), open.end(), true) == 0) return false;

    std::vector<Candidate> candidates = detail::conventions(reading, capture_);
    add_measured(views, reading, looks, candidates);
    double best = 0;
    CaptureReading best_reading;
    for (const Candidate& candidate : candidates) {
        const std::vector<double> tried = looks_.overlaps(looks_.look(views, candidate.reading, params_.coarse_size));
        CaptureReading merged = reading;
        double total = 0;
        if (candidate.of_motion) {
            const auto [given, mended] = looks_.means(views, base, tried, all_cameras());
            if (!is_clear(given, mended)) continue;
            merged = candidate.reading;
            total = mended - given;
        } else {
            for (const std::size_t c : all_cameras()) {
                if (!open[c]) continue;
                const auto [given, mended] = looks_.means(views, base, tried, {c});
                if (!is_clear(given, mended)) continue;
                merged.cameras[c] = candidate.reading.cameras[c];
                const auto own =
                    std::count_if(views.begin(), views.end(), [&](const CaptureView& v) { return v.camera == c; });
                total += (mended - given) * static_cast<double>(own) / static_cast<double>(views.size());
            }
        }
        if (total > best + (best > 0 ? tie : 0)) best = total, best_reading = merged;
    }
    if (!(best > 0)) return false;
    reading = best_reading;
    return true;
}

template <HostExecutor E>
void CaptureSearch<E>::add_measured(const Views& views, const CaptureReading& reading,
                                    const std::vector<ViewLook>& looks, std::vector<Candidate>& candidates) {
    if (std::none_of(looks.begin(), looks.end(), [](const ViewLook& l) { return l.body_area > 0 && l.mask_area > 0; }))
        return; // nothing to compare
    std::set<std::size_t> cameras;
    for (const CaptureView& v : views) cameras.insert(v.camera);
    const std::vector<People> suspected = detail::suspects(reading);
    for (const People& people : suspected) candidates.push_back({resized(views, reading, looks, people), true});
    if (cameras.size() > 1)
        for (const People& people : suspected) candidates.push_back({displaced(views, reading, looks, people), true});
    candidates.push_back({shifted(views, reading, params_.coarse_size, 8), false});
    candidates.push_back({zoomed(views, reading, looks), false});
}

/// Fits the size of `people`. The first estimate attributes the whole difference between mask area and silhouette area
/// to them.
template <HostExecutor E>
CaptureReading CaptureSearch<E>::resized(const Views& views, const CaptureReading& reading,
                                         const std::vector<ViewLook>& looks, const People& people) {
    std::vector<double> ratios;
    for (const ViewLook& l : looks) {
        double own = 0;
        for (const std::size_t p : people) own += l.people[p].own;
        const double missing = static_cast<double>(l.mask_area) - static_cast<double>(l.body_area);
        if (own > 0 && l.mask_area > 0) ratios.push_back(std::sqrt(std::max(0.0, own + missing) / own));
    }
    if (ratios.empty()) return reading;
    CaptureReading best = reading, tried = reading;
    double best_iou = -1;
    const auto attempt = [&](const CaptureReading& from, double factor, double divisor = 1) {
        for (const std::size_t p : people) tried.motions[p].size = from.motions[p].size * factor / divisor;
        const auto iou = looks_.overlaps(looks_.look(views, tried, params_.coarse_size));
        const double mean = looks_.means(views, iou, iou, all_cameras()).first;
        if (mean > best_iou) best_iou = mean, best = tried;
    };
    attempt(reading, std::clamp(median(ratios), 0.1, 10.0));
    for (const double step : {0.04, 0.02, 0.01}) {
        const CaptureReading middle = best;
        attempt(middle, 1 + step);
        attempt(middle, 1, 1 + step);
    }
    return best;
}

template <HostExecutor E>
CaptureReading CaptureSearch<E>::zoomed(const Views& views, const CaptureReading& reading,
                                        const std::vector<ViewLook>& looks) {
    std::vector<std::vector<double>> ratios(capture_.cameras.size());
    for (std::size_t i = 0; i < views.size(); ++i)
        if (looks[i].body_area > 0 && looks[i].mask_area > 0)
            ratios[views[i].camera].push_back(
                std::sqrt(static_cast<double>(looks[i].mask_area) / static_cast<double>(looks[i].body_area)));
    CaptureReading best = reading;
    std::vector<double> best_iou(capture_.cameras.size(), -1);
    const auto attempt = [&](const std::function<double(std::size_t)>& factor) {
        CaptureReading tried = best;
        for (const std::size_t c : all_cameras()) tried.cameras[c].zoom *= factor(c);
        const auto iou = looks_.overlaps(looks_.look(views, tried, params_.coarse_size));
        for (const std::size_t c : all_cameras())
            if (const double mean = looks_.means(views, iou, iou, {c}).first; mean > best_iou[c])
                best_iou[c] = mean, best.cameras[c] = tried.cameras[c];
    };
    attempt([&](std::size_t c) { return ratios[c].empty() ? 1.0 : std::clamp(median(ratios[c]), 0.1, 10.0); });
    for (const double step : {0.04, 0.02, 0.01}) {
        attempt([&](std::size_t) { return 1 + step; });
        attempt([&](std::size_t) { return 1 / (1 + step); });
    }
    return best;
}

/// The displacement d of `people` that moves the centroids of the combined silhouettes onto those of the masks. It
/// solves sum Jᵀ J d = sum Jᵀ (mask - silhouette). J is the derivative of a centroid: the projection's derivative at
/// each body, weighted by the body's share of the silhouette.
template <HostExecutor E>
CaptureReading CaptureSearch<E>::displaced(const Views& views, const CaptureReading& reading,
                                           std::vector<ViewLook> looks, const People& people) {
    CaptureReading result = reading;
    for (int step = 0; step < 3; ++step) {
        if (step > 0) looks = looks_.look(views, result, params_.coarse_size);
        std::vector<std::array<vec3<double>, 2>> rows(views.size(), {vec3<double>(0.0), vec3<double>(0.0)}); // of J
        looks_.for_views(views, result, [&](std::size_t i, const auto& everybody) {
            const Camera<double> seen_by = looks_.camera(views[i].camera, result, params_.coarse_size);
            for (const std::size_t p : people) {
                vec3<double> middle(0.0);
                for (const auto& v : everybody[p]) middle += v / static_cast<double>(everybody[p].size());
                const vec3<double> m = to_camera(seen_by, middle);
                if (!(m.z > 1e-3)) continue;
                const double share = looks[i].people[p].own / static_cast<double>(looks[i].body_area);
                const vec3<double> dx(seen_by.fx / m.z, 0, -seen_by.fx * m.x / (m.z * m.z)),
                    dy(0, seen_by.fy / m.z, -seen_by.fy * m.y / (m.z * m.z));
                rows[i][0] += transposed_times(seen_by.R, dx) * share;
                rows[i][1] += transposed_times(seen_by.R, dy) * share;
            }
        });
        mat3<double> normal(0.0);
        vec3<double> right(0.0);
        for (std::size_t i = 0; i < views.size(); ++i) {
            if (!looks[i].valid || looks[i].body_area == 0 || looks[i].mask_area == 0) continue;
            const vec2<double> error = looks[i].mask_center - looks[i].body_center;
            for (int k = 0; k < 2; ++k) {
                const vec3<double>& row = rows[i][static_cast<std::size_t>(k)];
                normal += outer(row, row);
                right += row * error[k];
            }
        }
        const double ridge = 1e-6 * (normal[0].x + normal[1].y + normal[2].z);
        if (!(ridge > 0)) return reading;
        const vec3<double> moved = inverse(normal + mat3<double>(ridge)) * right;
        for (const std::size_t p : people) result.motions[p].offset += moved;
    }
    return result;
}

/// The shift of each camera's silhouettes that fits its masks best, searched from the given step in pixels of the
/// reduced image down to one. Moving the principal point only shifts the silhouette.
template <HostExecutor E>
CaptureReading CaptureSearch<E>::shifted(const Views& views, const CaptureReading& reading, int size, int first_step) {
    std::vector<std::pair<Silhouette, Silhouette>> pairs(views.size());
    looks_.for_views(views, reading, [&](std::size_t i, const auto& everybody) {
        pairs[i] = {united(looks_.silhouettes(everybody, looks_.camera(views[i].camera, reading, size))),
                    looks_.mask(views[i], reading, size)};
    });
    CaptureReading result = reading;
    looks_.executor().for_chunks(capture_.cameras.size(), 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t c = begin; c < end; ++c) {
            std::vector<const std::pair<Silhouette, Silhouette>*> own;
            std::vector<double> dx, dy;
            for (std::size_t i = 0; i < views.size(); ++i) {
                if (views[i].camera != c || pairs[i].first.area() == 0) continue;
                own.push_back(&pairs[i]);
                const vec2<double> difference = pairs[i].second.centroid() - pairs[i].first.centroid();
                dx.push_back(difference.x), dy.push_back(difference.y);
            }
            if (own.empty()) continue;
            const auto score = [&](std::array<int, 2> at) {
                double sum = 0;
                for (const auto* pair : own) sum += overlap(pair->first, pair->second, at[0], at[1]).iou();
                return sum;
            };
            std::array<int, 2> best{0, 0};
            double best_score = score(best);
            const auto attempt = [&](std::array<int, 2> at) {
                const double value = score(at);
                if (!(value > best_score)) return false;
                best = at, best_score = value;
                return true;
            };
            if (first_step > 1)
                attempt({static_cast<int>(std::lround(median(dx))), static_cast<int>(std::lround(median(dy)))});
            for (int step = first_step; step > 0;) {
                const auto [x, y] = best;
                bool moved = false;
                for (const auto& at : {std::array<int, 2>{x + step, y}, {x - step, y}, {x, y + step}, {x, y - step}})
                    moved = attempt(at) || moved;
                if (!moved) step /= 2;
            }
            result.cameras[c].shift += vec2<double>(best[0], best[1]) * static_cast<double>(looks_.reduction(c, size));
        }
    });
    return result;
}

template <HostExecutor E>
void CaptureSearch<E>::refine_shifts(const Views& views, CaptureReading& reading) {
    const bool any = std::any_of(reading.cameras.begin(), reading.cameras.end(),
                                 [](const CameraReading& r) { return r.shift != vec2<double>(0.0); });
    if (!any) return;
    const CaptureReading refined = shifted(views, reading, params_.fine_size, 1);
    for (std::size_t c = 0; c < reading.cameras.size(); ++c)
        if (reading.cameras[c].shift != vec2<double>(0.0)) reading.cameras[c].shift = refined.cameras[c].shift;
}

} // namespace gsh
