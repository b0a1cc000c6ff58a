// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations in JSON files: a name to start from, and the settings that differ.
#pragma once

#include <gsh/io/settings_file.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/static_configuration.hpp>

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

namespace detail {

/// A file of settings: where it starts from, empty if it does not say, and what differs.
struct SettingsFile {
    std::string path, configuration;
    std::vector<std::pair<std::string, std::string>> settings;

    explicit SettingsFile(const std::filesystem::path& file) : path(file.string()) {
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

/// What looks like a path is one.
[[nodiscard]] inline bool is_configuration_file(const std::string& name_or_path) {
    const std::filesystem::path path(name_or_path);
    return path.extension() == ".json" || path.has_parent_path();
}

} // namespace detail

/// Reads {"configuration": "paper", "rate.sh": 0.001, "multi_scale": false, …}. All members are optional.
/// Errors  IoError for a file that is no flat JSON object; ValueError for a setting that does not exist or cannot be.
[[nodiscard]] inline Configuration read_configuration(const std::filesystem::path& path) {
    const detail::SettingsFile file(path);
    Configuration configuration = named_configuration(file.configuration.empty() ? "paper" : file.configuration);
    file.set(configuration);
    if (!file.settings.empty()) configuration.name = path.stem().string();
    return configuration;
}

/// A configuration by name, or of a file: what looks like a path is one.
[[nodiscard]] inline Configuration find_configuration(const std::string& name_or_path) {
    return detail::is_configuration_file(name_or_path) ? read_configuration(name_or_path)
                                                       : named_configuration(name_or_path);
}

/// Whether a name or a file stands for a static scene, which is configured apart: "static", or {"configuration":
/// "static", …}.
[[nodiscard]] inline bool is_static_configuration(const std::string& name_or_path) {
    if (!detail::is_configuration_file(name_or_path)) return name_or_path == "static";
    return detail::SettingsFile(name_or_path).configuration == "static";
}

/// The settings of a static scene for a run of so many steps, and those that differ in a file, if it is one.
/// Errors  as for read_configuration.
[[nodiscard]] inline StaticConfig find_static_configuration(const std::string& name_or_path, std::int64_t steps) {
    StaticConfig config = static_config(steps);
    if (detail::is_configuration_file(name_or_path)) detail::SettingsFile(name_or_path).set(config);
    return config;
}

} // namespace gsh
