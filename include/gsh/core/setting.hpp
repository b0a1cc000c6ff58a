// SPDX-License-Identifier: Apache-2.0
/// @file  One setting of a configuration as text: printing, reading, and the range of its numbers.
#pragma once

#include <gsh/core/error.hpp>

#include <bit>
#include <charconv>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>

namespace gsh {

namespace detail {

/// Specialisations have `names`: those of an enumeration's values, in order.
template <class E>
struct EnumNames;

template <class V>
[[nodiscard]] std::string setting_text(const V& value) {
    if constexpr (std::is_same_v<V, bool>) {
        return value ? "true" : "false";
    } else if constexpr (std::is_enum_v<V>) {
        return std::string(EnumNames<V>::names[static_cast<std::size_t>(value)]);
    } else {
        char text[32];
        const auto end = std::to_chars(text, text + sizeof text, value); // the shortest that reads back as the same
        return {text, end.ptr};
    }
}

} // namespace detail

/// The range of a number. By default, any finite number.
struct SettingRange {
    double least = -std::numeric_limits<double>::infinity();
    double most = std::numeric_limits<double>::infinity();
    bool with_least = true, with_most = true; ///< whether the ends belong to the range
    bool powers_of_two = false;               ///< whether only powers of two belong to it

    [[nodiscard]] static constexpr SettingRange at_least(double end) { return {.least = end}; }
    [[nodiscard]] static constexpr SettingRange above(double end) { return {.least = end, .with_least = false}; }
    [[nodiscard]] static constexpr SettingRange power_of_two() { return {.least = 1, .powers_of_two = true}; }
    [[nodiscard]] constexpr SettingRange up_to(double end) const { return {least, end, with_least, true}; }
    [[nodiscard]] constexpr SettingRange below(double end) const { return {least, end, with_least, false}; }

    template <class V>
    [[nodiscard]] constexpr bool holds(V value) const {
        const auto number = static_cast<double>(value);
        if (!(with_least ? number >= least : number > least)) return false;
        if (!(with_most ? number <= most : number < most)) return false;
        if constexpr (std::unsigned_integral<V>) return !powers_of_two || std::has_single_bit(value);
        return !powers_of_two;
    }

    /// The range in words: "a number of at least 0 and below 1". `kind` is the beginning, "a number".
    [[nodiscard]] std::string words(std::string_view kind) const {
        if (powers_of_two) return "a power of two";
        std::string text(kind);
        const auto add = [&](double end, bool counts, const char* with, const char* without) {
            if (std::isinf(end)) return;
            text.append(text != kind ? " and " : counts ? " of " : " ");
            text.append(counts ? with : without).append(detail::setting_text(end));
        };
        add(least, with_least, "at least ", "above ");
        add(most, with_most, "at most ", "below ");
        return text;
    }
};

namespace detail {

/// Errors  ValueError that names the setting, what was found and what was expected.
template <class V>
void set_from_text(std::string_view where, const std::string& text, V& value, const SettingRange& range) {
    const auto refuse = [&](const std::string& expected) {
        throw ValueError(std::string(where) + " is '" + text + "', expected " + expected);
    };
    if constexpr (std::is_same_v<V, bool>) {
        if (text != "true" && text != "false") refuse("true or false");
        value = text == "true";
    } else if constexpr (std::is_enum_v<V>) {
        std::string all;
        for (std::size_t i = 0; i < EnumNames<V>::names.size(); ++i) {
            if (text == EnumNames<V>::names[i]) {
                value = static_cast<V>(i);
                return;
            }
            all += (i ? ", " : "") + std::string(EnumNames<V>::names[i]);
        }
        refuse("one of " + all);
    } else {
        const std::string expected = range.words(std::integral<V> ? "a whole number" : "a number");
        V number{};
        const auto end = std::from_chars(text.data(), text.data() + text.size(), number);
        if (end.ec == std::errc::result_out_of_range)
            refuse(expected + " that fits " + std::to_string(8 * sizeof(V)) + " bits");
        if (end.ec != std::errc() || end.ptr != text.data() + text.size()) refuse(expected);
        if constexpr (std::is_floating_point_v<V>)
            if (!std::isfinite(number)) refuse(range.words("a finite number"));
        if (!range.holds(number)) refuse(expected);
        value = number;
    }
}

} // namespace detail

} // namespace gsh
