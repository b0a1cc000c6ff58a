// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/folder_list.hpp>

#include "io/temporary.hpp"

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

struct Folder {
    test::Temporary place;

    Folder() {
        for (const char* below : {"b", "__MACOSX", ".ipynb_checkpoints", "@eaDir", "b/.hidden"})
            fs::create_directories(place / below);
        for (const char* name : {"0002.png", "0001.png", "._0001.png", ".DS_Store", "Thumbs.db", "thumbs.db",
                                 "desktop.ini", "Desktop.ini", "__MACOSX/0001.png", ".ipynb_checkpoints/0001.png",
                                 "@eaDir/0001.png", "b/0003.png", "b/._0003.png", "b/.hidden/0004.png", "a b.png"})
            write_file(place / name, "x");
    }
    [[nodiscard]] std::vector<std::string> names(const std::vector<fs::path>& paths) const {
        std::vector<std::string> result;
        for (const fs::path& path : paths) result.push_back(fs::relative(path, place / "").string());
        return result;
    }
};

} // namespace

TEST_CASE_FIXTURE(Folder, "a folder's files in the order of their names, without those of operating systems") {
    using Names = std::vector<std::string>;
    CHECK(names(list_folder(place / "")) == Names{"0001.png", "0002.png", "a b.png", "b"});
    CHECK(names(list_files_below(place / "")) == Names{"0001.png", "0002.png", "a b.png", "b/0003.png"});
    // The folder itself may be hidden.
    CHECK(names(list_folder(place / "b/.hidden")) == Names{"b/.hidden/0004.png"});
    CHECK(names(list_files_below(place / ".ipynb_checkpoints")) == Names{".ipynb_checkpoints/0001.png"});
}

TEST_CASE_FIXTURE(Folder, "what cannot be listed is named, with what was expected") {
    test::check_throws<IoError>([&] { (void)list_folder(place / "none", "a folder of images"); },
                                {"none", "cannot be listed", "No such file", "expected a folder of images"});
    test::check_throws<IoError>([&] { (void)list_files_below(place / "0001.png"); },
                                {"0001.png", "cannot be listed", "Not a directory"});
    CHECK(list_folder(place / "b/.hidden/../../b/.hidden").size() == 1);
    write_file(place / "b/Icon\r", "x");
    CHECK(list_folder(place / "b").size() == 1);
    write_file(place / "b/red\x1b[31m.png", "x");
    test::check_throws<IoError>([&] { (void)list_folder(place / "b"); },
                                {"/b: holds 'red?[31m.png'", "cannot be shown; rename it"});
}

TEST_CASE("numbers of files, with as many zeros as a program writes") {
    CHECK(detail::number_of("a/000012.json") == 12);
    CHECK(detail::number_of("000000000012.json") == 12); // OpenPose's twelve digits
    CHECK(detail::number_of("0.json") == 0);
    CHECK(detail::number_of("000.json") == 0);
    CHECK(detail::number_of("999999999.json") == 999999999);
    CHECK(detail::number_of("1234567890.json") == -1);
    for (const char* none : {"a1.json", ".json", "1a.json", "-1.json", "._1.json", ""})
        CHECK(detail::number_of(none) == -1);

    const test::Temporary folder;
    for (const char* name : {"10.txt", "0002.txt", "._0002.txt", "3.json", "x.txt", "000000000001.txt"})
        write_file(folder / name, "x");
    const auto files = detail::list_numbered(folder / "", ".txt");
    REQUIRE(files.size() == 3);
    CHECK(files[0].number == 1);
    CHECK(files[1].path.filename() == "0002.txt");
    CHECK(files[2].number == 10);
    write_file(folder / "02.txt", "x");
    test::check_throws<IoError>([&] { (void)detail::list_numbered(folder / "", ".txt"); },
                                {"02.txt", "0002.txt", "each frame once"});
}
