// SPDX-License-Identifier: Apache-2.0
/// @file  The options of a command line as text, so that a run can be resumed without naming them again.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/json_file.hpp>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <filesystem>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::programs {

/// The options that were given, except those of the second list: {"folder": the current one, "options": {name: words}}.
[[nodiscard]] inline std::string given_options(const CLI::App& app, const std::vector<std::string>& except) {
    nlohmann::json stored;
    std::error_code ignored;
    stored["folder"] = std::filesystem::current_path(ignored).string();
    stored["options"] = nlohmann::json::object();
    for (const CLI::Option* option : app.get_options())
        if (const std::string name = option->get_name();
            option->count() > 0 && std::find(except.begin(), except.end(), name) == except.end())
            stored["options"][name] = option->results();
    return stored.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// The JSON of a text of given_options, which may be of a foreign file.
/// Errors  those of parse_json, beginning with `where`.
[[nodiscard]] inline nlohmann::json stored_options(const std::string& text, const std::string& where) {
    return gsh::detail::parse_json<nlohmann::json>(text, where + ": options", {.depth = 8});
}

/// Whether two texts of given_options hold the same words for all options but those of the list. A text that
/// given_options did not write is the same as none.
[[nodiscard]] inline bool same_options(const std::string& a, const std::string& b,
                                       const std::vector<std::string>& except) {
    const auto options_of = [&](const std::string& text) {
        nlohmann::json stored;
        try {
            stored = stored_options(text, "text");
        } catch (const Error&) {
            return nlohmann::json(); // not a text of given_options
        }
        nlohmann::json options = stored.is_object() ? stored.value("options", nlohmann::json()) : nlohmann::json();
        if (options.is_object())
            for (const std::string& name : except) options.erase(name);
        return options;
    };
    const nlohmann::json first = options_of(a);
    return first.is_object() && first == options_of(b);
}

/// Gives each option that the command line leaves out the words of an earlier one. `rivals` are options of which only
/// one can be given: where this command line has one, the earlier one's are left out. A word that named a file beside
/// the earlier run does so again, from wherever this one is started.
///
/// Errors  ValueError or IoError, beginning with `where`, for a text that given_options did not write; those of the
///         options.
inline void restore_options(CLI::App& app, const std::string& text, const std::string& where,
                            const std::vector<std::string>& rivals = {}) {
    const nlohmann::json stored = stored_options(text, where);
    check_value(stored.is_object() && stored.value("options", nlohmann::json()).is_object() &&
                    stored.value("folder", nlohmann::json("")).is_string(),
                where, "holds options that cannot be read; name all options again");
    const std::filesystem::path folder = stored.value("folder", std::string());
    const auto given = [&](const std::string& name) { return app.get_option(name)->count() > 0; };
    const bool rival_given = std::any_of(rivals.begin(), rivals.end(), given);
    for (const auto& [name, words] : stored["options"].items()) {
        CLI::Option* option = app.get_option_no_throw(name);
        check_value(option != nullptr && words.is_array(), where,
                    "was written with " + gsh::detail::shortened(name) +
                        ", which is no option any more; name all options again");
        const bool is_rival = std::find(rivals.begin(), rivals.end(), name) != rivals.end();
        if (option->count() > 0 || (is_rival && rival_given)) continue;
        for (const nlohmann::json& word : words) {
            check_value(word.is_string(), where, name + " holds a word that is no text; name all options again");
            std::string value = word.get<std::string>();
            std::error_code ignored;
            if (!std::filesystem::exists(value, ignored) && std::filesystem::exists(folder / value, ignored))
                value = (folder / value).lexically_normal().string();
            option->add_result(std::move(value));
        }
        option->run_callback();
    }
}

} // namespace gsh::programs
