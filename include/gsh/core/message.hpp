// SPDX-License-Identifier: Apache-2.0
/// @file  Foreign text, names and numbers in messages: short, printable, and on one line.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::detail {

/// Bytes of the printable character in UTF-8 with which a text begins; 0 where there is none: for control characters,
/// marks that change the direction of what follows, and bytes that are not UTF-8.
[[nodiscard]] inline std::size_t printable_length(std::string_view text) {
    const auto byte = [&](std::size_t i) { return static_cast<std::uint32_t>(static_cast<unsigned char>(text[i])); };
    if (text.empty()) return 0;
    const std::uint32_t lead = byte(0);
    if (lead < 0x80) return lead >= 0x20 && lead != 0x7F;
    const std::size_t length = lead >= 0xC2 && lead < 0xE0 ? 2 : lead >= 0xE0 && lead < 0xF0 ? 3 : lead < 0xF5 ? 4 : 0;
    if (lead < 0xC2 || length == 0 || text.size() < length) return 0;
    std::uint32_t code = lead & (0x7Fu >> length);
    for (std::size_t k = 1; k < length; ++k) {
        if ((byte(k) & 0xC0u) != 0x80u) return 0;
        code = code << 6 | (byte(k) & 0x3Fu);
    }
    constexpr std::uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    const auto within = [&](std::uint32_t first, std::uint32_t last) { return first <= code && code <= last; };
    const bool none = code < least[length] || code > 0x10FFFF || within(0xD800, 0xDFFF) || (code & 0xFFFE) == 0xFFFE ||
                      within(0xFDD0, 0xFDEF) || within(0x80, 0x9F);
    const bool turns = within(0x200B, 0x200F) || within(0x2028, 0x202E) || within(0x2060, 0x206F) || code == 0xFEFF;
    return none || turns ? 0 : length;
}

/// Foreign text for a message: at most 40 printable characters, or `most`.
[[nodiscard]] inline std::string shortened(std::string_view text, std::size_t most = 40) {
    std::string result;
    for (std::size_t count = 0; !text.empty() && count < most; ++count) {
        const std::size_t length = printable_length(text);
        result.append(length ? text.substr(0, length) : std::string_view("?"));
        text.remove_prefix(std::max<std::size_t>(length, 1));
    }
    return text.empty() ? result : result + "…";
}

/// "a, b and 4 more": the first of `count` texts, which text_of(i) returns.
template <class TextOf>
[[nodiscard]] std::string listing(std::size_t count, std::size_t most, const TextOf& text_of) {
    std::string text;
    for (std::size_t i = 0; i < std::min(most, count); ++i) text += (i ? ", " : "") + text_of(i);
    return text + (count > most ? " and " + std::to_string(count - most) + " more" : "");
}

/// Foreign names for a message: the first of them, shortened, and the number of the others; `none` without any.
template <class Names>
[[nodiscard]] std::string listed(const Names& names, std::string_view none, std::size_t most = 8) {
    if (names.empty()) return std::string(none);
    return listing(names.size(), most, [&](std::size_t i) { return shortened(names[i]); });
}

/// A number for a message, with six digits: "0.82", "1e+09".
[[nodiscard]] inline std::string number_text(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

/// A number with a fixed count of digits behind the point: "12.35" for 2; "none" for NaN.
[[nodiscard]] inline std::string fixed(double value, int digits) {
    if (std::isnan(value)) return "none";
    char text[32];
    std::snprintf(text, sizeof text, "%.*f", digits, value);
    return text;
}

/// Numbers of frames, in ascending order, as spans: "22-29", "0, 3-5".
[[nodiscard]] inline std::string frames_text(const std::vector<std::size_t>& frames) {
    std::string text;
    for (std::size_t begin = 0, end = 0; begin < frames.size(); begin = end) {
        end = begin + 1;
        while (end < frames.size() && frames[end] == frames[end - 1] + 1) ++end;
        text += (text.empty() ? "" : ", ") + std::to_string(frames[begin]);
        if (end - begin > 1) text.append("-").append(std::to_string(frames[end - 1]));
    }
    return text;
}

} // namespace gsh::detail
