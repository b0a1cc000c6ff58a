// SPDX-License-Identifier: Apache-2.0
/// @file  Headers contain no assignment that nvcc 13.0 compiles wrongly: object = {.member = value}.
///
/// In a template, if the type of the object depends on a template argument, nvcc drops the designators and assigns the
/// values to the first members, without a message. Other uses of designators, and object = Type{.member = value}, are
/// compiled as they are written.
#include <doctest/doctest.h>

#include <cstddef>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <vector>

namespace {

/// Lines of code in which an assignment, not a declaration, has a list that begins with a designator.
std::vector<std::size_t> untyped_assignments(const std::vector<std::string>& lines) {
    static const std::regex assignment("^\\s*[^\\s,(){}]+(\\[[^\\]]*\\][^\\s,{}]*)? = \\{\\s*(\\..*)?$"),
        designator("^\\s*\\.[a-z].*");
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < lines.size(); ++i) {
        std::smatch parts;
        if (!std::regex_match(lines[i], parts, assignment) || std::regex_match(lines[i], designator)) continue;
        if (parts[2].matched || (i + 1 < lines.size() && std::regex_match(lines[i + 1], designator)))
            found.push_back(i + 1);
    }
    return found;
}

} // namespace

TEST_CASE("no header assigns a list with designators without its type") {
    CHECK(untyped_assignments({"    x.other = {.a = 1};", "y[2 * (i + 1)].z = {", "    .b = 2};"}).size() == 2);
    CHECK(untyped_assignments({"    T x = {.a = 1};", "x = T{.a = 1};", "f({.a = 1});", "    .terms = {.pull = 1},"})
              .empty());
    std::size_t files = 0;
    for (const char* folder : {"include/gsh", "programs"})
        for (const auto& entry :
             std::filesystem::recursive_directory_iterator(std::filesystem::path(GSH_SOURCE_DIR) / folder)) {
            const auto extension = entry.path().extension();
            if (extension != ".hpp" && extension != ".cuh") continue;
            ++files;
            std::vector<std::string> lines;
            std::ifstream file(entry.path());
            for (std::string line; std::getline(file, line);) lines.push_back(line);
            for (const std::size_t line : untyped_assignments(lines))
                CHECK_MESSAGE(false, entry.path().string(), ":", line, ": write object = Type{.member = value}");
        }
    CHECK(files > 100);
}
