// SPDX-License-Identifier: Apache-2.0
/// @file  Locks of folders: the second process is refused, and a killed one blocks nobody.

#include "io/other_process.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/folder_lock.hpp>
#include <gsh/io/file/input_file.hpp>

#include <string>

using namespace gsh;
namespace fs = std::filesystem;

TEST_CASE("a folder is created, locked, and removed if nothing is in it") {
    const test::Temporary place;
    {
        const LockedFolder folder(place / "a/b/c");
        CHECK(fs::exists(place / "a/b/c/.gsh-lock"));
        CHECK(read_file(place / "a/b/c/.gsh-lock").starts_with("process " + std::to_string(::getpid())));
    }
    CHECK(!fs::exists(place / "a"));
    {
        const LockedFolder folder(place / "a/b");
        write_file(place / "a/b/result", "x");
    }
    CHECK(read_file(place / "a/b/result") == "x");
    CHECK(!fs::exists(place / "a/b/.gsh-lock"));
    {
        const LockedFolder folder(place / "a/b/"); // there already
    }
    CHECK(fs::exists(place / "a/b/result"));
    write_file(place / "file", "");
    test::check_throws<IoError>([&] { const LockedFolder folder(place / "file"); }, {"file: cannot be created"});
    test::check_throws<IoError>([&] { const LockedFolder folder(place / "file/sub"); },
                                {"file/sub: cannot be created"});
}

TEST_CASE("a folder that cannot be locked is not left behind") {
    const test::Temporary place;
    fs::create_directories(place / "a/.gsh-lock"); // a folder in the place of the lock
    test::check_throws<IoError>([&] { const LockedFolder folder(place / "a"); }, {"a: .gsh-lock cannot be created"});
    CHECK(fs::exists(place / "a/.gsh-lock"));
    test::check_throws<IoError>([&] { const CreatedFolders folders(place / ("b/c/" + std::string(300, 'x'))); },
                                {"cannot be created", "too long"});
    CHECK(!fs::exists(place / "b"));
}

TEST_CASE("the second process is refused and names the first, until that ends, however it ends") {
    const test::Temporary place;
    {
        const test::OtherProcess other([&](const auto& wait) {
            const LockedFolder folder(place / "out");
            write_file(place / "out/partial result", "of the other");
            wait();
        });
        test::check_throws<IoError>(
            [&] { const LockedFolder folder(place / "out"); },
            {(place / "out").string() + ": process " + std::to_string(other.id()), "writing there"});
        CHECK(read_file(place / "out/partial result") == "of the other");
        CHECK(fs::exists(place / "out/.gsh-lock"));
    }
    CHECK(fs::exists(place / "out/.gsh-lock")); // left by the killed process
    {
        const LockedFolder folder(place / "out");
        CHECK(read_file(place / "out/.gsh-lock").starts_with("process " + std::to_string(::getpid()) + " "));
    }
    CHECK(!fs::exists(place / "out/.gsh-lock"));
}

TEST_CASE("a lock's file that the process before removes is created anew") {
    const test::Temporary place;
    for (int k = 0; k < 3; ++k) {
        const FileLock lock(place / "lock", "x");
        test::check_throws<IoError>([&] { const FileLock second(place / "lock", "y"); }, {"y: process"});
    }
    test::check_throws<IoError>([&] { const FileLock lock(place / "none/lock", "z"); }, {"z: lock cannot be created"});
}
