// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/full_path.hpp>

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <filesystem>

using namespace gsh;
namespace fs = std::filesystem;

TEST_CASE("a full path has neither dots nor links, and may lead to what does not exist") {
    const test::Temporary folder;
    const fs::path root = fs::canonical(folder / "");
    fs::create_directory(root / "a");
    fs::create_directory_symlink(root / "a", root / "link");
    CHECK(full_path(root / "link/../a/./b") == root / "a/b");
    CHECK(full_path(root / "link/new/c") == root / "a/new/c");
    CHECK(full_path("a") == fs::current_path() / "a");
    fs::create_symlink("round", root / "round");
    test::check_throws<IoError>([&] { (void)full_path(root / "round/a"); }, {"round/a: cannot be followed"});
}

TEST_CASE("links at the end of a path are followed, also to what does not exist") {
    const test::Temporary folder;
    const fs::path root = fs::canonical(folder / "");
    fs::create_directory(root / "a");
    fs::create_symlink("a/none", root / "first");
    fs::create_symlink(root / "first", root / "second");
    CHECK(followed(root / "second") == root / "a/none");
    CHECK(followed(root / "none") == root / "none");
    CHECK(followed("none") == "none");
    fs::create_symlink("round", root / "round");
    test::check_throws<IoError>([&] { (void)followed(root / "round"); }, {"round: cannot be followed"});
}
