// SPDX-License-Identifier: Apache-2.0
/// @file  Exposure and white balance of each photograph, learned with the scene.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/backend/sum.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/optim/adam.hpp>
#include <gsh/photo/photo.hpp>

#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A camera's gain on one channel: linear light is multiplied by exp(log_gain).
///
/// On colours in sRGB this is very nearly a straight line. Above the toe, the curve is
/// x = ((s + 0.055) / 1.055)^2.4, so that a factor on x is a factor exp(log_gain / 2.4) on s + 0.055. Below the toe,
/// where the sRGB curve is straight, so is the gain here, through 0 and without a jump. There it differs from the exact
/// curve by at most 0.005 for gains within a factor of two.
///
/// Units   display-referred sRGB; log_gain is natural.
/// Source  IEC 61966-2-1 for the curve.
template <Lane T>
struct Gain {
    T factor; ///< exp(log_gain / 2.4)

    explicit GSH_HD Gain(T log_gain) : factor(exp(log_gain * T(1 / exponent))) {}

    [[nodiscard]] GSH_HD T operator()(T s) const {
        return select(s > T(toe), factor * (s + T(offset)) - T(offset), s * slope());
    }
    /// Adjoint, given the result of the function: returns dL/ds, and adds to dL_dlog_gain.
    [[nodiscard]] GSH_HD T backward(T result, T dL_dresult, T& dL_dlog_gain) const {
        const T end = toe_result();
        const T d_log_gain = select(result > end, result + T(offset), result / end * factor * T(toe + offset));
        dL_dlog_gain += dL_dresult * d_log_gain * T(1 / exponent);
        return dL_dresult * select(result > end, factor, slope());
    }

private:
    static constexpr double toe = 0.04045, offset = 0.055, exponent = 2.4;

    [[nodiscard]] GSH_HD T toe_result() const { return factor * T(toe + offset) - T(offset); }
    [[nodiscard]] GSH_HD T slope() const { return toe_result() * T(1 / toe); }
};

namespace detail {

/// Applies a photograph's gains to the colour of splat i.
template <class T>
struct ApplyGain {
    Span<const T> log_gains; // [3]
    Span<vec3<T>> colors;
    GSH_HD void operator()(std::size_t i) const {
        for (int c = 0; c < 3; ++c) colors[i][c] = Gain<T>(log_gains[static_cast<std::size_t>(c)])(colors[i][c]);
    }
};

template <class T>
struct ApplyGainBackward {
    Span<const T> log_gains;
    Span<const vec3<T>> results;
    Span<vec3<T>> dL_dcolors;    // in place: of the results, then of the colours
    Span<vec3<T>> dL_dlog_gains; // [N], each splat's share
    GSH_HD void operator()(std::size_t i) const {
        dL_dlog_gains[i] = vec3<T>(T(0));
        for (int c = 0; c < 3; ++c)
            dL_dcolors[i][c] = Gain<T>(log_gains[static_cast<std::size_t>(c)])
                                   .backward(results[i][c], dL_dcolors[i][c], dL_dlog_gains[i][c]);
    }
};

/// The numbers of one photograph's step of Adam, which change on the way.
template <class T>
struct GainRow {
    Span<const T> gradient; // [3]
    Span<T> first_moment, second_moment;
    AdamCoefficients<T> coefficients;

    [[nodiscard]] GSH_HD T change(std::size_t c, T& m, T& v) const {
        T parameter(0);
        adam_update(parameter, gradient[c], m, v, coefficients);
        return parameter;
    }
};

/// Photograph rows[i] of a camera takes its step if it is the one that was seen. All move by the same amount back, so
/// that the mean stays.
template <class T>
struct MoveGains {
    GainRow<T> seen;
    std::size_t row;
    Span<const std::uint32_t> rows; // of the camera
    Span<T> log_gains;              // [P, 3]
    Span<const std::uint32_t> halt;

    GSH_HD void operator()(std::size_t i) const {
        if (is_halted(halt)) return;
        for (std::size_t c = 0; c < 3; ++c) {
            T m = seen.first_moment[c], v = seen.second_moment[c]; // copies: KeepMoments stores them afterwards
            const T change = seen.change(c, m, v);
            log_gains[3 * rows[i] + c] +=
                (rows[i] == row ? change : T(0)) - change / static_cast<T>(rows.size());
        }
    }
};
template <class T>
struct KeepMoments {
    GainRow<T> seen;
    Span<const std::uint32_t> halt;
    GSH_HD void operator()(std::size_t c) const {
        if (!is_halted(halt)) static_cast<void>(seen.change(c, seen.first_moment[c], seen.second_moment[c]));
    }
};

} // namespace detail

/// Settings of learned gains.
struct PhotoGainParams {
    double rate = 0;     ///< about the change of a log gain at each visit of its photograph; 0: gains stay 1
    double start = 0.05; ///< share of the run before which they are fixed; the scene learns a rough look first

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("gain.rate", self.rate, SettingRange::at_least(0));
        f("gain.start", self.start, SettingRange::share());
    }
};

/// Gains of photographs: a camera's automatic exposure and white balance change from image to image, and the scene must
/// not learn that as its own colour. Each photograph has a gain on red, green and blue in linear light. It multiplies
/// the colours of the splats before they are rendered, so that backgrounds stay as they are.
///
/// Gauge   the mean of the log gains over a camera's photographs is 0 for each channel; a gain that all photographs
///         share is the scene's own colour. Pictures of other views have no gain.
/// Shapes  P photographs. A step of Adam moves the row of the photograph that was seen, and all rows of its camera by
///         the same amount back.
template <Backend B, std::floating_point T = float>
class PhotoGains {
public:
    PhotoGains(B& backend, const std::vector<Photo>& photos, const PhotoGainParams& params = {})
        : backend_(&backend), params_(params), log_gains_(backend, std::vector<T>(3 * photos.size(), T(0))) {
        check_ranges("PhotoGains", params);
        gradient_.resize(1);
        backend.fill(Span<vec3<T>>(gradient_), vec3<T>(T(0)));
        std::map<std::size_t, std::vector<std::uint32_t>> of_camera;
        for (std::size_t p = 0; p < photos.size(); ++p)
            of_camera[photos[p].camera_index].push_back(static_cast<std::uint32_t>(p));
        std::vector<std::uint32_t> rows;
        places_.resize(photos.size());
        for (const auto& [camera, own] : of_camera) {
            for (const std::uint32_t p : own) places_[p] = {rows.size(), own.size()};
            rows.insert(rows.end(), own.begin(), own.end());
        }
        assign(backend, rows, rows_);
    }

    [[nodiscard]] const PhotoGainParams& params() const { return params_; }
    /// Whether steps at this share of the run move the gains, so that their gradient is needed.
    [[nodiscard]] bool learns(double progress) const { return params_.rate > 0 && progress >= params_.start; }

    /// Multiplies the colours of splats, in display-referred sRGB, by the gains of a photograph.
    void apply(std::size_t photo, Span<vec3<T>> colors) {
        if (params_.rate == 0) return;
        check_memory(*backend_, "PhotoGains::apply", "colors", colors);
        backend_->for_each(colors.size(), detail::ApplyGain<T>{row(photo), colors});
    }
    /// Adjoint of apply, given its results. Replaces dL_dcolors by the gradient of apply's argument, and adds to the
    /// gradient of the gains.
    void backward(std::size_t photo, Span<const vec3<T>> results, Span<vec3<T>> dL_dcolors) {
        if (params_.rate == 0) return;
        constexpr std::string_view where = "PhotoGains::backward";
        check_size(where, "dL_dcolors", dL_dcolors.size(), results.size());
        check_memory(*backend_, where, "results", results);
        check_memory(*backend_, where, "dL_dcolors", dL_dcolors);
        shares_.resize(results.size());
        backend_->for_each(results.size(), detail::ApplyGainBackward<T>{row(photo), results, dL_dcolors, shares_});
        add_sum(*backend_, Span<const vec3<T>>(shares_), Span<vec3<T>>(gradient_), partials_);
    }

    /// A step of Adam for one photograph, whose number of visits so far is `visit`, from 1. factor multiplies the rate.
    /// The gradient is zero afterwards.
    void step(std::size_t photo, std::int64_t visit, double factor = 1) {
        const LearnedArray<T> array = announce();
        const auto [first, count] = places_[photo];
        const detail::GainRow<T> seen{view_as<const T>(Span<const vec3<T>>(gradient_)),
                                      array.first_moment.subspan(3 * photo, 3),
                                      array.second_moment.subspan(3 * photo, 3),
                                      adam_.template coefficients<T>(params_.rate * factor, visit)};
        const Span<const std::uint32_t> halt = halt_word(*backend_);
        backend_->for_each(count, detail::MoveGains<T>{seen, photo,
                                                       Span<const std::uint32_t>(rows_).subspan(first, count),
                                                       log_gains_.values(), halt});
        backend_->for_each(3, detail::KeepMoments<T>{seen, halt});
        forget_gradient();
    }
    /// Gradient of the log gains of the photograph that was seen since the last step, [1] in the backend's memory.
    [[nodiscard]] Span<const vec3<T>> gradient() const { return gradient_; }
    void forget_gradient() { backend_->fill(Span<vec3<T>>(gradient_), vec3<T>(T(0))); }

    /// What steps change, for checkpoints. It takes no step of its own (rate 0).
    [[nodiscard]] LearnedArray<T> announce() { return log_gains_.announce("photo_gains", 0); }

    /// The gain of each photograph on red, green and blue, in linear light. Waits for the backend.
    [[nodiscard]] std::vector<std::array<double, 3>> gains() const {
        const std::vector<T> host = downloaded(*backend_, log_gains_.values());
        std::vector<std::array<double, 3>> result(host.size() / 3);
        for (std::size_t i = 0; i < host.size(); ++i) result[i / 3][i % 3] = std::exp(static_cast<double>(host[i]));
        return result;
    }

private:
    struct Place {
        std::size_t first = 0, count = 0; ///< of its camera in rows_
    };

    [[nodiscard]] Span<const T> row(std::size_t photo) const {
        check_value(photo < places_.size(), "PhotoGains", "there is no such photograph");
        return log_gains_.values().subspan(3 * photo, 3);
    }

    B* backend_;
    PhotoGainParams params_;
    Adam adam_{.beta1 = 0.9, .beta2 = 0.99}; // a row takes a few dozen steps
    LearnedBuffer<B, T> log_gains_;          // [P, 3]; its own gradient is not used
    std::vector<Place> places_;              // [P]
    typename B::template Buffer<std::uint32_t> rows_;      // [P] photographs, camera after camera
    typename B::template Buffer<vec3<T>> gradient_;        // [1] of the photograph that was seen
    typename B::template Buffer<vec3<T>> shares_, partials_; // [N], scratch
};

} // namespace gsh
