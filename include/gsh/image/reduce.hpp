// SPDX-License-Identifier: Apache-2.0
/// @file  Reduction of an RGBA photograph by a whole factor: the mean of each block of pixels.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace gsh {

namespace detail {

struct ReduceRgba8 {
    Span<const std::uint8_t> source;
    std::size_t source_width, out_width, factor;
    Span<std::uint8_t> out;

    GSH_HD void operator()(std::size_t i) const {
        const std::size_t first = (i / out_width * source_width + i % out_width) * factor;
        std::uint64_t color[3] = {}, alpha = 0; // premultiplied
        for (std::size_t y = 0; y < factor; ++y)
            for (std::size_t x = 0; x < factor; ++x) {
                const std::uint8_t* pixel = source.data() + 4 * (first + y * source_width + x);
                alpha += pixel[3];
                for (int c = 0; c < 3; ++c) color[c] += std::uint64_t(pixel[c]) * pixel[3];
            }
        const std::uint64_t count = std::uint64_t(factor) * factor;
        for (std::size_t c = 0; c < 3; ++c)
            out[4 * i + c] = static_cast<std::uint8_t>(alpha > 0 ? (color[c] + alpha / 2) / alpha : 0);
        out[4 * i + 3] = static_cast<std::uint8_t>((alpha + count / 2) / count);
    }
};

} // namespace detail

/// out = the mean of each factor x factor block of pixels, with colours weighted by alpha. Columns and rows beyond the
/// last whole block are dropped, so that a camera with K / factor shows the same picture.
///
/// Shapes  source [height, width, 4], straight alpha; out [height / factor, width / factor, 4].
/// Errors  ShapeError, ValueError.
template <Backend B>
void reduce_rgba8(B& backend, Span<const std::uint8_t> source, int height, int width, int factor,
                  Span<std::uint8_t> out) {
    constexpr std::string_view where = "reduce_rgba8";
    check_value(factor > 0 && factor <= 65536 && height >= 0 && width >= 0, where,
                "heights and widths must not be negative, and the factor must lie between 1 and 65536");
    const auto bytes = [](int h, int w) { return 4 * static_cast<std::size_t>(h) * static_cast<std::size_t>(w); };
    check_size(where, "source", source.size(), bytes(height, width), "give four bytes a pixel");
    check_size(where, "out", out.size(), bytes(height / factor, width / factor), "give four bytes a pixel");
    check_memory(backend, where, "source", source);
    check_memory(backend, where, "out", out);
    backend.for_each(out.size() / 4,
                     detail::ReduceRgba8{source, static_cast<std::size_t>(width),
                                         static_cast<std::size_t>(width / factor),
                                         static_cast<std::size_t>(factor), out});
}

} // namespace gsh
