// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/folder_entries.hpp>

#include "io/temporary.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

using namespace gsh;
namespace fs = std::filesystem;

TEST_CASE("each name in a folder comes once, hidden ones too") {
    const test::Temporary folder;
    for (const char* name : {"a", ".hidden", "b.txt"}) write_file(folder / name, "x", Sync::none);
    fs::create_directory(folder / "c");
    std::multiset<std::string> names;
    CHECK(detail::for_each_name(folder / "", [&](std::string_view name) { names.emplace(name); }) == 0);
    CHECK(names == std::multiset<std::string>{".hidden", "a", "b.txt", "c"});
    CHECK(detail::for_each_name(folder / "c", [](std::string_view) { FAIL_CHECK("is empty"); }) == 0);
    CHECK(detail::for_each_name(folder / "none", [](std::string_view) {}) == ENOENT);
    CHECK(detail::for_each_name(folder / "a", [](std::string_view) {}) == ENOTDIR);
    CHECK_THROWS_AS((void)detail::for_each_name(folder / "", [](std::string_view) { throw std::runtime_error(""); }),
                    std::runtime_error);
}

TEST_CASE("a folder is removed with all that is in it, and nothing that it links to") {
    const test::Temporary folder;
    fs::create_directories(folder / "tree/a/b");
    fs::create_directories(folder / "kept");
    for (const char* name : {"tree/x", "tree/a/y", "tree/a/b/z", "kept/file"})
        write_file(folder / name, "x", Sync::none);
    fs::create_directory_symlink(folder / "kept", folder / "tree/a/link");
    fs::create_symlink(folder / "kept/file", folder / "tree/file");
    detail::remove_tree(folder / "tree");
    CHECK(!fs::exists(folder / "tree"));
    CHECK(fs::exists(folder / "kept/file"));
    fs::create_directory_symlink(folder / "kept", folder / "link");
    detail::remove_tree(folder / "link");
    CHECK(!fs::is_symlink(folder / "link"));
    CHECK(fs::exists(folder / "kept/file"));
    detail::remove_tree(folder / "none");
}

TEST_CASE("a folder is removed where one more file may be opened") {
    const test::Temporary folder;
    fs::create_directories(folder / "tree/a/b/c");
    fs::create_directories(folder / "tree/d");
    fs::create_directories(folder / "kept");
    for (const char* name : {"tree/x", "tree/a/y", "tree/a/b/c/z", "tree/d/u", "kept/file"})
        write_file(folder / name, "x", Sync::none);
    fs::create_directory_symlink(folder / "kept", folder / "tree/a/link");
    const int next = ::dup(STDIN_FILENO); // the least number that is free
    REQUIRE(next > 0);
    ::close(next);
    rlimit before{};
    REQUIRE(::getrlimit(RLIMIT_NOFILE, &before) == 0);
    const rlimit limit{static_cast<rlim_t>(next) + 1, before.rlim_max};
    REQUIRE(::setrlimit(RLIMIT_NOFILE, &limit) == 0);
    detail::remove_tree(folder / "tree");
    REQUIRE(::setrlimit(RLIMIT_NOFILE, &before) == 0);
    CHECK(!fs::exists(folder / "tree"));
    CHECK(fs::exists(folder / "kept/file"));
}
