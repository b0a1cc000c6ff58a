// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/atomic_folder.hpp>

#include "io/other_process.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <unistd.h>

#include <string>

using namespace gsh;
namespace fs = std::filesystem;

namespace {
bool is_frame(const std::string& name) {
    return name.starts_with("frame_");
}
} // namespace

TEST_CASE("a folder appears with all of its files, and replaces an older one") {
    const test::Temporary place;
    for (int run = 0; run < 2; ++run) {
        AtomicFolder folder((place / "walk/").string(), is_frame);
        for (int i = run; i < 3; ++i) write_file(folder.file("frame_" + std::to_string(i)), std::to_string(run));
        CHECK(fs::exists(place / "walk") == (run == 1));
        folder.commit();
        CHECK(read_file(place / "walk/frame_2") == std::to_string(run));
    }
    CHECK(!fs::exists(place / "walk/frame_0")); // of the first run
    CHECK(!fs::exists(place / "walk.partial"));
    CHECK(!fs::exists(place / "walk.old"));
}

TEST_CASE("of two processes the second is refused, and nothing of the first is removed") {
    const test::Temporary place;
    {
        const test::OtherProcess other([&](const auto& wait) {
            const AtomicFolder folder(place / "walk", is_frame);
            write_file(folder.file("frame_0"), "of the other");
            wait();
        });
        test::check_throws<IoError>([&] { const AtomicFolder folder(place / "walk", is_frame); },
                                    {"walk: process " + std::to_string(other.id())});
        CHECK(read_file(place / "walk.partial/frame_0") == "of the other");
    }
    {
        AtomicFolder folder(place / "walk", is_frame);
        write_file(folder.file("frame_1"), "own");
        folder.commit();
    }
    CHECK(!fs::exists(place / "walk/frame_0"));
    CHECK(read_file(place / "walk/frame_1") == "own");
    CHECK(!fs::exists(place / "walk.lock"));
}

TEST_CASE("a symbolic link to a folder is kept, and the folder is replaced") {
    const test::Temporary place;
    fs::create_directories(place / "real");
    write_file(place / "real/frame_0", "old");
    fs::create_directory_symlink("real", place / "walk");
    {
        AtomicFolder folder(place / "walk", is_frame);
        write_file(folder.file("frame_1"), "new");
        folder.commit();
    }
    CHECK(fs::is_symlink(place / "walk"));
    CHECK(!fs::exists(place / "real/frame_0"));
    CHECK(read_file(place / "real/frame_1") == "new");
}

TEST_CASE("without a commit nothing changes") {
    const test::Temporary place;
    fs::create_directory(place / "walk");
    write_file(place / "walk/frame_0", "old");
    {
        const AtomicFolder folder(place / "walk", is_frame);
        write_file(folder.file("frame_0"), "new");
    }
    CHECK(read_file(place / "walk/frame_0") == "old");
    CHECK(!fs::exists(place / "walk.partial"));
    {
        const AtomicFolder folder(place / "new", is_frame);
    }
    CHECK(!fs::exists(place / "new"));
    CHECK(!fs::exists(place / "new.partial"));
}

TEST_CASE("other files are not replaced") {
    const test::Temporary place;
    fs::create_directory(place / "walk");
    write_file(place / "walk/notes.txt", "mine");
    test::check_throws<IoError>([&] { const AtomicFolder folder(place / "walk", is_frame); }, {"walk", "notes.txt"});
    CHECK(!fs::exists(place / "walk.partial"));
    write_file(place / "file", "");
    test::check_throws<IoError>([&] { const AtomicFolder folder(place / "file", is_frame); }, {"file is in the way"});
    test::check_throws<IoError>([&] { const AtomicFolder folder(place / "file/sub", is_frame); },
                                {"cannot be created"});
}

TEST_CASE("a user's folders called NAME.partial and NAME.old are not removed; what a killed run left is") {
    const test::Temporary place;
    for (const std::string ending : {".partial", ".old"}) {
        fs::create_directory(place / ("walk" + ending));
        write_file(place / ("walk" + ending + "/notes.txt"), "mine");
        test::check_throws<IoError>([&] { const AtomicFolder folder(place / "walk", is_frame); },
                                    {"walk" + ending, "notes.txt"});
        CHECK(read_file(place / ("walk" + ending + "/notes.txt")) == "mine");
        fs::rename(place / ("walk" + ending + "/notes.txt"), place / ("walk" + ending + "/frame_9.ply.partial"));
    }
    {
        AtomicFolder folder(place / "walk", is_frame);
        write_file(folder.file("frame_0"), "new");
        fs::create_directory(place / "walk.old");
        write_file(place / "walk.old/notes.txt", "mine");
        test::check_throws<IoError>([&] { folder.commit(); }, {"walk.old", "notes.txt"});
    }
    CHECK(read_file(place / "walk.old/notes.txt") == "mine");
    CHECK(!fs::exists(place / "walk"));
    CHECK(!fs::exists(place / "walk.partial"));
}

TEST_CASE("a folder that cannot be listed is refused") {
    if (geteuid() == 0) return; // root may list every folder
    const test::Temporary place;
    fs::create_directory(place / "walk");
    fs::permissions(place / "walk", fs::perms::owner_write | fs::perms::owner_exec);
    test::check_throws<IoError>([&] { const AtomicFolder folder(place / "walk", is_frame); },
                                {"walk", "cannot be listed"});
    fs::permissions(place / "walk", fs::perms::owner_all);
}
