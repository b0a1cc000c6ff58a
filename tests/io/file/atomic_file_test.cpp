// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/atomic_file.hpp>

#include "io/file_size_limit.hpp"
#include "io/other_process.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <vector>

using namespace gsh;

TEST_CASE("a file appears on commit and not before") {
    const test::Temporary folder;
    const auto path = folder / "a.txt";
    {
        AtomicFile file(path);
        file.write("hello ");
        file.write("world");
        CHECK(file.size() == 11);
        CHECK(!std::filesystem::exists(path));
        file.commit();
    }
    CHECK(read_file(path) == "hello world");
    CHECK(folder.file_count() == 1);
}

TEST_CASE("the file that is replaced is kept where the commit says") {
    const test::Temporary folder;
    for (const char* text : {"first", "second", "third"}) {
        AtomicFile file(folder / "a");
        file.write(text);
        file.commit(Sync::disk, folder / "a.before");
    }
    CHECK(read_file(folder / "a") == "third");
    CHECK(read_file(folder / "a.before") == "second");
    CHECK(folder.file_count() == 2);
    AtomicFile file(folder / "new");
    file.commit(Sync::disk, folder / "new.before");
    CHECK(!std::filesystem::exists(folder / "new.before")); // nothing was replaced
}

TEST_CASE("an abandoned write leaves the old file and nothing else") {
    const test::Temporary folder;
    const auto path = folder / "a.txt";
    write_file(path, "old");
    {
        AtomicFile file(path);
        file.write("new");
    }
    CHECK(read_file(path) == "old");
    CHECK(folder.file_count() == 1);
}

TEST_CASE("of two writers of one file the second is refused, and what a killed one left is written over") {
    const test::Temporary folder;
    const auto path = folder / "a.txt";
    {
        const test::OtherProcess other([&](const auto& wait) {
            AtomicFile file(path);
            const std::string much(100'000, 'x');
            file.write(much.data(), much.size());
            wait();
        });
        test::check_throws<IoError>([&] { AtomicFile file(path); }, {path.string(), "another process is writing"});
        CHECK(std::filesystem::file_size(path.string() + ".partial") == 100'000);
        CHECK(!std::filesystem::exists(path));
    }
    write_file(path, "whole");
    CHECK(read_file(path) == "whole");
    CHECK(folder.file_count() == 1);
    AtomicFile first(path);
    test::check_throws<IoError>([&] { write_file(path, "second"); }, {"another process"});
    first.write("first");
    first.commit();
    CHECK(read_file(path) == "first");
}

TEST_CASE("large and small writes arrive in order") {
    const test::Temporary folder;
    std::string expected;
    AtomicFile file(folder / "a");
    for (std::size_t i = 0; i < 40; ++i) {
        const std::string block(i * i * 97, static_cast<char>('a' + i % 26));
        file.write(block);
        expected += block;
    }
    file.commit();
    CHECK(read_file(folder / "a") == expected);
}

TEST_CASE("a disk that fills up names the file and leaves no partial output") {
    const test::Temporary folder;
    const auto path = folder / "big";
    write_file(path, "old");
    const std::vector<char> block(300000, 'x');
    {
        const test::FileSizeLimit limit(100000);
        test::check_throws<IoError>([&] { AtomicFile(path).write(block.data(), block.size()); },
                                    {path.string(), "too large"});
        test::check_throws<IoError>(
            [&] {
                AtomicFile file(path);
                for (int i = 0; i < 3000; ++i) file.write(block.data(), 100);
                file.commit();
            },
            {path.string()});
    }
    CHECK(read_file(path) == "old");
    CHECK(folder.file_count() == 1);
}

TEST_CASE("a full device is reported, and a device is never replaced") {
    if (!std::filesystem::exists("/dev/full")) return;
    test::check_throws<IoError>([] { write_file("/dev/full", "text"); }, {"/dev/full", "No space left"});
    CHECK(std::filesystem::is_character_file("/dev/full"));
}

TEST_CASE("a symbolic link keeps pointing where it did") {
    const test::Temporary folder;
    write_file(folder / "real", "old");
    std::filesystem::create_symlink("real", folder / "link");
    write_file(folder / "link", "new");
    CHECK(std::filesystem::is_symlink(folder / "link"));
    CHECK(read_file(folder / "real") == "new");
    std::filesystem::create_symlink("later", folder / "early"); // to a file that is not there yet
    write_file(folder / "early", "new");
    CHECK(std::filesystem::is_symlink(folder / "early"));
    CHECK(read_file(folder / "later") == "new");
    std::filesystem::create_symlink("round", folder / "round");
    test::check_throws<IoError>([&] { write_file(folder / "round", "x"); }, {"round: cannot be followed"});
}

TEST_CASE("paths that cannot be written or read") {
    const test::Temporary folder;
    test::check_throws<IoError>([&] { write_file(folder / "none/a", ""); }, {"none/a", "No such file"});
    test::check_throws<IoError>([&] { write_file(folder / "", ""); }, {"directory"});
    test::check_throws<IoError>([&] { (void)read_file(folder / "b"); }, {"/b", "No such file"});
    test::check_throws<IoError>([&] { (void)read_file(folder / ""); }, {"directory"});
    write_file(folder / "c", "12345");
    CHECK(read_file(folder / "c", 5) == "12345");
    test::check_throws<IoError>([&] { (void)read_file(folder / "c", 4); }, {"/c", "larger than 4"});
}
