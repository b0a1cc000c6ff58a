// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations in JSON files: the name of a base configuration and the settings that differ from it.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/settings_file.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/train/static_model.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// A file of settings: the name of its base configuration (empty if not given), and the settings that differ.
struct SettingsFile {
    std::string path, configuration;
    std::vector<std::pair<std::string, std::string>> settings;

    explicit SettingsFile(const InputFile& file) : path(file.name()) {
        for (auto& [key, text] : read_settings(file)) {
            if (key == "configuration")
                configuration = text;
            else
                settings.emplace_back(key, text);
        }
    }
    template <class C>
    void set(C& config) const {
        for (const auto& [key, text] : settings) set_setting(config, key, text, path);
    }
};

/// Whether the text is a path: it has a folder or the extension .json.
[[nodiscard]] inline bool is_configuration_file(const std::string& name_or_path) {
    const std::filesystem::path path(name_or_path);
    return path.extension() == ".json" || path.has_parent_path();
}

/// named_configuration with "static" rejected by a message of its own. `or_else` lists further alternatives to a name.
[[nodiscard]] inline Configuration configuration_of_person(const std::string& name, std::string_view where,
                                                           const std::string& or_else = {}) {
    check_value(name != "static", where, "static is no person's configuration; find_static_configuration reads it");
    return named_configuration(name, where, ", static" + or_else);
}

} // namespace detail

/// Reads {"configuration": "paper", "rate.sh": 0.001, "hash_sh": false, …}. All members are optional; without
/// "configuration", the file changes default_configuration.
///
/// Errors  IoError for a file that is not a flat JSON object; ValueError, naming the file, for an unknown configuration
///         or setting, or an invalid value. check_settings checks names of types (ao, appearance), because a program
///         may list types of its own.
[[nodiscard]] inline Configuration read_configuration(const InputFile& input) {
    const detail::SettingsFile file(input);
    Configuration configuration = detail::configuration_of_person(
        file.configuration.empty() ? std::string(default_configuration) : file.configuration, file.path);
    file.set(configuration);
    if (!file.settings.empty()) configuration.name = input.path().stem().string();
    return configuration;
}

/// A configuration by name or by path (see is_configuration_file). `where` is the caller's name, for messages.
[[nodiscard]] inline Configuration find_configuration(const std::string& name_or_path,
                                                      std::string_view where = "find_configuration") {
    return detail::is_configuration_file(name_or_path)
               ? read_configuration(name_or_path)
               : detail::configuration_of_person(name_or_path, where, ", or a JSON file of settings");
}

/// Whether a name or a file denotes a static scene, which has its own configuration: "static", or a file with
/// {"configuration": "static", …}.
[[nodiscard]] inline bool is_static_configuration(const std::string& name_or_path) {
    if (!detail::is_configuration_file(name_or_path)) return name_or_path == "static";
    return detail::SettingsFile(name_or_path).configuration == "static";
}

/// The settings of a static scene for a run of `steps` steps, changed by those in a file if the argument is a path.
///
/// Errors  those of read_configuration.
[[nodiscard]] inline StaticModelParams find_static_configuration(const std::string& name_or_path, std::int64_t steps) {
    StaticModelParams config = static_model_params(steps);
    if (detail::is_configuration_file(name_or_path)) detail::SettingsFile(name_or_path).set(config);
    return config;
}

} // namespace gsh
