// SPDX-License-Identifier: Apache-2.0
/// @file  Every doubt of gsh-check and of the verdict has an answer in docs/README.md.
#include <doctest/doctest.h>

#include "common/help.hpp"
#include "support/contains.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>

#include <filesystem>
#include <regex>
#include <set>
#include <string>
#include <string_view>

using namespace gsh;
using namespace gsh::programs;
namespace fs = std::filesystem;

namespace {

const fs::path help_root = GSH_SOURCE_DIR;

/// All names of the kind "mirrored-images" in a source file.
std::set<std::string> hyphenated_names(const fs::path& path) {
    static const std::regex name("\"([a-z]+(?:-[a-z]+)+)\"");
    const std::string text = read_file(path);
    std::set<std::string> names;
    for (std::sregex_iterator it(text.begin(), text.end(), name), end; it != end; ++it) names.insert((*it)[1].str());
    return names;
}

} // namespace

TEST_CASE("each heading that a doubt names is in docs/README.md") {
    const std::string page = read_file(help_root / "docs/README.md");
    for (const Answer& answer : answers()) {
        CAPTURE(answer.heading);
        CHECK(page == test::contains("\n### " + std::string(answer.heading) + "\n"));
        CHECK(!answer.doubts.empty());
    }
}

TEST_CASE("the doubts with an answer are those that the check and the verdict have") {
    std::set<std::string> doubts;
    std::string sources = read_file(help_root / "programs/reconstruct/verdict.cpp");
    for (const std::string& name : hyphenated_names(help_root / "programs/reconstruct/verdict.cpp"))
        doubts.insert(name);
    for (const auto& entry : fs::directory_iterator(help_root / "include/gsh/check")) {
        doubts.merge(hyphenated_names(entry.path()));
        sources += read_file(entry.path());
    }
    CHECK(doubts.size() > 30);
    for (const std::string& doubt : doubts) CHECK_NOTHROW((void)help_link(doubt));
    std::set<std::string_view> answered;
    for (const Answer& answer : answers())
        for (const std::string_view doubt : answer.doubts) {
            CAPTURE(doubt);
            CHECK(sources == test::contains("\"" + std::string(doubt) + "\""));
            CHECK(answered.insert(doubt).second); // one heading each
        }
}

TEST_CASE("help names a heading once, in words and as a link") {
    CHECK(help_text({"weak-hands"}) == "docs/README.md, \"My hands are blurred\"");
    CHECK(help_text({"degrees", "weak-hands", "no-overlap"}) ==
          "docs/README.md, \"The body is nowhere near the person\", \"My hands are blurred\"");
    CHECK(help_link("weak-hands") == "docs/README.md#my-hands-are-blurred");
    CHECK(help_link("focal-length") == "docs/README.md#the-body-is-shifted-too-large-or-too-small");
    CHECK_THROWS_AS((void)help_link("no such doubt"), ValueError);
}
