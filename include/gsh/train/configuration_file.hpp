// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations in JSON files: a name to start from, and the settings that differ.
#pragma once

#include <gsh/io/settings_file.hpp>
#include <gsh/train/configuration.hpp>

#include <filesystem>
#include <string>

namespace gsh {

/// Reads {"configuration": "paper", "rate.sh": 0.001, "multi_scale": false, …}. All members are optional.
/// Errors  IoError for a file that is no flat JSON object; ValueError for a setting that does not exist or cannot be.
[[nodiscard]] inline Configuration read_configuration(const std::filesystem::path& path) {
    const auto settings = read_settings(path);
    Configuration configuration;
    for (const auto& [key, text] : settings)
        if (key == "configuration") configuration = named_configuration(text);
    for (const auto& [key, text] : settings) {
        if (key == "configuration") continue;
        set_setting(configuration, key, text, path.string());
        configuration.name = path.stem().string();
    }
    return configuration;
}

/// A configuration by name, or of a file: what looks like a path is one.
[[nodiscard]] inline Configuration find_configuration(const std::string& name_or_path) {
    const std::filesystem::path path(name_or_path);
    return path.extension() == ".json" || path.has_parent_path() ? read_configuration(path) : named_configuration(name_or_path);
}

} // namespace gsh
