// SPDX-License-Identifier: Apache-2.0
/// @file  A light that learns with the avatars that it shades.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <memory>
#include <vector>

namespace gsh {

/// Learning rates of a light; see LightView for the numbers.
struct LightRates {
    double points = 1e-2; ///< metres
    double log_intensities = 1e-2;
    double gloss = 5e-3; ///< of logarithms of strength and sharpness

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("rate.light_points", self.points, SettingRange::at_least(0));
        f("rate.light_intensities", self.log_intensities, SettingRange::at_least(0));
        f("rate.light_gloss", self.gloss, SettingRange::at_least(0));
    }
};

/// A light in the memory of a backend, with gradients. Directions do not learn. The intensity of the first light is the
/// unit of all others and does not learn either, since a common factor of all intensities is one of the albedo, too.
template <Backend B, std::floating_point T = float>
class LearnedLight {
public:
    LearnedLight(B& backend, const LightData& light, const LightRates& rates = {}) : backend_(&backend), rates_(rates) {
        set(light);
    }

    /// Replaces the light. Moments of Adam start at zero.
    /// Errors  those of check_light, and ShapeError for a light without gloss.
    void set(const LightData& light) {
        check_light("LearnedLight", light);
        check_size("LearnedLight", "light.gloss", light.gloss.size(), 2, "logarithms of strength and sharpness");
        points_ = {*backend_, std::vector<vec3<T>>(light.points.begin(), light.points.end())};
        log_intensities_ = {*backend_, std::vector<T>(light.log_intensities.begin(), light.log_intensities.end())};
        gloss_ = {*backend_, std::vector<T>(light.gloss.begin(), light.gloss.end())};
        const std::vector<vec3<T>> directions(light.directions.begin(), light.directions.end());
        shadows_ = light.shadows;
        assign(*backend_, directions, directions_);
    }

    /// LightData::shadows.
    [[nodiscard]] bool shadows() const { return shadows_; }
    [[nodiscard]] LightView<const T> view() const {
        return {points_.values(), directions_, log_intensities_.values(), gloss_.values()};
    }
    [[nodiscard]] LightView<T> gradient() {
        return {points_.gradient(), directions_, log_intensities_.gradient(), gloss_.gradient()};
    }

    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArray<T> intensities = log_intensities_.announce("light_log_intensities", 0); // the rate of the unit
        intensities.other = {LearnedArray<T>::OtherRate::Where::columns, log_intensities_.size(), 1,
                             rates_.log_intensities};
        return {points_.announce("light_points", rates_.points), intensities,
                gloss_.announce("light_gloss", rates_.gloss)};
    }

    /// The present light on the host.
    [[nodiscard]] LightData data() const {
        const auto vectors = [&](Span<const vec3<T>> from) {
            const std::vector<vec3<T>> host = downloaded(*backend_, from);
            return std::vector<vec3<double>>(host.begin(), host.end());
        };
        const auto numbers = [&](Span<const T> from) {
            const std::vector<T> host = downloaded(*backend_, from);
            return std::vector<double>(host.begin(), host.end());
        };
        const LightView<const T> now = view();
        return {vectors(now.points), vectors(now.directions), numbers(now.log_intensities), numbers(now.gloss),
                shadows_};
    }

private:
    B* backend_;
    LightRates rates_;
    bool shadows_ = true;
    LearnedBuffer<B, vec3<T>> points_;
    LearnedBuffer<B, T> log_intensities_, gloss_;
    typename B::template Buffer<vec3<T>> directions_;
};

/// A light that several avatars share.
template <Backend B, std::floating_point T = float>
using SharedLight = std::shared_ptr<LearnedLight<B, T>>;

} // namespace gsh
