// SPDX-License-Identifier: Apache-2.0
/// @file  Checks the include lines of include/gsh against the floor plan in docs/architecture.md.

#include "house/source_lines.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fs = std::filesystem;
using namespace gsh::test;

namespace {

std::ptrdiff_t characters(const std::string& line) { // UTF-8
    return std::ranges::count_if(line, [](char c) { return (c & 0xC0) != 0x80; });
}

std::vector<std::string> page() { return lines_of(fs::path(GSH_SOURCE_DIR) / "docs" / "architecture.md"); }

/// Calls found(row, folder) for each folder that a table row of docs/architecture.md names in its second column; `row`
/// is the first column.
template <class Found>
void for_each_folder(const std::regex& first_column, const Found& found) {
    static const std::regex row("\\| ([^|]*) \\| ([^|]*) \\|.*"), name("`([a-z]+)/?`");
    for (const std::string& line : page()) {
        std::smatch cells;
        if (!std::regex_match(line, cells, row) || !std::regex_match(cells[1].str(), first_column)) continue;
        const std::string folders = cells[2];
        for (std::sregex_iterator it(folders.begin(), folders.end(), name), end; it != end; ++it)
            found(cells[1].str(), (*it)[1].str());
    }
}

/// The floor of each folder. A header includes its own folder and the floors below, never a neighbour on its floor.
const std::map<std::string, int, std::less<>>& floor_of() {
    static const auto floors = [] {
        std::map<std::string, int, std::less<>> found;
        for_each_folder(std::regex("[0-9]"),
                        [&](const std::string& floor, const std::string& folder) { found[folder] = std::stoi(floor); });
        return found;
    }();
    return floors;
}

/// Folders whose headers belong to a target of their own.
const std::set<std::string>& opt_in_folders() {
    static const auto folders = [] {
        std::set<std::string> found;
        for_each_folder(std::regex("`gsh::[a-z]+`"),
                        [&](const std::string&, const std::string& folder) { found.insert(folder); });
        return found;
    }();
    return folders;
}

/// Third-party headers that only one folder may include, because gsh::gsh does not link their libraries.
const std::map<std::string, std::set<std::string>, std::less<>> opt_in_libraries = {
    {"zip.h", {"io"}},      {"zlib.h", {"io"}},     {"zstd.h", {"io"}},     {"stb/", {"io"}},        {"stb_", {"io"}},
    {"nlohmann/", {"io"}},  {"CLI/", {}},           {"embree", {"synthetic"}},
    {"benchmark/", {}},     {"doctest/", {}},       {"tiny_gltf.h", {"io"}},
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

const std::vector<Header>& headers() {
    static const std::vector<Header> all = [] {
        std::vector<Header> found;
        const fs::path root = fs::path(GSH_SOURCE_DIR) / "include" / "gsh";
        for (const auto& entry : fs::recursive_directory_iterator(root)) {
            const auto extension = entry.path().extension();
            if (extension != ".hpp" && extension != ".cuh") continue;
            Header header{fs::relative(entry.path(), root).generic_string(), {}, {}};
            header.lines = lines_of(entry.path());
            header.includes = includes_of(header.lines);
            found.push_back(std::move(header));
        }
        std::ranges::sort(found, {}, &Header::path);
        return found;
    }();
    return all;
}

/// "gsh/math/sh.hpp" -> "math/sh.hpp"; empty for other headers.
std::string ours(const std::string& include) { return include.starts_with("gsh/") ? include.substr(4) : ""; }

bool is_umbrella(const Header& header) { return header.folder().empty(); }

/// Headers of the CPU backends. A translation unit for another backend compiles without them. Therefore only
/// gsh/cpu.hpp and other headers of this kind may include them.
bool is_of_cpu(const std::string& path) {
    return path.find("/cpu/") != std::string::npos || path == "backend/threads.hpp" || path.starts_with("math/wide");
}

/// Headers for nvcc, which only gsh/cuda.cuh and other headers of this kind may include.
bool is_of_cuda(const std::string& path) { return path.ends_with(".cuh"); }

/// Whether a line seems to have an atomic operation on floating-point numbers: its result would depend on the order of
/// the threads. Those that do not name a type fail to compile on the emulation (backend/cuda/emulation_test.cpp). This
/// is no guard against instructions of PTX, and loops of atomicCAS on the bits of a number.
bool has_atomic_float(const std::string& line) {
    static const std::regex pattern("atomic[A-Z][A-Za-z]*\\s*\\([^;]*\\b(float|double|__half2?|T)\\b|atomicCAS|"
                                    "\\b(red|atom)\\.[a-z0-9.:]*\\.b?f(16|32|64)");
    return std::regex_search(line, pattern);
}

/// The headers of gsh that an umbrella includes, each once.
std::set<std::string> listed_by(const std::string& umbrella) {
    std::set<std::string> listed;
    const auto header = std::ranges::find(headers(), umbrella, &Header::path);
    REQUIRE(header != headers().end());
    for (const auto& include : header->includes)
        CHECK_MESSAGE(listed.insert(ours(include.path)).second, header->at(include.line), include.path,
                      " stands here twice");
    return listed;
}

} // namespace

TEST_CASE("headers include their own folder and lower floors only") {
    REQUIRE(headers().size() > 10);
    REQUIRE(floor_of().size() > 10);
    for (const auto& header : headers()) {
        if (is_umbrella(header)) continue;
        const auto own = floor_of().find(header.folder());
        CHECK_MESSAGE(own != floor_of().end(), header.at(1), "folder ", header.folder(), " has no floor");
        if (own == floor_of().end()) continue;
        for (const auto& include : header.includes) {
            const std::string target = ours(include.path);
            CHECK_MESSAGE(!include.quoted, header.at(include.line), "write #include <gsh/...>");
            if (target.empty()) continue;
            const std::string folder = target.substr(0, target.find('/'));
            const auto other = floor_of().find(folder);
            CHECK_MESSAGE(other != floor_of().end(), header.at(include.line), include.path, " is in no known folder");
            if (other == floor_of().end()) continue;
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
            const auto length = characters(header.lines[i]);
            CHECK_MESSAGE(length <= 120, header.at(static_cast<int>(i) + 1), length, " characters");
        }
}

TEST_CASE("no line of prose on a page is longer than 120 characters") { // tables, code and pictures may be
    std::vector<fs::path> pages{fs::path(GSH_SOURCE_DIR) / "README.md",
                                fs::path(GSH_SOURCE_DIR) / "examples" / "README.md"};
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(GSH_SOURCE_DIR) / "docs"))
        if (entry.path().extension() == ".md") pages.push_back(entry.path());
    CHECK(pages.size() > 50);
    for (const fs::path& path : pages) {
        bool fenced = false;
        int number = 0;
        for (const std::string& line : lines_of(path)) {
            ++number;
            if (line.starts_with("```")) fenced = !fenced;
            if (fenced || line.starts_with("    ") || line.find_first_of("|!") == line.find_first_not_of(' ')) continue;
            const auto length = characters(line);
            CHECK_MESSAGE(length <= 120, path.string(), ":", number, ": ", length, " characters");
        }
    }
}

TEST_CASE("what the CPU backends run lies in the inline namespace of its instruction set") {
    std::size_t found = 0;
    for (const auto& header : headers())
        for (std::size_t i = 0; i < header.lines.size(); ++i) {
            const std::string& line = header.lines[i];
            if (!line.starts_with("namespace gsh::cpu") && !line.starts_with("namespace cpu")) continue;
            ++found;
            CHECK_MESSAGE(line.find("cpu::inline GSH_ISA") != std::string::npos, header.at(static_cast<int>(i) + 1),
                          "write namespace gsh::cpu::inline GSH_ISA; see core/config.hpp");
        }
    CHECK(found > 10);
}

TEST_CASE("the folders of io/ have floors, too: a header there includes its own folder and lower floors") {
    std::map<std::string, std::string, std::less<>> floors;
    for_each_folder(std::regex("io [0-9]"),
                    [&](const std::string& floor, const std::string& folder) { floors[folder] = floor; });
    const auto folder_of = [](std::string_view path) { // "io/file/npy.hpp": "file"; others: empty
        if (!path.starts_with("io/")) return std::string();
        path.remove_prefix(3);
        return std::string(path.substr(0, path.find('/')));
    };
    std::size_t checked = 0;
    for (const auto& header : headers()) {
        const std::string home = folder_of(header.path);
        if (home.empty()) continue;
        CHECK_MESSAGE(floors.contains(home), header.path, " is in no folder that docs/architecture.md has a floor for");
        for (const auto& include : header.includes) {
            const std::string other = folder_of(ours(include.path));
            if (other.empty() || other == home) continue;
            ++checked;
            CHECK_MESSAGE(floors[other] < floors[home], header.at(include.line), "io/", home, " may not include io/",
                          other);
        }
    }
    CHECK(checked > 100);
}

TEST_CASE("opt-in libraries stay in their folders") {
    for (const auto& header : headers())
        for (const auto& include : header.includes)
            for (const auto& [library, homes] : opt_in_libraries)
                CHECK_MESSAGE((!include.path.starts_with(library) || homes.contains(header.folder())),
                              header.at(include.line), "<", include.path, "> belongs elsewhere");
}

TEST_CASE("no component includes what belongs to the CPU backends") {
    for (const auto& header : headers()) {
        if (is_of_cpu(header.path) || is_umbrella(header)) continue;
        for (const auto& include : header.includes) {
            const std::string target = ours(include.path);
            CHECK_MESSAGE(!is_of_cpu(target), header.at(include.line), "a translation unit for another backend would ",
                          "compile ", include.path, "; its user includes it, or gsh/cpu.hpp");
            CHECK_MESSAGE(target != "cpu.hpp", header.at(include.line), "umbrellas are for users");
            CHECK_MESSAGE(!include.path.starts_with("tbb/"), header.at(include.line), "oneTBB belongs to cpu::Threads");
        }
    }
}

TEST_CASE("what the CUDA backend runs lies in folders cuda/, and no other header includes it") {
    std::size_t found = 0;
    for (const auto& header : headers()) {
        if (is_umbrella(header)) continue;
        CHECK_MESSAGE(is_of_cuda(header.path) == (header.path.find("/cuda/") != std::string::npos), header.path,
                      ": .cuh headers belong in a folder cuda/, and no others do");
        if (is_of_cuda(header.path)) {
            ++found;
            for (const auto& include : header.includes)
                CHECK_MESSAGE(!is_of_cpu(ours(include.path)), header.at(include.line), include.path,
                              " belongs to the CPU backends");
            for (std::size_t i = 0; i < header.lines.size(); ++i)
                CHECK_MESSAGE(!has_atomic_float(header.lines[i]), header.at(static_cast<int>(i) + 1),
                              "an atomic operation on a floating-point number");
            continue;
        }
        for (const auto& include : header.includes) {
            CHECK_MESSAGE(!is_of_cuda(include.path), header.at(include.line), include.path, " is for nvcc");
            CHECK_MESSAGE(!include.path.starts_with("cuda"), header.at(include.line), include.path,
                          ": gsh::gsh needs no CUDA");
        }
    }
    CHECK(found > 3);
}

TEST_CASE("atomic operations on floating-point numbers are seen in a line") {
    for (const char* line : {"atomicAdd(&sum, T(1));", "atomicAdd(reinterpret_cast<float*>(at), x);",
                             "atomicMax(x, double(y));", "atomicCAS(bits, before, after);",
                             "asm(\"red.global.add.f32 [%0], %1;\"",
                             "asm(\"atom.global.add.noftz.bf16x2 %0, [%1], %2;\""})
        CHECK_MESSAGE(has_atomic_float(line), line);
    for (const char* line : {"atomicAdd(&counts[tile], 1u);", "atomicMax(at, bits);",
                             "asm(\"red.global.add.u32 [%0], %1;\"", "float sum = 0; atomicAdd(&Total, count);"})
        CHECK_MESSAGE(!has_atomic_float(line), line);
}

TEST_CASE("cuda.cuh lists every header of the CUDA backend") {
    const std::set<std::string> listed = listed_by("cuda.cuh");
    for (const auto& header : headers())
        if (is_of_cuda(header.path) && !is_umbrella(header))
            CHECK_MESSAGE(listed.contains(header.path), "include/gsh/cuda.cuh: <gsh/", header.path,
                          "> is missing; run scripts/house");
}

TEST_CASE("gsh.hpp and cpu.hpp list every header that gsh::gsh can serve, and no other") {
    REQUIRE(opt_in_folders().contains("io"));
    std::set<std::string> of_gsh{"cpu.hpp"}, of_cpu{"backend/serial.hpp"};
    for (const auto& header : headers())
        if (!is_umbrella(header) && header.path.ends_with(".hpp") && !opt_in_folders().contains(header.folder()))
            (is_of_cpu(header.path) ? of_cpu : of_gsh).insert(header.path);
    for (const auto& [umbrella, expected] : {std::pair("gsh.hpp", of_gsh), std::pair("cpu.hpp", of_cpu)}) {
        const std::set<std::string> listed = listed_by(umbrella);
        for (const auto& path : listed)
            CHECK_MESSAGE(expected.contains(path), "include/gsh/", umbrella, ": <gsh/", path, "> does not belong there");
        for (const auto& path : expected)
            CHECK_MESSAGE(listed.contains(path), "include/gsh/", umbrella, ": <gsh/", path,
                          "> is missing; run scripts/house");
    }
}

TEST_CASE("every function object that backends run is among those that nvcc compiles") {
    std::ifstream file(fs::path(GSH_SOURCE_DIR) / "tests" / "device" / "kernels_test.cu");
    const std::string kernels{std::istreambuf_iterator<char>(file), {}};
    REQUIRE(kernels.size() > 1000);
    const std::set<std::string> exempt{"NoOp"}; // used by the concept Backend only
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
            const bool there = kernels.find("::" + name + "<") != std::string::npos ||
                               kernels.find("::" + name + ",") != std::string::npos;
            CHECK_MESSAGE(there, header.at(static_cast<int>(i) + 1), name,
                          " is missing in tests/device/kernels_test.cu");
        }
    }
    CHECK(found > 30);
}

TEST_CASE("docs/architecture.md lists every header with its sentence") {
    const std::vector<std::string> all = page();
    const std::set<std::string> lines(all.begin(), all.end());
    REQUIRE(!lines.empty());
    for (const auto& header : headers()) {
        if (is_umbrella(header) || header.lines.size() < 2 || header.lines[1].size() < 11) continue;
        const std::string row = "| `" + header.path + "` | " + header.lines[1].substr(11) + " |";
        CHECK_MESSAGE(lines.contains(row), "docs/architecture.md lacks '", row, "'; run scripts/house");
    }
}

TEST_CASE("the picture of docs/architecture.md shows the tree as it is") {
    std::map<std::string, int> expected_headers, shown_headers;
    std::map<std::pair<std::string, std::string>, int> expected_includes, shown_includes;
    for (const auto& [folder, floor] : floor_of()) expected_headers[folder] = 0;
    for (const auto& header : headers()) {
        if (is_umbrella(header)) continue;
        ++expected_headers[header.folder()];
        std::set<std::string> targets;
        for (const auto& include : header.includes)
            if (const std::string target = ours(include.path); !target.empty())
                targets.insert(target.substr(0, target.find('/')));
        targets.erase(header.folder());
        for (const auto& target : targets) ++expected_includes[{header.folder(), target}];
    }

    const std::regex folder("<g data-folder=\"([a-z]+)\" data-floor=\"([0-9])\" data-headers=\"([0-9]+)\">"),
        includes("<g data-from=\"([a-z]+)\" data-to=\"([a-z]+)\" data-count=\"([0-9]+)\">"),
        named_header("<text class=\"path\".*>([a-z_/]+\\.hpp)</text>");
    const fs::path root = fs::path(GSH_SOURCE_DIR);
    std::size_t named = 0;
    for (const std::string& line : lines_of(root / "docs" / "images" / "architecture.svg")) {
        std::smatch part;
        if (std::regex_match(line, part, folder)) {
            shown_headers[part[1]] = std::stoi(part[3]);
            const auto floor = floor_of().find(part[1].str());
            CHECK_MESSAGE((floor != floor_of().end() && floor->second == std::stoi(part[2])), part[1].str(),
                          " stands on another floor in the picture; run scripts/house");
        } else if (std::regex_match(line, part, includes)) {
            shown_includes[{part[1], part[2]}] = std::stoi(part[3]);
        } else if (std::regex_match(line, part, named_header)) {
            ++named;
            CHECK_MESSAGE(fs::exists(root / "include" / "gsh" / part[1].str()), part[1].str(),
                          " does not exist; correct scripts/draw-architecture");
        }
    }
    CHECK_MESSAGE(shown_headers == expected_headers, "headers per folder differ; run scripts/house");
    CHECK_MESSAGE(shown_includes == expected_includes, "includes between folders differ; run scripts/house");
    CHECK(named == 7); // stages on the way of the means
}
