// SPDX-License-Identifier: Apache-2.0
/// @file  Configurations in JSON files: a name to start from, and the settings that differ.
#pragma once

#include <gsh/io/settings_file.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/static_configuration.hpp>

#include <cstdint>
#include <filesystem>
#include <string>

namespace gsh {

namespace detail {

/// What a file of settings starts from; empty if it does not say.
[[nodiscard]] inline std::string configuration_of_file(const std::filesystem::path& path) {
    for (const auto& [key, text] : read_settings(path))
        if (key == "configuration") return text;
    return {};
}

/// What looks like a path is one.
[[nodiscard]] inline bool is_configuration_file(const std::string& name_or_path) {
    const std::filesystem::path path(name_or_path);
    return path.extension() == ".json" || path.has_parent_path();
}

/// Sets what a file says; false if it says no more than where it starts from.
template <class C>
bool set_settings(C& configuration, const std::filesystem::path& path) {
    bool any = false;
    for (const auto& [key, text] : read_settings(path))
        if (key != "configuration") set_setting(configuration, key, text, path.string()), any = true;
    return any;
}

} // namespace detail

/// Reads {"configuration": "paper", "rate.sh": 0.001, "multi_scale": false, …}. All members are optional.
/// Errors  IoError for a file that is no flat JSON object; ValueError for a setting that does not exist or cannot be.
[[nodiscard]] inline Configuration read_configuration(const std::filesystem::path& path) {
    const std::string name = detail::configuration_of_file(path);
    Configuration configuration = named_configuration(name.empty() ? "paper" : name);
    if (detail::set_settings(configuration, path)) configuration.name = path.stem().string();
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
    return (detail::is_configuration_file(name_or_path) ? detail::configuration_of_file(name_or_path) : name_or_path) ==
           "static";
}

/// The settings of a static scene for a run of so many steps, and those that differ in a file, if it is one.
/// Errors  as for read_configuration.
[[nodiscard]] inline StaticConfig find_static_configuration(const std::string& name_or_path, std::int64_t steps) {
    StaticConfig config = static_config(steps);
    if (detail::is_configuration_file(name_or_path)) detail::set_settings(config, name_or_path);
    return config;
}

} // namespace gsh
