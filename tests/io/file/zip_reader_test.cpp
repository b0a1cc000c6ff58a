// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/zip_reader.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

namespace {

std::string read_member(const ZipReader& zip, const std::string& name) {
    ZipReader::Member member = zip.open(zip.locate(name), name);
    std::string bytes(member.size(), '\0');
    std::size_t done = 0;
    while (const std::size_t count = member.read(bytes.data() + done, bytes.size() - done)) done += count;
    CHECK(done == bytes.size());
    member.finish();
    return bytes;
}

ZipReader open_zip(const std::filesystem::path& path, const ZipReader::Limits& limits = {}) {
    return {path, {}, limits};
}

} // namespace

TEST_CASE("members of a zip archive are listed and read") {
    const test::Temporary folder;
    {
        test::ZipFile zip(folder / "a.zip");
        zip.add("b/c.txt", "stored", false);
        zip.add("a.txt", std::string(5000, 'x'), true);
    }
    const ZipReader zip = open_zip(folder / "a.zip");
    CHECK(zip.names() == std::vector<std::string>{"b/c.txt", "a.txt"});
    CHECK(zip.size() == std::filesystem::file_size(folder / "a.zip"));
    CHECK(read_member(zip, "b/c.txt") == "stored");
    CHECK(read_member(zip, "a.txt") == std::string(5000, 'x'));
    CHECK(zip.locate("c.txt") < 0);

    ZipReader::Member early = zip.open(zip.locate("a.txt"), "a.txt");
    test::check_throws<IoError>([&] { early.finish(); }, {"a.txt", "longer than it claims"});
}

TEST_CASE("files that are no zip archive, and members beyond the limits, are refused") {
    const test::Temporary folder;
    {
        test::ZipFile(folder / "a.zip").add("a", std::string(100000, 'x'), true);
    }
    test::check_throws<IoError>([&] { (void)open_zip(folder / "none.zip"); }, {"none.zip", "No such file"});
    test::check_throws<IoError>([&] { (void)open_zip(folder / ""); }, {"is a directory, expected a zip archive"});
    write_file(folder / "text.zip", "some text", Sync::none);
    test::check_throws<IoError>([&] { (void)open_zip(folder / "text.zip"); }, {"text.zip", "not a zip archive"});

    const auto limited = [&](const ZipReader::Limits& limits) {
        const ZipReader zip = open_zip(folder / "a.zip", limits);
        (void)zip.open(zip.locate("a"), "a.zip: a");
    };
    limited({100000, 10, 100000});
    test::check_throws<IoError>([&] { limited({99999, 10, 100000}); }, {"a.zip: a claims 100000 bytes", "99999"});
    test::check_throws<IoError>([&] { limited({100000, 10, 99999}); }, {"a.zip: a inflates", "more than 10 times"});
    test::truncate_file(folder / "a.zip", 20);
    test::check_throws<IoError>([&] { (void)open_zip(folder / "a.zip"); }, {"a.zip"});
}
