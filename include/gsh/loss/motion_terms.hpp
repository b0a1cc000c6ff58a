// SPDX-License-Identifier: Apache-2.0
/// @file  Regularisation of motion corrections: small, alike in neighbouring frames, smooth in their result.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/rotation_increment.hpp>
#include <gsh/math/spread.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Neighbours of a frame in time.
///
/// Units   intervals relative to the typical (median) interval of the motion: evenly filmed neighbours are 1 apart at
///         any frame rate.
struct FrameLink {
    std::int32_t before = -1, after = -1; ///< frames, or -1: none
    double to_before = 0, to_after = 0;
};

/// Links each frame to its neighbours in time. A frame that is left out has no neighbours and is not a neighbour; the
/// frames before and after it become neighbours, at their distance. Frames that are further apart than longest_gap
/// typical (median) intervals are not neighbours.
///
/// Errors  ValueError if two frames have the same time, or if a frame to leave out does not exist.
[[nodiscard]] inline std::vector<FrameLink>
link_frames(Span<const double> timestamps, Span<const std::size_t> left_out = {}, double longest_gap = 3.5) {
    constexpr std::string_view where = "link_frames";
    check_finite<double>(where, "timestamps", timestamps);
    std::vector<std::uint32_t> order(timestamps.size());
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(), [&](auto a, auto b) { return timestamps[a] < timestamps[b]; });
    std::vector<double> intervals;
    for (std::size_t i = 1; i < order.size(); ++i) {
        intervals.push_back(timestamps[order[i]] - timestamps[order[i - 1]]);
        check_value(intervals.back() > 0, where,
                    "frames " + std::to_string(order[i - 1]) + " and " + std::to_string(order[i]) +
                        " have the same time; give each frame its own");
    }
    std::vector<FrameLink> links(timestamps.size());
    if (intervals.empty()) return links;
    const double typical = median(std::move(intervals));
    std::vector<bool> out(timestamps.size(), false);
    for (const std::size_t frame : left_out) {
        check_value(frame < timestamps.size(), where,
                    "left_out contains frame " + std::to_string(frame) + "; the motion has " +
                        std::to_string(timestamps.size()) + " frames");
        out[frame] = true;
    }
    std::erase_if(order, [&](std::uint32_t frame) { return out[frame]; });
    for (std::size_t i = 1; i < order.size(); ++i) {
        const std::uint32_t a = order[i - 1], b = order[i];
        const double interval = (timestamps[b] - timestamps[a]) / typical;
        if (interval > longest_gap) continue;
        links[a].after = static_cast<std::int32_t>(b), links[a].to_after = interval;
        links[b].before = static_cast<std::int32_t>(a), links[b].to_before = interval;
    }
    return links;
}

/// Weights of the terms. A residual is in units of its quantity (radians, metres, coefficients) per typical interval.
struct SequenceWeights {
    double pull = 0;  ///< of |increment|²/2: pulls towards the initial estimate
    double drift = 0; ///< of |difference of neighbouring increments|²/2: errors in neighbouring frames are alike
    double acceleration = 0; ///< of |second difference of the corrected motion|²/2: bodies move smoothly
};

/// The terms of a sequence of rotations R[i] = exp(initial[i]) exp(increment[i]), several to a frame.
///
///     E = Σ_i  pull/2 |w_i|²  +  drift/2 |(w_n - w_i)/d1|²  +  acceleration/2 |r_i|²
///     r_i = 2/(d0 + d1) (log(R_iᵀ R_n)/d1 - log(R_pᵀ R_i)/d0)
///
/// Here p and n are the frames before and after i, and d0 and d1 the intervals to them. Terms with a missing neighbour
/// are omitted. Both logarithms are rotation vectors in the axes of frame i, so r is zero exactly for a steady turn.
///
/// Shapes  links [T]; initial, increments [T, width].
template <std::floating_point T>
struct RotationSequence {
    Span<const FrameLink> links;
    Span<const vec3<T>> initial, increments;
    std::size_t width = 0;
    SequenceWeights weights;

    /// The terms of frame i for the rotation `column`; their sum over frames and columns is E.
    [[nodiscard]] GSH_HD T value(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        const vec3<T> w = increment(i, column);
        T energy = T(weights.pull) * dot(w, w);
        if (link.after >= 0) {
            const vec3<T> difference = (increment(index(link.after), column) - w) * T(1 / link.to_after);
            energy += T(weights.drift) * dot(difference, difference);
        }
        if (weights.acceleration != 0 && link.before >= 0 && link.after >= 0) {
            const vec3<T> r = bend(i, column).residual;
            energy += T(weights.acceleration) * dot(r, r);
        }
        return T(0.5) * energy;
    }

    /// dE/dincrement[i, column].
    [[nodiscard]] GSH_HD vec3<T> gradient(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        const vec3<T> w = increment(i, column);
        vec3<T> dE_dw = w * T(weights.pull);
        if (link.after >= 0)
            dE_dw += (w - increment(index(link.after), column)) * T(weights.drift / (link.to_after * link.to_after));
        if (link.before >= 0)
            dE_dw += (w - increment(index(link.before), column)) * T(weights.drift / (link.to_before * link.to_before));
        if (weights.acceleration == 0) return dE_dw;

        // A turn x of R_i changes log(R_pᵀ R_i) = a by J(a)⁻¹ x and log(R_iᵀ R_n) = b by -J(b)⁻ᵀ x. R_i occurs in three
        // bends: at i, at p as the frame after, and at n as the frame before.
        vec3<T> dE_dturn(T(0));
        if (link.before >= 0 && link.after >= 0) {
            const Bend here = bend(i, column);
            dE_dturn -= ExponentialJacobian<T>(here.to_after).inverse_times(here.residual) * here.per_after;
            dE_dturn -=
                ExponentialJacobian<T>(here.to_before).inverse_transposed_times(here.residual) * here.per_before;
        }
        if (link.before >= 0 && links[index(link.before)].before >= 0) {
            const Bend there = bend(index(link.before), column);
            dE_dturn +=
                ExponentialJacobian<T>(there.to_after).inverse_transposed_times(there.residual) * there.per_after;
        }
        if (link.after >= 0 && links[index(link.after)].after >= 0) {
            const Bend there = bend(index(link.after), column);
            dE_dturn += ExponentialJacobian<T>(there.to_before).inverse_times(there.residual) * there.per_before;
        }
        return dE_dw + ExponentialJacobian<T>(w).transposed_times(dE_dturn) * T(weights.acceleration);
    }

private:
    struct Bend {
        vec3<T> to_before, to_after, residual; ///< residual = to_after per_after - to_before per_before
        T per_before, per_after;
    };
    [[nodiscard]] GSH_HD static std::size_t index(std::int32_t frame) { return static_cast<std::size_t>(frame); }
    [[nodiscard]] GSH_HD const vec3<T>& increment(std::size_t i, std::size_t column) const {
        return increments[i * width + column];
    }
    [[nodiscard]] GSH_HD mat3<T> rotation(std::size_t i, std::size_t column) const {
        return rotation_from_axis_angle(initial[i * width + column]) * rotation_from_axis_angle(increment(i, column));
    }
    [[nodiscard]] GSH_HD Bend bend(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        const mat3<T> R = rotation(i, column);
        Bend b;
        b.to_before = axis_angle_from_rotation(transpose(rotation(index(link.before), column)) * R);
        b.to_after = axis_angle_from_rotation(transpose(R) * rotation(index(link.after), column));
        const double scale = 2 / (link.to_before + link.to_after);
        b.per_before = T(scale / link.to_before), b.per_after = T(scale / link.to_after);
        b.residual = b.to_after * b.per_after - b.to_before * b.per_before;
        return b;
    }
};

/// The same terms of a sequence of plain numbers x[i] = initial[i] + increment[i].
///
/// Shapes  links [T]; initial, increments [T, width].
template <std::floating_point T>
struct NumberSequence {
    Span<const FrameLink> links;
    Span<const T> initial, increments;
    std::size_t width = 0;
    SequenceWeights weights;

    [[nodiscard]] GSH_HD T value(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        const T w = increments[i * width + column];
        T energy = T(weights.pull) * w * w;
        if (link.after >= 0) {
            const T difference = (increments[index(link.after) * width + column] - w) * T(1 / link.to_after);
            energy += T(weights.drift) * difference * difference;
        }
        const T r = residual(i, column);
        return T(0.5) * (energy + T(weights.acceleration) * r * r);
    }

    /// dE/dincrement[i, column].
    [[nodiscard]] GSH_HD T gradient(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        const T w = increments[i * width + column];
        T dE_dw = w * T(weights.pull), bend = T(0);
        if (link.after >= 0) {
            const T other = increments[index(link.after) * width + column];
            dE_dw += (w - other) * T(weights.drift / (link.to_after * link.to_after));
            if (link.before >= 0) bend -= residual(i, column) * T(2 / (link.to_before * link.to_after));
            const FrameLink there = links[index(link.after)];
            if (there.after >= 0)
                bend +=
                    residual(index(link.after), column) * T(2 / (there.to_before * (there.to_before + there.to_after)));
        }
        if (link.before >= 0) {
            const T other = increments[index(link.before) * width + column];
            dE_dw += (w - other) * T(weights.drift / (link.to_before * link.to_before));
            const FrameLink there = links[index(link.before)];
            if (there.before >= 0)
                bend +=
                    residual(index(link.before), column) * T(2 / (there.to_after * (there.to_before + there.to_after)));
        }
        return dE_dw + T(weights.acceleration) * bend;
    }

private:
    [[nodiscard]] GSH_HD static std::size_t index(std::int32_t frame) { return static_cast<std::size_t>(frame); }
    [[nodiscard]] GSH_HD T at(std::size_t i, std::size_t column) const {
        return initial[i * width + column] + increments[i * width + column];
    }
    /// The second difference at frame i; zero where a neighbour is missing.
    [[nodiscard]] GSH_HD T residual(std::size_t i, std::size_t column) const {
        const FrameLink link = links[i];
        if (link.before < 0 || link.after < 0) return T(0);
        const T here = at(i, column);
        const T later = (at(index(link.after), column) - here) * T(1 / link.to_after);
        const T earlier = (here - at(index(link.before), column)) * T(1 / link.to_before);
        return (later - earlier) * T(2 / (link.to_before + link.to_after));
    }
};

namespace detail {

/// values[n] = the terms of number n of the sequence, counted row by row.
template <class Sequence, class T>
struct SequenceValue {
    Sequence sequence;
    Span<T> values;
    GSH_HD void operator()(std::size_t n) const { values[n] = sequence.value(n / sequence.width, n % sequence.width); }
};

/// Adds one frame's gradient.
template <class Sequence, class U>
struct SequenceGradient {
    Sequence sequence;
    std::size_t frame;
    Span<U> dE_dincrements;
    GSH_HD void operator()(std::size_t column) const { dE_dincrements[column] += sequence.gradient(frame, column); }
};

template <class T>
struct PullGradient {
    T weight;
    Span<const T> increments;
    Span<T> gradient;
    GSH_HD void operator()(std::size_t i) const { gradient[i] += weight * increments[i]; }
};

} // namespace detail

/// dE_dincrements [width] += the gradient of E with respect to the increments of frame `frame`, with all others fixed.
///
/// Each number is gathered from the neighbouring frames and nothing is scattered, so the order of frames does not
/// matter.
template <Backend B, class Sequence, class U>
void sequence_backward(B& backend, const Sequence& sequence, std::size_t frame, Span<U> dE_dincrements) {
    check_size("sequence_backward", "dE_dincrements", dE_dincrements.size(), sequence.width);
    check_value(frame < sequence.links.size(), "sequence_backward", "the frame is beyond the sequence's end");
    check_memory(backend, "sequence_backward", "dE_dincrements", dE_dincrements);
    check_memory(backend, "sequence_backward", "sequence.increments", sequence.increments);
    check_memory(backend, "sequence_backward", "sequence.initial", sequence.initial);
    check_memory(backend, "sequence_backward", "sequence.links", sequence.links);
    if (sequence.weights.pull == 0 && sequence.weights.drift == 0 && sequence.weights.acceleration == 0) return;
    backend.for_each(sequence.width, detail::SequenceGradient<Sequence, U>{sequence, frame, dE_dincrements});
}

/// The pull alone, of numbers that do not belong to frames: adds pull times the increments.
template <Backend B, std::floating_point T>
void pull_backward(B& backend, T pull, Span<const T> increments, Span<T> dE_dincrements) {
    check_size("pull_backward", "dE_dincrements", dE_dincrements.size(), increments.size());
    check_memory(backend, "pull_backward", "increments", increments);
    check_memory(backend, "pull_backward", "dE_dincrements", dE_dincrements);
    backend.for_each(increments.size(), detail::PullGradient<T>{pull, increments, dE_dincrements});
}

/// E, on the host; waits for the backend. The caller keeps scratch, so that a repeated sum allocates nothing on the
/// backend.
template <Backend B, class Sequence, class Buffer>
[[nodiscard]] double sequence_value(B& backend, const Sequence& sequence, Buffer& scratch) {
    using T = std::remove_cvref_t<decltype(sequence.value(0, 0))>;
    std::vector<T> host(sequence.links.size() * sequence.width);
    check_memory(backend, "sequence_value", "sequence.increments", sequence.increments);
    check_memory(backend, "sequence_value", "sequence.initial", sequence.initial);
    check_memory(backend, "sequence_value", "sequence.links", sequence.links);
    scratch.resize(host.size());
    backend.for_each(host.size(), detail::SequenceValue<Sequence, T>{sequence, scratch});
    backend.download(Span<const T>(scratch), Span<T>(host));
    return std::accumulate(host.begin(), host.end(), 0.0);
}

} // namespace gsh
