// SPDX-License-Identifier: Apache-2.0
/// @file  The time code of each frame, an input of fields: γ(t) of the paper.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/frequency.hpp>

#include <concepts>
#include <cstddef>
#include <vector>

namespace gsh {

/// γ(t): four octaves of sines and cosines, and the time itself.
using TimeEncoding = FrequencyEncoding<4>;

/// γ(t) of every frame of a motion, t = frame / frames, in the backend's memory. With frame_count 0 every code is
/// empty, for fields that do not read the time.
///
/// Source  paper, equations 15 and 24.
template <Backend B, std::floating_point T = float>
class FrameCodes {
public:
    FrameCodes() = default;
    FrameCodes(B& backend, std::size_t frame_count) : frame_count_(frame_count) {
        std::vector<T> values(frame_count * TimeEncoding::output_count);
        for (std::size_t frame = 0; frame < frame_count; ++frame)
            TimeEncoding::forward(T(frame) / T(frame_count), values.data() + frame * TimeEncoding::output_count);
        assign(backend, values, codes_);
    }

    /// Number of elements of a code.
    [[nodiscard]] std::size_t size() const { return code_size(frame_count_); }
    [[nodiscard]] static std::size_t code_size(std::size_t frame_count) {
        return frame_count ? TimeEncoding::output_count : 0;
    }
    /// The code of one frame.
    /// Errors  ValueError for a frame that the motion does not have.
    [[nodiscard]] Span<const T> operator[](std::size_t frame) const {
        if (frame_count_ == 0) return {};
        check_frame("FrameCodes", frame, frame_count_);
        return Span<const T>(codes_).subspan(frame * size(), size());
    }

private:
    std::size_t frame_count_ = 0;
    typename B::template Buffer<T> codes_; // [frames, size()]
};

} // namespace gsh
