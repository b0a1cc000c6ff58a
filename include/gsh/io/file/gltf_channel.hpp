// SPDX-License-Identifier: Apache-2.0
/// @file  Key frames of a glTF animation, and their interpolation.
#pragma once

#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace gsh::detail {

/// One animated property of a node: 3 numbers, or 4 of a quaternion x y z w.
class GltfChannel {
public:
    GltfChannel() = default;
    /// Errors  IoError for times that do not ascend, an output of another length, an interpolation that is not known.
    GltfChannel(const GltfFile& file, GltfNumbers& numbers, const tinygltf::AnimationSampler& sampler, int width,
                const std::string& what)
        : width_(static_cast<std::size_t>(width)), times_(numbers.read(sampler.input, 1, what + ": input")),
          values_(numbers.read(sampler.output, width, what + ": output")) {
        step_ = sampler.interpolation == "STEP", cubic_ = sampler.interpolation == "CUBICSPLINE";
        if (!step_ && !cubic_ && sampler.interpolation != "LINEAR")
            file.fail(what + ": the interpolation is '" + shortened(sampler.interpolation) +
                      "', expected LINEAR, STEP or CUBICSPLINE");
        for (std::size_t k = 1; k < times_.size(); ++k)
            if (!(times_[k] > times_[k - 1]))
                file.fail(what + ": the times do not ascend: key " + std::to_string(k) + " is at " +
                          detail::number_text(times_[k]) + " s, after " + detail::number_text(times_[k - 1]) + " s");
        const std::size_t expected = times_.size() * width_ * (cubic_ ? 3 : 1);
        if (values_.size() != expected)
            file.fail(what + ": " + std::to_string(times_.size()) + " times, but " + std::to_string(values_.size()) +
                      " numbers of output, expected " + std::to_string(expected));
    }
    [[nodiscard]] bool empty() const { return times_.empty(); }
    [[nodiscard]] const std::vector<double>& times() const { return times_; }
    [[nodiscard]] bool is_step() const { return step_; }
    [[nodiscard]] bool is_cubic() const { return cubic_; }

    /// The value at a time; before the first and after the last key, theirs. Quaternions need not be of unit length.
    [[nodiscard]] std::array<double, 4> at(double time) const {
        const auto after = std::upper_bound(times_.begin(), times_.end(), time);
        if (after == times_.begin()) return key(0);
        const auto k = static_cast<std::size_t>(after - times_.begin()) - 1;
        if (after == times_.end() || step_) return key(k);
        const double span = times_[k + 1] - times_[k], u = (time - times_[k]) / span;
        return cubic_ ? spline(k, u, span) : width_ == 4 ? turn(key(k), key(k + 1), u) : mix(key(k), key(k + 1), u);
    }

    /// Spherical interpolation of quaternions along the shorter way. They need not be of unit length.
    [[nodiscard]] static std::array<double, 4> turn(std::array<double, 4> a, std::array<double, 4> b, double u) {
        const auto normalise = [](std::array<double, 4>& q) {
            const double size = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
            if (size > 0)
                for (double& x : q) x /= size;
        };
        normalise(a), normalise(b);
        double cosine = 0;
        for (std::size_t n = 0; n < 4; ++n) cosine += a[n] * b[n];
        if (cosine < 0) {
            cosine = -cosine;
            for (double& x : b) x = -x;
        }
        if (cosine > 0.9999) return mix(a, b, u);
        const double angle = std::acos(std::min(cosine, 1.0)), sine = std::sin(angle);
        std::array<double, 4> result{};
        for (std::size_t n = 0; n < 4; ++n)
            result[n] = (a[n] * std::sin((1 - u) * angle) + b[n] * std::sin(u * angle)) / sine;
        return result;
    }

private:
    std::size_t width_ = 0;
    std::vector<double> times_, values_;
    bool step_ = false, cubic_ = false;

    [[nodiscard]] std::array<double, 4> numbers_at(std::size_t first) const {
        std::array<double, 4> result{};
        for (std::size_t n = 0; n < width_; ++n) result[n] = values_[first + n];
        return result;
    }
    [[nodiscard]] std::array<double, 4> key(std::size_t k) const {
        return numbers_at(cubic_ ? (3 * k + 1) * width_ : k * width_);
    }
    static std::array<double, 4> mix(const std::array<double, 4>& a, const std::array<double, 4>& b, double u) {
        std::array<double, 4> result{};
        for (std::size_t n = 0; n < 4; ++n) result[n] = a[n] + (b[n] - a[n]) * u;
        return result;
    }
    /// The cubic of glTF 2.0, appendix C: keys store in-tangent, value, out-tangent; tangents are per second.
    [[nodiscard]] std::array<double, 4> spline(std::size_t k, double u, double span) const {
        const auto a = key(k), b = key(k + 1), out = numbers_at((3 * k + 2) * width_),
                   in = numbers_at(3 * (k + 1) * width_);
        const double u2 = u * u, u3 = u2 * u;
        std::array<double, 4> result{};
        for (std::size_t n = 0; n < 4; ++n)
            result[n] = (2 * u3 - 3 * u2 + 1) * a[n] + span * (u3 - 2 * u2 + u) * out[n] + (3 * u2 - 2 * u3) * b[n] +
                        span * (u3 - u2) * in[n];
        return result;
    }
};

/// The animated properties of one node.
struct GltfNodeChannels {
    GltfChannel translation, rotation, scale;
};

/// A node's transform: x ↦ translation + rotation (scale x); or a matrix, with its nearest rotation.
struct GltfTransform {
    vec3<double> translation{0.0}, scale{1.0};
    mat3<double> rotation = mat3<double>(1.0);
    mat3<double> linear = mat3<double>(1.0); ///< of a node with a matrix
    bool has_matrix = false;

    [[nodiscard]] Affine<double> matrix() const {
        if (has_matrix) return {linear, translation};
        return {mat3<double>(rotation[0] * scale.x, rotation[1] * scale.y, rotation[2] * scale.z), translation};
    }
    /// With the animated properties at a time.
    [[nodiscard]] GltfTransform moved(const GltfNodeChannels* channels, double time) const {
        GltfTransform result = *this;
        if (!channels) return result;
        const auto three = [&](const GltfChannel& channel, vec3<double>& value) {
            if (channel.empty()) return;
            const auto v = channel.at(time);
            value = {v[0], v[1], v[2]};
        };
        three(channels->translation, result.translation);
        three(channels->scale, result.scale);
        if (!channels->rotation.empty()) result.rotation = rotation_of(channels->rotation.at(time));
        return result;
    }
    /// Of a quaternion x y z w; one of length zero counts as no rotation.
    static mat3<double> rotation_of(const std::array<double, 4>& q) {
        const quat<double> own{q[3], q[0], q[1], q[2]};
        return dot(own, own) > 1e-20 ? rotation_from_quat(own) : mat3<double>(1.0);
    }
};

} // namespace gsh::detail
