// SPDX-License-Identifier: Apache-2.0
/// @file  The mean of weighted directions, of which some may be wrong, and orthonormal axes from two directions.
#pragma once

#include <gsh/math/vec.hpp>

#include <cmath>
#include <vector>

namespace gsh {

/// A mean direction of samples, of which a minority may be anything.
class MeanDirection {
public:
    void add(const vec3<double>& v, double weight = 1) {
        if (const double size = length(v); size > 1e-12 && weight > 0) samples_.push_back({v * (1 / size), weight});
    }
    [[nodiscard]] bool empty() const { return samples_.empty(); }
    [[nodiscard]] double weight() const {
        double sum = 0;
        for (const auto& sample : samples_) sum += sample.weight;
        return sum;
    }
    /// Unit length; zero if there is none, or if samples cancel.
    [[nodiscard]] vec3<double> value() const {
        vec3<double> mean(0);
        for (int pass = 0; pass < 6; ++pass) {
            vec3<double> sum(0);
            for (const auto& sample : samples_) {
                // Far samples count less from the second pass on; 0.02 is the cosine's loss at 11 degrees.
                const double far = pass == 0 ? 0 : 1 - dot(sample.direction, mean);
                sum += sample.direction * (sample.weight / (1 + far / 0.02));
            }
            const double size = length(sum);
            if (!(size > 1e-9 * weight())) return vec3<double>(0);
            mean = sum * (1 / size);
        }
        return mean;
    }

private:
    struct Sample {
        vec3<double> direction;
        double weight;
    };
    std::vector<Sample> samples_;
};

/// Axes from a first direction, kept exactly, and a second; both are columns of the result, then their cross product.
inline mat3<double> axes_of(const vec3<double>& first, const vec3<double>& second) {
    const vec3<double> a = length(first) > 1e-9 ? normalize(first) : vec3<double>(1, 0, 0);
    vec3<double> b = second - a * dot(second, a);
    if (length(b) < 1e-6) // any perpendicular direction
        b = std::abs(a.y) < 0.9 ? cross(a, vec3<double>(0, 1, 0)) : cross(a, vec3<double>(1, 0, 0));
    b = normalize(b);
    return {a, b, cross(a, b)};
}

} // namespace gsh
