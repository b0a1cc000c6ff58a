// SPDX-License-Identifier: Apache-2.0
/// @file  Each header has a test: the one at its path, or those that the table of docs/testing.md names.
#include "house/source_lines.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <utility>
#include <vector>

using namespace gsh::test;

namespace {

/// What the check reads: files by their paths in the repository with the names that they include, and the table.
struct MirroredTree {
    std::map<std::string, std::vector<std::string>> includes_of_file;
    std::vector<std::string> page; ///< lines of docs/testing.md

    bool has(const std::string& path) const { return includes_of_file.contains(path); }

    /// The files that a file includes, directly or not, and itself. A name is looked for in include/, beside the
    /// includer and in tests/.
    std::set<std::string> reached_from(const std::string& path) const {
        std::set<std::string> reached{path};
        std::vector<std::string> open{path};
        while (!open.empty()) {
            const std::string file = open.back();
            open.pop_back();
            for (const std::string& name : includes_of_file.at(file))
                for (const std::string& folder :
                     {std::string("include/"), file.substr(0, file.rfind('/') + 1), std::string("tests/")})
                    if (has(folder + name) && reached.insert(folder + name).second) open.push_back(folder + name);
        }
        return reached;
    }

    /// The headers of include/gsh, as "math/sh.hpp". The umbrellas are lists, which floor_plan_test.cpp checks.
    std::vector<std::string> headers() const {
        const std::string root = "include/gsh/";
        std::vector<std::string> found;
        for (const auto& [path, includes] : includes_of_file)
            if (path.starts_with(root) && path.find('/', root.size()) != std::string::npos)
                found.push_back(path.substr(root.size()));
        return found;
    }

    /// Tests at the path of a header: "math/sh_test.cpp", "render/cuda/bin_test.cu".
    std::vector<std::string> mirrored(const std::string& header) const {
        std::vector<std::string> found;
        for (const char* end : {"_test.cpp", "_test.cu"})
            if (const std::string test = header.substr(0, header.rfind('.')) + end; has("tests/" + test))
                found.push_back(test);
        return found;
    }

    /// The names in each row of the page's table: headers, tests.
    std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> rows() const {
        static const std::regex row("\\| (`[^|]*`) \\| (`[^|]*_test\\.(?:cpp|cu)`) \\|"), name("`([^`]*)`");
        const auto names = [&](const std::string& cell) {
            std::vector<std::string> found;
            for (std::sregex_iterator it(cell.begin(), cell.end(), name), end; it != end; ++it)
                found.push_back((*it)[1]);
            return found;
        };
        std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> found;
        for (const std::string& line : page)
            if (std::smatch cells; std::regex_match(line, cells, row))
                found.emplace_back(names(cells[1]), names(cells[2]));
        return found;
    }

    /// What is wrong, one sentence each.
    std::vector<std::string> faults() const;
};

std::vector<std::string> MirroredTree::faults() const {
    std::vector<std::string> found;
    std::set<std::string> covered, without_test;
    for (const std::string& header : headers()) {
        const std::vector<std::string> tests = mirrored(header);
        if (tests.empty()) without_test.insert(header);
        for (const std::string& test : tests)
            if (!reached_from("tests/" + test).contains("include/gsh/" + header))
                found.push_back("tests/" + test + " does not include " + header);
    }
    for (const auto& [names, tests] : rows()) {
        std::set<std::string> row;
        for (const std::string& name : names) {
            if (!name.ends_with('*')) {
                if (!has("include/gsh/" + name))
                    found.push_back(name + " does not exist");
                else if (!without_test.contains(name))
                    found.push_back(name + " has a test at its path; remove it from the table");
                else if (!row.insert(name).second)
                    found.push_back(name + " is in two rows");
                continue;
            }
            const std::string begin = name.substr(0, name.size() - 1), folder = begin.substr(0, begin.rfind('/') + 1);
            std::size_t matches = 0;
            for (const std::string& header : without_test)
                if (header.starts_with(begin) && header.rfind('/') + 1 == folder.size()) {
                    ++matches;
                    row.insert(header);
                }
            if (!folder.ends_with("/cpu/") && !folder.ends_with("/cuda/"))
                found.push_back(name + " is no folder cpu or cuda; name each header");
            if (matches == 0) found.push_back(name + " stands for no header that has no test at its path");
        }
        for (const std::string& header : row)
            if (!covered.insert(header).second) found.push_back(header + " is in two rows");
        for (const std::string& test : tests) {
            if (!has("tests/" + test)) {
                found.push_back("tests/" + test + " does not exist");
                continue;
            }
            const std::set<std::string> reached = reached_from("tests/" + test);
            for (const std::string& header : row)
                if (!reached.contains("include/gsh/" + header))
                    found.push_back("tests/" + test + " does not include " + header);
        }
    }
    for (const std::string& header : without_test)
        if (!covered.contains(header))
            found.push_back(header + " has no test at its path, and docs/testing.md names none");
    return found;
}

} // namespace

TEST_CASE("each header has a test at its path or in the table of docs/testing.md") {
    const std::filesystem::path root = GSH_SOURCE_DIR;
    MirroredTree tree{{}, lines_of(root / "docs" / "testing.md")};
    for (const char* folder : {"include/gsh", "tests"})
        for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
            const auto extension = entry.path().extension();
            if (extension != ".hpp" && extension != ".cuh" && extension != ".cpp" && extension != ".cu") continue;
            std::vector<std::string>& names =
                tree.includes_of_file[std::filesystem::relative(entry.path(), root).generic_string()];
            for (const Include& include : includes_of(lines_of(entry.path()))) names.push_back(include.path);
        }
    CHECK(tree.headers().size() > 400);
    CHECK(tree.rows().size() > 50);
    for (const std::string& fault : tree.faults()) CHECK_MESSAGE(false, fault);
}

TEST_CASE("the check of the table finds each fault") {
    const MirroredTree sound{{{"include/gsh/a/b.hpp", {}},
                              {"include/gsh/a/c.hpp", {"gsh/a/b.hpp"}},
                              {"include/gsh/a/cpu/d.hpp", {"gsh/a/c.hpp"}},
                              {"include/gsh/gsh.hpp", {}},
                              {"tests/a/near.hpp", {"gsh/a/cpu/d.hpp"}},
                              {"tests/a/b_test.cpp", {"gsh/a/b.hpp"}},
                              {"tests/a/other_test.cpp", {"near.hpp"}}},
                             {"| `a/c.hpp` | `a/other_test.cpp` |", "| `a/cpu/*` | `a/other_test.cpp` |"}};
    CHECK(sound.faults().empty());
    const auto faults_with = [&](const std::string& row) {
        MirroredTree tree = sound;
        tree.page.push_back(row);
        return tree.faults();
    };
    using Faults = std::vector<std::string>;
    CHECK(faults_with("| `a/e.hpp` | `a/other_test.cpp` |") == Faults{"a/e.hpp does not exist"});
    CHECK(faults_with("| `a/b.hpp` | `a/other_test.cpp` |") ==
          Faults{"a/b.hpp has a test at its path; remove it from the table"});
    CHECK(faults_with("| `a/c.hpp` | `a/other_test.cpp` |") == Faults{"a/c.hpp is in two rows"});
    CHECK(faults_with("| `b/cpu/*` | `a/other_test.cpp` |") ==
          Faults{"b/cpu/* stands for no header that has no test at its path"});

    MirroredTree tree = sound;
    tree.page[0] = "| `a/c.hpp` | `a/b_test.cpp`, `a/no_test.cpp` |";
    CHECK(tree.faults() == Faults{"tests/a/b_test.cpp does not include a/c.hpp", "tests/a/no_test.cpp does not exist"});
    tree = sound;
    tree.page.pop_back();
    CHECK(tree.faults() == Faults{"a/cpu/d.hpp has no test at its path, and docs/testing.md names none"});
    tree.page[0] = "| `a/c*`, `a/cpu/d.hpp` | `a/other_test.cpp` |";
    CHECK(tree.faults() == Faults{"a/c* is no folder cpu or cuda; name each header"});
    tree = sound;
    tree.includes_of_file["tests/a/b_test.cpp"].clear();
    CHECK(tree.faults() == Faults{"tests/a/b_test.cpp does not include a/b.hpp"});
}
