// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/disk_sync.hpp>

#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <cerrno>
#include <string>

using namespace gsh;

TEST_CASE("files and folders are synced, and what is not there is an error by name") {
    const test::Temporary folder;
    write_file(folder / "a", "text", Sync::none);
    CHECK_NOTHROW(sync_to_disk(folder / "a"));
    CHECK_NOTHROW(sync_to_disk(folder / ""));
    CHECK(read_file(folder / "a") == "text");
    test::check_throws<IoError>([&] { sync_to_disk(folder / "none"); }, {"/none: cannot be synced", "No such file"});
}

TEST_CASE("the folder of a name") {
    CHECK(folder_of("a/b/c.txt") == "a/b");
    CHECK(folder_of("c.txt") == ".");
}

TEST_CASE("an interrupted call is called again, another error is returned") {
    int calls = 0;
    const auto interrupted_twice = [&] { return errno = EINTR, ++calls < 3 ? -1 : 7; };
    CHECK(detail::open_again(interrupted_twice) == 7);
    CHECK(calls == 3);
    CHECK(detail::open_again([] { return errno = EACCES, -1; }) == -1);
    CHECK(errno == EACCES);
    CHECK(detail::sync_descriptor(-1) == EBADF);
    CHECK(!detail::empty_file(-1));
}
