// SPDX-License-Identifier: Apache-2.0
/// @file  The bytes of a PNG file: rows are filtered, and deflated by zlib.
#pragma once

#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/image/image_bounds.hpp>
#include <gsh/io/image/png_structure.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::detail {

/// A PNG of 8-bit samples, [height, width, channels]; 1 channel is grey, 3 are RGB, 4 are RGBA with straight alpha.
///
/// Source  ISO/IEC 15948:2004: sections 9.2 (filters) and 12.8 (the choice of one).
[[nodiscard]] inline std::string png_bytes(const std::uint8_t* samples, int height, int width, int channels);

// -------------------------------------------------------------------------------------------------------------

/// Chooses a filter for each row of a PNG, and keeps what the filters need of the row above.
class PngFilter {
public:
    PngFilter(std::size_t row_bytes, std::size_t pixel_bytes)
        : row_(row_bytes), pixel_(pixel_bytes), above_(pixel_bytes + row_bytes), here_(pixel_bytes + row_bytes) {
        for (auto& one : filtered_) one.resize(row_bytes);
    }

    /// Appends the number of the filter and the filtered row. Of five filters, it is that whose differences, as signed
    /// bytes, have the smallest sum of magnitudes: they deflate best as a rule.
    void append(std::string& out, const std::uint8_t* row) {
        std::copy_n(row, row_, here_.begin() + static_cast<std::ptrdiff_t>(pixel_));
        const std::uint8_t *x = here_.data() + pixel_, *a = here_.data(), *b = above_.data() + pixel_,
                           *c = above_.data(); // the sample, and those at its left, above it and at the left of that
        fill(0, [&](std::size_t i) { return x[i]; });
        fill(1, [&](std::size_t i) { return x[i] - a[i]; });
        fill(2, [&](std::size_t i) { return x[i] - b[i]; });
        fill(3, [&](std::size_t i) { return x[i] - (a[i] + b[i]) / 2; });
        fill(4, [&](std::size_t i) { return x[i] - nearest(a[i], b[i], c[i]); });
        std::size_t best = 0, least = std::numeric_limits<std::size_t>::max();
        for (std::size_t k = 0; k < filtered_.size(); ++k) {
            std::size_t sum = 0;
            for (const std::int8_t value : filtered_[k]) sum += static_cast<std::size_t>(std::abs(int(value)));
            if (sum < least) least = sum, best = k;
        }
        out.push_back(static_cast<char>(best));
        out.append(reinterpret_cast<const char*>(filtered_[best].data()), row_);
        std::swap(above_, here_);
    }

private:
    template <class Difference>
    void fill(std::size_t filter, const Difference& difference) {
        std::int8_t* out = filtered_[filter].data();
        for (std::size_t i = 0; i < row_; ++i) out[i] = static_cast<std::int8_t>(difference(i));
    }

    /// Which of three neighbours is nearest to left + above - above left (Paeth).
    static int nearest(int left, int above, int corner) {
        const int to_left = std::abs(above - corner), to_above = std::abs(left - corner),
                  to_corner = std::abs(left + above - 2 * corner);
        const int of_two = to_above <= to_corner ? above : corner;
        return to_left <= to_above && to_left <= to_corner ? left : of_two;
    }

    std::size_t row_, pixel_;
    std::vector<std::uint8_t> above_, here_; // each begins with a pixel of zeros, which is at the left of the row
    std::array<std::vector<std::int8_t>, 5> filtered_;
};

/// Appends a chunk: the length of its data, its type, the data and a checksum.
inline void append_png_chunk(std::string& out, std::string_view type, std::string_view data) {
    append_png_number(out, data.size());
    const std::size_t begin = out.size();
    out.append(type).append(data);
    Crc32 crc;
    crc.add(out.data() + begin, out.size() - begin);
    append_png_number(out, crc.value());
}

inline std::string png_bytes(const std::uint8_t* samples, int height, int width, int channels) {
    const auto rows = static_cast<std::size_t>(height), pixel_bytes = static_cast<std::size_t>(channels);
    const std::size_t row_bytes = static_cast<std::size_t>(width) * pixel_bytes;
    std::string filtered;
    filtered.reserve(rows * (1 + row_bytes));
    PngFilter filter(row_bytes, pixel_bytes);
    for (std::size_t y = 0; y < rows; ++y) filter.append(filtered, samples + y * row_bytes);

    std::string header;
    for (const int side : {width, height}) append_png_number(header, static_cast<std::size_t>(side));
    constexpr char bit_depth = 8, grey = 0, rgb = 2, rgba = 6;
    const char colour = channels == 1 ? grey : channels == 3 ? rgb : rgba;
    header.append({bit_depth, colour, 0, 0, 0}); // deflate, the five filters, not interlaced
    std::string out(png_signature);
    append_png_chunk(out, "IHDR", header);
    constexpr std::size_t most = (std::size_t(1) << 31) - 1; // bytes of a chunk
    const std::string packed = zlib_stream(filtered, 6);
    std::string_view rest = packed;
    do {
        append_png_chunk(out, "IDAT", rest.substr(0, most));
        rest.remove_prefix(std::min(rest.size(), most));
    } while (!rest.empty());
    append_png_chunk(out, "IEND", "");
    return out;
}

} // namespace gsh::detail
