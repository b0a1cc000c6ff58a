// SPDX-License-Identifier: Apache-2.0
/// @file  Lists of types with names: a choice that a file or a command line makes becomes a type.
#pragma once

#include <gsh/core/error.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace gsh {

namespace detail {

/// A string as a template argument.
template <std::size_t N>
struct FixedString {
    char text[N];
    consteval FixedString(const char (&from)[N]) { std::copy_n(from, N, text); }
};

} // namespace detail

/// A type and its name in files, as an entry of NamedTypes. The type need not be complete.
template <detail::FixedString Name, class T>
struct Named {
    static constexpr std::string_view name{Name.text};
    using type = T;
};

/// Types among which a name chooses: entries are Named.
template <class... Entries>
struct NamedTypes {
    static constexpr std::array<std::string_view, sizeof...(Entries)> names{Entries::name...};

    /// The same list with more entries at its end.
    template <class... More>
    using With = NamedTypes<Entries..., More...>;

    /// Errors  ValueError that lists the names, unless the list has this one. `what` is what the name chooses.
    static void check_name(std::string_view what, std::string_view name) {
        if (std::find(names.begin(), names.end(), name) != names.end()) return;
        std::string message(what);
        message.append(" is '").append(name).append("', expected one of ");
        for (const std::string_view known : names) message.append(known == names.front() ? "" : ", ").append(known);
        throw ValueError(message);
    }

    /// use(std::type_identity<T>()) with the type T of that name. The results for all types have one type.
    /// Errors  those of check_name.
    template <class Use>
    static auto choose(std::string_view what, std::string_view name, const Use& use) {
        check_name(what, name);
        return choose_from<Use, Entries...>(name, use);
    }

private:
    template <class Use, class First, class... Rest>
    static auto choose_from(std::string_view name, const Use& use) {
        if constexpr (sizeof...(Rest) > 0)
            if (First::name != name) return choose_from<Use, Rest...>(name, use);
        return use(std::type_identity<typename First::type>());
    }
};

} // namespace gsh
