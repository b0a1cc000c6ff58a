// SPDX-License-Identifier: Apache-2.0
/// @file  Walks the include lines of include/gsh, so that the floor plan of docs/architecture.md stays a fact.

#include <doctest/doctest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace fs = std::filesystem;

namespace {

/// A header includes its own folder and the floors below, never a neighbour on its floor.
const std::map<std::string, int, std::less<>> floor_of = {
    {"core", 0},                                                                                  //
    {"math", 1},   {"backend", 1},                                                                //
    {"camera", 2}, {"body", 2},   {"gaussian", 2}, {"field", 2}, {"image", 2}, {"optim", 2},      //
    {"avatar", 3}, {"render", 3}, {"prior", 3},    {"loss", 3},  {"io", 4},                       //
    {"train", 5},  {"synthetic", 5},
};

/// Third-party headers that only one folder may include, because gsh::gsh comes without them.
const std::map<std::string, std::set<std::string>, std::less<>> opt_in_libraries = {
    {"zip.h", {"io"}},      {"zlib.h", {"io"}},     {"stb/", {"io"}},        {"stb_", {"io"}},
    {"nlohmann/", {"io"}},  {"CLI/", {}},           {"embree", {"synthetic"}}, {"xsimd/", {"math/pack.hpp"}},
    {"benchmark/", {}},     {"doctest/", {}},
};

struct Include {
    std::string path; ///< as written between the brackets
    int line;
    bool quoted;
};

struct Header {
    std::string path; ///< relative to include/gsh: "math/sh.hpp"
    std::vector<std::string> lines;
    std::vector<Include> includes;

    /// First folder of the path, empty for the umbrellas.
    std::string folder() const {
        const auto slash = path.find('/');
        return slash == std::string::npos ? "" : path.substr(0, slash);
    }
    std::string at(int line) const { return "include/gsh/" + path + ":" + std::to_string(line) + ": "; }
};

std::vector<Include> includes_of(const std::vector<std::string>& lines) {
    std::vector<Include> includes;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        std::string_view text = lines[i];
        const auto skip_blanks = [&] { text.remove_prefix(std::min(text.find_first_not_of(" \t"), text.size())); };
        skip_blanks();
        if (!text.starts_with('#')) continue;
        text.remove_prefix(1);
        skip_blanks();
        if (!text.starts_with("include")) continue;
        const auto open = text.find_first_of("<\""), close = text.find_last_of(">\"");
        if (open == std::string_view::npos || close <= open) continue;
        includes.push_back({std::string(text.substr(open + 1, close - open - 1)), static_cast<int>(i) + 1,
                            text[open] == '"'});
    }
    return includes;
}

const std::vector<Header>& headers() {
    static const std::vector<Header> all = [] {
        std::vector<Header> found;
        const fs::path root = fs::path(GSH_SOURCE_DIR) / "include" / "gsh";
        for (const auto& entry : fs::recursive_directory_iterator(root)) {
            const auto extension = entry.path().extension();
            if (extension != ".hpp" && extension != ".cuh") continue;
            Header header{fs::relative(entry.path(), root).generic_string(), {}, {}};
            std::ifstream file(entry.path());
            for (std::string line; std::getline(file, line);) header.lines.push_back(line);
            header.includes = includes_of(header.lines);
            found.push_back(std::move(header));
        }
        std::ranges::sort(found, {}, &Header::path);
        return found;
    }();
    return all;
}

/// "gsh/math/sh.hpp" -> "math/sh.hpp"; empty for what is not ours.
std::string ours(const std::string& include) { return include.starts_with("gsh/") ? include.substr(4) : ""; }

/// Headers that need a library beyond gsh::gsh, themselves or through what they include.
std::set<std::string> opt_in_headers() {
    std::set<std::string> opt_in = {"math/pack.hpp"};
    for (const auto& header : headers())
        if (header.folder() == "io" || header.folder() == "synthetic") opt_in.insert(header.path);
    for (std::size_t before = 0; before != opt_in.size();) {
        before = opt_in.size();
        for (const auto& header : headers())
            for (const auto& include : header.includes)
                if (opt_in.contains(ours(include.path))) opt_in.insert(header.path);
    }
    return opt_in;
}

bool is_umbrella(const Header& header) { return header.folder().empty(); }

} // namespace

TEST_CASE("headers include their own folder and lower floors only") {
    REQUIRE(headers().size() > 10);
    for (const auto& header : headers()) {
        if (is_umbrella(header)) continue;
        const auto own = floor_of.find(header.folder());
        CHECK_MESSAGE(own != floor_of.end(), header.at(1), "folder ", header.folder(), " has no floor");
        if (own == floor_of.end()) continue;
        for (const auto& include : header.includes) {
            const std::string target = ours(include.path);
            CHECK_MESSAGE(!include.quoted, header.at(include.line), "write #include <gsh/...>");
            if (target.empty()) continue;
            const std::string folder = target.substr(0, target.find('/'));
            const auto other = floor_of.find(folder);
            CHECK_MESSAGE(other != floor_of.end(), header.at(include.line), include.path, " is in no known folder");
            if (other == floor_of.end()) continue;
            CHECK_MESSAGE((folder == own->first || other->second < own->second), header.at(include.line), own->first,
                          " (floor ", own->second, ") includes ", include.path, " (floor ", other->second, ")");
        }
    }
}

TEST_CASE("included headers of ours exist") {
    std::set<std::string> known;
    for (const auto& header : headers()) known.insert(header.path);
    for (const auto& header : headers())
        for (const auto& include : header.includes) {
            const std::string target = ours(include.path);
            if (!target.empty())
                CHECK_MESSAGE(known.contains(target), header.at(include.line), include.path, " does not exist");
        }
}

TEST_CASE("each header begins with licence, sentence and guard") {
    for (const auto& header : headers()) {
        REQUIRE_MESSAGE(header.lines.size() > 3, header.path);
        CHECK_MESSAGE(header.lines[0] == "// SPDX-License-Identifier: Apache-2.0", header.at(1), header.lines[0]);
        CHECK_MESSAGE(header.lines[1].starts_with("/// @file  "), header.at(2), header.lines[1]);
        CHECK_MESSAGE(std::ranges::find(header.lines, "#pragma once") != header.lines.end(), header.at(1),
                      "no #pragma once");
    }
}

TEST_CASE("no line of a header is longer than 120 characters") {
    for (const auto& header : headers())
        for (std::size_t i = 0; i < header.lines.size(); ++i) {
            const auto bytes_of_characters = [](char c) { return (c & 0xC0) != 0x80; }; // UTF-8
            const auto length = std::ranges::count_if(header.lines[i], bytes_of_characters);
            CHECK_MESSAGE(length <= 120, header.at(static_cast<int>(i) + 1), length, " characters");
        }
}

TEST_CASE("opt-in libraries stay in their folders") {
    for (const auto& header : headers())
        for (const auto& include : header.includes)
            for (const auto& [library, homes] : opt_in_libraries)
                CHECK_MESSAGE((!include.path.starts_with(library) || homes.contains(header.folder()) ||
                               homes.contains(header.path)),
                              header.at(include.line), "<", include.path, "> belongs elsewhere");
}

TEST_CASE("gsh.hpp lists every header that gsh::gsh can serve, and no other") {
    const auto umbrella = std::ranges::find(headers(), "gsh.hpp", &Header::path);
    REQUIRE(umbrella != headers().end());
    const auto opt_in = opt_in_headers();
    std::set<std::string> expected, listed;
    for (const auto& header : headers())
        if (!is_umbrella(header) && header.path.ends_with(".hpp") && !opt_in.contains(header.path))
            expected.insert(header.path);
    for (const auto& include : umbrella->includes) {
        const std::string target = ours(include.path);
        CHECK_MESSAGE(expected.contains(target), umbrella->at(include.line), include.path,
                      " is not a header of gsh::gsh");
        CHECK_MESSAGE(listed.insert(target).second, umbrella->at(include.line), include.path, " stands here twice");
    }
    for (const auto& path : expected)
        CHECK_MESSAGE(listed.contains(path), "include/gsh/gsh.hpp: <gsh/", path, "> is missing; run scripts/house");
}

TEST_CASE("every function object that backends run is among those that nvcc compiles") {
    std::ifstream file(fs::path(GSH_SOURCE_DIR) / "tests" / "device" / "kernels_test.cu");
    const std::string kernels{std::istreambuf_iterator<char>(file), {}};
    REQUIRE(kernels.size() > 1000);
    const std::set<std::string> exempt{"NoOp"}; // what the concept Backend asks about
    std::size_t found = 0;
    for (const auto& header : headers()) {
        std::string name;
        for (std::size_t i = 0; i < header.lines.size(); ++i) {
            const std::string& line = header.lines[i];
            const auto begin = line.find_first_not_of(' ');
            if (begin != std::string::npos && line.compare(begin, 7, "struct ") == 0)
                name = line.substr(begin + 7, line.find_first_of(" ;{:", begin + 7) - begin - 7);
            if (line.find("GSH_HD void operator()(std::size_t") == std::string::npos || exempt.contains(name)) continue;
            ++found;
            const bool there = kernels.find("::" + name + "<") != std::string::npos;
            CHECK_MESSAGE(there, header.at(static_cast<int>(i) + 1), name,
                          " is missing in tests/device/kernels_test.cu");
        }
    }
    CHECK(found > 30);
}

TEST_CASE("docs/architecture.md lists every header with its sentence") {
    std::ifstream file(fs::path(GSH_SOURCE_DIR) / "docs" / "architecture.md");
    std::set<std::string> lines;
    for (std::string line; std::getline(file, line);) lines.insert(line);
    REQUIRE(!lines.empty());
    for (const auto& header : headers()) {
        if (is_umbrella(header) || header.lines.size() < 2 || header.lines[1].size() < 11) continue;
        const std::string row = "| `" + header.path + "` | " + header.lines[1].substr(11) + " |";
        CHECK_MESSAGE(lines.contains(row), "docs/architecture.md lacks '", row, "'; run scripts/house");
    }
}
