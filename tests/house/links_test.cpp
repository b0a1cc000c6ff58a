// SPDX-License-Identifier: Apache-2.0
/// @file  Checks that links in the pages lead to files that exist, and to headings that exist in them.

#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace fs = std::filesystem;

namespace {

const fs::path links_root = fs::path(GSH_SOURCE_DIR);

/// The page without code: in it, brackets are no links and # is no heading.
std::string prose_of(const fs::path& path) {
    std::ifstream file(path);
    std::string prose;
    bool fenced = false;
    for (std::string line; std::getline(file, line);) {
        if (line.find("```") != std::string::npos) {
            fenced = !fenced;
            continue;
        }
        if (!fenced && !line.starts_with("    ")) prose += line + "\n";
    }
    return prose;
}

/// The name that GitHub gives to a heading: in lower case, without punctuation, with hyphens for spaces.
std::string anchor_of(const std::string& heading) {
    static const std::regex link("\\[([^\\]]*)\\]\\([^)]*\\)");
    std::string anchor;
    for (const char c : std::regex_replace(heading, link, "$1"))
        if (c == ' ')
            anchor += '-';
        else if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_')
            anchor += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return anchor;
}

/// The places in a page that a link can name: its headings, of which equal ones are numbered, and <a id="…">.
std::set<std::string> anchors_of(const fs::path& path) {
    static const std::regex heading("(?:^|\n)#+ ([^\n]*)"), id("<a id=\"([^\"]*)\">");
    const std::string prose = prose_of(path);
    std::set<std::string> anchors;
    std::map<std::string, int> seen;
    for (std::sregex_iterator it(prose.begin(), prose.end(), heading), end; it != end; ++it) {
        const std::string anchor = anchor_of((*it)[1].str());
        const int before = seen[anchor]++;
        anchors.insert(before == 0 ? anchor : anchor + "-" + std::to_string(before));
    }
    for (std::sregex_iterator it(prose.begin(), prose.end(), id), end; it != end; ++it) anchors.insert((*it)[1].str());
    return anchors;
}

/// The targets of all links and pictures of a page that are no web addresses.
std::vector<std::string> links_of(const fs::path& path) {
    static const std::regex code("`[^`]*`"), link("\\]\\(([^)\\s]*)\\)");
    const std::string prose = std::regex_replace(prose_of(path), code, "");
    std::vector<std::string> links;
    for (std::sregex_iterator it(prose.begin(), prose.end(), link), end; it != end; ++it)
        if (const std::string target = (*it)[1].str(); target.find("://") == std::string::npos) links.push_back(target);
    return links;
}

std::vector<fs::path> pages_with_links() {
    std::vector<fs::path> found;
    for (const char* name : {"README.md", "SECURITY.md", "examples/README.md", "findings/README.md"})
        found.push_back(links_root / name);
    for (const auto& entry : fs::recursive_directory_iterator(links_root / "docs"))
        if (entry.path().extension() == ".md") found.push_back(entry.path());
    return found;
}

} // namespace

TEST_CASE("anchors are those of GitHub") {
    CHECK(anchor_of("The body's file") == "the-bodys-file");
    CHECK(anchor_of("A step, `mixed` and fp32") == "a-step-mixed-and-fp32");
    CHECK(anchor_of("In [Blender](https://www.blender.org)") == "in-blender");
    CHECK(anchor_of("K_b - a name") == "k_b---a-name");
}

TEST_CASE("links in the pages lead to files and headings that exist") {
    std::map<fs::path, std::set<std::string>> anchors;
    std::size_t count = 0;
    for (const fs::path& from : pages_with_links()) {
        CAPTURE(from.lexically_relative(links_root).string());
        for (const std::string& link : links_of(from)) {
            CAPTURE(link);
            ++count;
            const std::size_t hash = link.find('#');
            const std::string file = link.substr(0, hash);
            const fs::path target = file.empty() ? from : (from.parent_path() / file).lexically_normal();
            CHECK(fs::exists(target));
            if (hash == std::string::npos || target.extension() != ".md" || !fs::exists(target)) continue;
            if (!anchors.contains(target)) anchors[target] = anchors_of(target);
            CHECK(anchors[target].contains(link.substr(hash + 1)));
        }
    }
    CHECK(count > 400);
}

TEST_CASE("the index of docs/ leads to every page beside it") {
    const std::string index = prose_of(links_root / "docs" / "README.md");
    for (const auto& entry : fs::directory_iterator(links_root / "docs")) {
        const std::string name = entry.path().filename().string();
        if (!name.ends_with(".md") || name == "README.md") continue;
        CAPTURE(name);
        CHECK(index == gsh::test::contains("](" + name));
    }
}
