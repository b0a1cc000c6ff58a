// SPDX-License-Identifier: Apache-2.0
/// @file  Settings: the members of a struct that have names, for files, command lines and reports, and their ranges.
///
/// A struct of settings lists them beside its members:
///
///     struct BlurParams {
///         double width = 2; ///< pixels
///         Edge edge = Edge::repeat;
///
///         template <class Self, class F>
///         static void for_each_setting(Self& self, const F& f) {
///             f("blur.width", self.width, SettingRange::above(0));
///             f("blur.edge", self.edge, SettingRange());
///         }
///     };
///
/// A struct of such structs calls theirs. Names stand in full, so that they can be searched for.
#pragma once

#include <gsh/core/enum_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

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
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

template <class V>
[[nodiscard]] std::string setting_text(const V& value) {
    if constexpr (std::is_same_v<V, bool>) {
        return value ? "true" : "false";
    } else if constexpr (std::is_enum_v<V>) {
        return std::string(EnumNames<V>::names[static_cast<std::size_t>(value)]);
    } else if constexpr (std::is_same_v<V, std::string>) {
        return value;
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
    [[nodiscard]] static constexpr SettingRange share() { return {.least = 0, .most = 1}; }
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
        throw ValueError(std::string(where) + " is '" + shortened(text) + "', expected " + expected);
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
    } else if constexpr (std::is_same_v<V, std::string>) {
        value = text;
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

/// Calls f(name, value, range) for every setting of a struct. The value is const where the struct is. The range is that
/// of the setting alone: settings that depend on each other are checked where they are used.
template <class P, class F>
void for_each_setting(P& params, const F& f) {
    std::remove_const_t<P>::for_each_setting(params, f);
}

/// Sets one setting from text. `where` names the caller in messages.
/// Errors  ValueError for a setting that does not exist, text that cannot be read, or a number out of range; then
///         nothing changes.
template <class P>
void set_setting(P& params, std::string_view key, const std::string& text, const std::string& where) {
    bool found = false;
    for_each_setting(params, [&](std::string_view name, auto& value, const SettingRange& range) {
        if (name != key) return;
        found = true;
        detail::set_from_text(where + ": " + std::string(name), text, value, range);
    });
    if (!found)
        throw ValueError(where + ": there is no setting '" + detail::shortened(key) +
                         "'; docs/configurations.md lists them");
}

/// Name and text of each setting, in order, for reports.
template <class P>
[[nodiscard]] std::vector<std::pair<std::string, std::string>> settings_of(const P& params) {
    std::vector<std::pair<std::string, std::string>> result;
    for_each_setting(params, [&](std::string_view name, const auto& value, const SettingRange&) {
        result.emplace_back(std::string(name), detail::setting_text(value));
    });
    return result;
}

/// The same without those whose text is empty: a name that is not set says nothing.
template <class P>
[[nodiscard]] std::vector<std::pair<std::string, std::string>> stated_settings_of(const P& params) {
    auto result = settings_of(params);
    std::erase_if(result, [](const auto& setting) { return setting.second.empty(); });
    return result;
}

/// Checks that the numbers of a struct lie within their ranges. `where` names the part that uses them.
/// Errors  ValueError that names the setting, what was found and what was expected.
template <class P>
void check_ranges(std::string_view where, const P& params) {
    for_each_setting(params, [&](std::string_view name, const auto& value, const SettingRange& range) {
        using V = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_arithmetic_v<V> && !std::is_same_v<V, bool>)
            if (!range.holds(value) || !std::isfinite(static_cast<double>(value)))
                throw ValueError(std::string(where) + ": " + std::string(name) + " is " + detail::setting_text(value) +
                                 ", expected " + range.words(std::integral<V> ? "a whole number" : "a finite number"));
    });
}

} // namespace gsh
