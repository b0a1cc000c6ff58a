// SPDX-License-Identifier: Apache-2.0
/// @file  The version stands in one header, and everything that repeats it agrees.
#include <gsh/core/config.hpp>

#include <gsh/io/file/input_file.hpp>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <regex>
#include <string>

using namespace gsh;

namespace {

std::string version_file(const char* path) {
    return read_file(std::filesystem::path(GSH_SOURCE_DIR) / path);
}
/// The first group of the first match in a file.
std::string first_match(const char* path, const char* pattern) {
    const std::string text = version_file(path);
    std::smatch match;
    return std::regex_search(text, match, std::regex(pattern)) ? match[1].str() : "";
}

} // namespace

TEST_CASE("the changelog and the recipes of packages have the version of the headers") {
    const std::string version = GSH_VERSION_TEXT;
    CHECK(version == std::to_string(GSH_VERSION_MAJOR) + "." + std::to_string(GSH_VERSION_MINOR) + "." +
                         std::to_string(GSH_VERSION_PATCH));
    CHECK(first_match("CHANGELOG.md", R"(\n## \[([0-9.]+)\])") == version);
    CHECK(first_match("packaging/debian/changelog", R"(^gsh \(([0-9.]+)-)") == version);
    CHECK(nlohmann::json::parse(version_file("packaging/vcpkg/ports/gsh/vcpkg.json")).at("version") == version);
}
