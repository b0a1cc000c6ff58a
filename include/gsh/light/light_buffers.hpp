// SPDX-License-Identifier: Apache-2.0
/// @file  A light in the memory of a backend, for parts that read it and do not learn it.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/light/light.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <vector>

namespace gsh {

/// The arrays of LightView in the memory of a backend. Empty until `upload`.
template <Backend B, std::floating_point T = float>
class LightBuffers {
public:
    /// Replaces the light.
    /// Errors  those of check_light; the former light then stays.
    void upload(B& backend, const LightData& light) {
        check_light("LightBuffers::upload", light);
        const auto vectors = [](const std::vector<vec3<double>>& from) {
            return std::vector<vec3<T>>(from.begin(), from.end());
        };
        const auto numbers = [](const std::vector<double>& from) { return std::vector<T>(from.begin(), from.end()); };
        assign(backend, vectors(light.points), points_);
        assign(backend, vectors(light.directions), directions_);
        assign(backend, numbers(light.log_intensities), log_intensities_);
        assign(backend, numbers(light.gloss), gloss_);
    }

    [[nodiscard]] bool empty() const { return log_intensities_.size() == 0; }
    [[nodiscard]] LightView<const T> view() const { return {points_, directions_, log_intensities_, gloss_}; }

private:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    Buffer<vec3<T>> points_, directions_;
    Buffer<T> log_intensities_, gloss_;
};

} // namespace gsh
