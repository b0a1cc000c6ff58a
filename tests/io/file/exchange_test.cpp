// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/exchange.hpp>

#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// New files a, b and c beside a folder that has an a and a b of its own.
struct NewFiles {
    test::Temporary place;

    NewFiles() {
        for (const char* folder : {"new", "old"}) fs::create_directory(place / folder);
        for (const char* name : {"a", "b", "c"}) write_file(place / "new" / fs::path(name), std::string("new ") + name);
        for (const char* name : {"a", "b"}) write_file(place / "old" / fs::path(name), std::string("old ") + name);
    }
    [[nodiscard]] std::vector<FileMove> moves(std::initializer_list<const char*> names) const {
        std::vector<FileMove> all;
        for (const char* name : names) all.push_back({place / "new" / fs::path(name), place / "old" / fs::path(name)});
        return all;
    }
    [[nodiscard]] std::string in_place(const char* name) const { return read_file(place / "old" / fs::path(name)); }
};

} // namespace

TEST_CASE("files take the places of others") {
    const NewFiles files;
    move_all(files.moves({"a", "c"}));
    CHECK(files.in_place("a") == "new a");
    CHECK(files.in_place("b") == "old b");
    CHECK(files.in_place("c") == "new c");
    CHECK(!fs::exists(files.place / "new/c"));
    CHECK_NOTHROW(move_all({}));
}

TEST_CASE("if one file cannot be moved, none is, and the replaced ones are back") {
    const NewFiles files;
    std::vector<FileMove> moves = files.moves({"a", "c", "b"});
    fs::create_directory(files.place / "old/taken");
    moves.back().to = files.place / "old/taken"; // a folder is in the way
    test::check_throws<IoError>([&] { move_all(moves); }, {"old/taken: cannot be written"});
    CHECK(files.in_place("a") == "old a");
    CHECK(files.in_place("b") == "old b");
    CHECK(!fs::exists(files.place / "old/c"));
    CHECK(read_file(files.place / "new/a") == "new a");
    CHECK(read_file(files.place / "new/c") == "new c");
    CHECK(fs::is_directory(files.place / "old/taken"));
}

TEST_CASE("a file that is not there stops everything before the first move") {
    const NewFiles files;
    std::vector<FileMove> moves = files.moves({"a", "b"});
    moves.push_back({files.place / "new/none", files.place / "old/none"});
    test::check_throws<IoError>([&] { move_all(moves); }, {"new/none", "No such file"});
    CHECK(files.in_place("a") == "old a");
}

TEST_CASE("a symbolic link in the way is replaced, not followed") {
    const NewFiles files;
    write_file(files.place / "elsewhere", "of somebody else");
    fs::create_symlink("../elsewhere", files.place / "old/c");
    move_all(files.moves({"c"}));
    CHECK(!fs::is_symlink(files.place / "old/c"));
    CHECK(files.in_place("c") == "new c");
    CHECK(read_file(files.place / "elsewhere") == "of somebody else");
}

TEST_CASE("a folder takes the place of a folder as a whole, and goes back with the files") {
    const NewFiles files;
    const fs::path fresh = files.place / "fresh", aside = files.place / "aside", old = files.place / "old";
    fs::create_directory(fresh);
    write_file(fresh / "d", "new d");
    const std::vector<FileMove> moves{{fresh, old}, {files.place / "new/c", old / "c"}};
    move_all(moves);
    CHECK(read_file(old / "d") == "new d");
    CHECK(read_file(old / "c") == "new c");
    CHECK(read_file(fresh / "a") == "old a"); // where the file system exchanges names; else fresh.old
    fs::create_directory(files.place / "taken");
    // A folder gets another name, and a new one its own; then an error.
    test::check_throws<IoError>(
        [&] {
            move_all({{old, aside}, {fresh, old}, {files.place / "new/b", files.place / "taken"}});
        },
        {"taken: cannot be written"});
    CHECK(!fs::exists(aside));
    CHECK(read_file(old / "d") == "new d");
    CHECK(read_file(fresh / "a") == "old a");
}

TEST_CASE("a file does not take the place of a folder, nor a folder that of a file") {
    const NewFiles files;
    test::check_throws<IoError>(
        [&] {
            move_all({{files.place / "new/a", files.place / "old"}});
        },
        {"old: cannot be written"});
    test::check_throws<IoError>(
        [&] {
            move_all({{files.place / "new", files.place / "old/a"}});
        },
        {"old/a: cannot be written"});
    CHECK(files.in_place("a") == "old a");
}
