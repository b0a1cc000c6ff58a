// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/npz.hpp>

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz_writer.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <cstring>
#include <limits>
#include <vector>

using namespace gsh;
using test::ZipFile;

namespace {

std::string npy(const std::string& dtype, const std::string& shape, const std::string& data, bool fortran = false,
                int version = 1) {
    return test::npy_bytes(dtype, shape, data, fortran, version);
}
template <class T>
std::string bytes_of(const std::vector<T>& values) {
    return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

} // namespace

TEST_CASE("deflated members, Fortran order, header versions and every width of number") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    const std::vector<float> counted{0, 3, 1, 4, 2, 5}; // [[0 1 2] [3 4 5]] by columns
    {
        ZipFile zip(path);
        zip.add("fortran.npy", npy("<f4", "(2, 3)", bytes_of(counted), true), true);
        zip.add("v2.npy", npy("<f8", "(2,)", bytes_of<double>({1, 2}), false, 2), true);
        zip.add("v3.npy", npy("<f8", "()", bytes_of<double>({3}), false, 3), false);
        zip.add("half.npy", npy("<f2", "(4,)", bytes_of<std::uint16_t>({0x3C00, 0xC100, 0x0001, 0x7BFF}), false),
                false);
        zip.add("i1.npy", npy("|i1", "(2,)", bytes_of<std::int8_t>({-1, 2})), false);
        zip.add("i2.npy", npy("<i2", "(2,)", bytes_of<std::int16_t>({-1, 2})), false);
        zip.add("u2.npy", npy("<u2", "(2,)", bytes_of<std::uint16_t>({65535, 2})), false);
        zip.add("i4.npy", npy("<i4", "(2,)", bytes_of<std::int32_t>({-1, 2})), false);
        zip.add("u4.npy", npy("<u4", "(2,)", bytes_of<std::uint32_t>({4294967295u, 2})), false);
        zip.add("u8.npy", npy("<u8", "(2,)", bytes_of<std::uint64_t>({1, 2})), false);
        zip.add("b1.npy", npy("|b1", "(2,)", bytes_of<std::uint8_t>({1, 0})), false);
    }
    const NpzReader file(path);
    CHECK(file.read<double>("fortran", {2, 3}).data == std::vector<double>{0, 1, 2, 3, 4, 5});
    CHECK(file.read<float>("v2").data == std::vector<float>{1, 2});
    CHECK(file.read_number<float>("v3") == 3);
    CHECK(file.read<float>("half").data == std::vector<float>{1, -2.5, 0x1p-24f, 65504});
    CHECK(file.read<int>("i1").data == std::vector<int>{-1, 2});
    CHECK(file.read<int>("i2").data == std::vector<int>{-1, 2});
    CHECK(file.read<int>("u2").data == std::vector<int>{65535, 2});
    CHECK(file.read<int>("i4").data == std::vector<int>{-1, 2});
    CHECK(file.read<std::int64_t>("u4").data == std::vector<std::int64_t>{4294967295, 2});
    CHECK(file.read<int>("u8").data == std::vector<int>{1, 2});
    CHECK(file.read<int>("b1").data == std::vector<int>{1, 0});
    test::check_throws<ValueError>([&] { (void)file.read<int>("u4"); }, {path.string(), "u4[0]", "4294967295"});
    test::check_throws<ValueError>([&] { (void)file.read<std::uint32_t>("i4"); }, {"i4[0]", "-1"});
}

TEST_CASE("a three-dimensional array in Fortran order") {
    const test::Temporary folder;
    std::vector<double> columns;
    for (int k = 0; k < 4; ++k)
        for (int j = 0; j < 3; ++j)
            for (int i = 0; i < 2; ++i) columns.push_back(100 * i + 10 * j + k);
    {
        ZipFile zip(folder / "a.npz");
        zip.add("x.npy", npy("<f8", "(2, 3, 4)", bytes_of(columns), true), true);
    }
    const auto x = NpzReader(folder / "a.npz").read<double>("x", {2, 3, 4});
    std::size_t n = 0;
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 4; ++k) CHECK(x.data[n++] == 100 * i + 10 * j + k);
}

TEST_CASE("files that are no archive") {
    const test::Temporary folder;
    test::check_throws<IoError>([&] { NpzReader(folder / "none.npz"); }, {"none.npz", "No such file"});
    test::check_throws<IoError>([&] { NpzReader(folder / ""); }, {"directory"});
    write_file(folder / "empty.npz", "");
    test::check_throws<IoError>([&] { NpzReader(folder / "empty.npz"); }, {"empty.npz", "empty"});
    write_file(folder / "text.npz", std::string(5000, 'x'));
    test::check_throws<IoError>([&] { NpzReader(folder / "text.npz"); }, {"text.npz", "not an .npz"});
    {
        NpzWriter file(folder / "cut.npz");
        file.add("x", std::vector<double>(1000, 1.0));
        file.commit();
    }
    test::truncate_file(folder / "cut.npz", 100);
    test::check_throws<IoError>([&] { NpzReader(folder / "cut.npz"); }, {"cut.npz", "truncated"});
}

TEST_CASE("members that cannot be read name the file and the key") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    {
        ZipFile zip(path);
        zip.add("x.npy", npy("<f8", "(2, 2)", bytes_of<double>({1, 2, 3, std::numeric_limits<double>::quiet_NaN()})),
                true);
        zip.add("big.npy", npy("<f8", "(1,)", bytes_of<double>({1e300})), true);
        zip.add("object.npy", npy("|O", "()", "\x80\x04N."), true);
        zip.add("text.npy", npy("<U2", "(1,)", std::string("a\0\0\0b\0\0\0", 8)), true);
        zip.add("swapped.npy", npy(">f4", "(1,)", "abcd"), true);
        zip.add("complex.npy", npy("<c8", "(1,)", "abcdefgh"), true);
        zip.add("ids.npy", npy("<i4", "(1,)", "abcd"), true);
        zip.add("short.npy", npy("<f8", "(3,)", bytes_of<double>({1, 2})), true);
        zip.add("long.npy", npy("<f8", "(1,)", bytes_of<double>({1, 2})), true);
        zip.add("absurd.npy", npy("<f8", "(4611686018427387904, 4)", ""), true);
        zip.add("huge.npy", npy("<f8", "(99999999999999999999999,)", ""), true);
        zip.add("version.npy", npy("<f8", "()", bytes_of<double>({1}), false, 9), true);
        zip.add("headless.npy", "nothing of the kind", true);
        zip.add("tiny.npy", "\x93NUM", true);
        zip.add("keyless.npy", test::npy_bytes_of_header("{'descr': '<f8', 'shape': (1,)}", bytes_of<double>({1})),
                true);
        zip.add("structured.npy",
                test::npy_bytes_of_header("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': ()}",
                                          bytes_of<double>({1})),
                true);
        zip.add("behind.npy",
                test::npy_bytes_of_header("{'descr': '<f8', 'fortran_order': False, 'shape': (), }\nx",
                                          bytes_of<double>({1})),
                true);
        zip.add("readme.txt", "not an array", true);
    }
    const NpzReader file(path);
    const auto read = [&](const char* key) { return [&file, key] { (void)file.read<float>(key); }; };
    test::check_throws<IoError>(read("y"), {path.string(), "y is missing", "big"});
    test::check_throws<ShapeError>([&] { (void)file.read<double>("x", {-1, 3}); },
                                   {path.string(), "x", "(2, 2)", "(*, 3)"});
    test::check_throws<ShapeError>([&] { (void)file.read_number<double>("x"); }, {"x"});
    test::check_throws<ValueError>(read("x"), {path.string(), "x[1, 1]", "NaN"});
    test::check_throws<ValueError>(read("big"), {path.string(), "big[0]", "<f4"});
    test::check_throws<IoError>(read("object"), {path.string(), "object", "pickled"});
    test::check_throws<IoError>(read("text"), {"text", "<U2", "real numbers"});
    test::check_throws<IoError>(read("swapped"), {"swapped", ">f4"});
    test::check_throws<IoError>(read("complex"), {"complex", "<c8"});
    test::check_throws<IoError>(read("ids"), {"ids", "<i4", "real numbers"});
    test::check_throws<IoError>([&] { (void)file.read<int>("x"); }, {"x", "<f8", "integers"});
    test::check_throws<IoError>(read("short"), {path.string(), "short", "truncated"});
    test::check_throws<IoError>(read("long"), {path.string(), "long", "(1,)"});
    test::check_throws<IoError>(read("absurd"), {path.string(), "absurd"});
    test::check_throws<IoError>(read("huge"), {path.string(), "huge", "absurd"});
    test::check_throws<IoError>(read("version"), {path.string(), "version", "9"});
    test::check_throws<IoError>(read("headless"), {path.string(), "headless"});
    test::check_throws<IoError>(read("tiny"), {path.string(), "tiny", "truncated"});
    test::check_throws<IoError>(read("keyless"), {path.string(), "keyless", "fortran_order"});
    test::check_throws<IoError>(read("structured"), {path.string(), "structured"});
    test::check_throws<IoError>(read("behind"), {path.string(), "behind", "its header is damaged"});
    test::check_throws<IoError>([&] { (void)file.read_texts("x"); }, {path.string(), "x", "text"});
    CHECK(!file.has_array("object"));
    CHECK(file.has_array("text"));
    CHECK(file.keys().size() == 17);
}

TEST_CASE("a damaged member does not pass its checksum") {
    const test::Temporary folder;
    {
        NpzWriter file(folder / "a.npz");
        file.add("x", std::vector<double>(100, 1.0));
        file.commit();
    }
    std::string bytes = read_file(folder / "a.npz");
    bytes[400] ^= 1; // within the numbers
    write_file(folder / "a.npz", bytes);
    const NpzReader file(folder / "a.npz");
    test::check_throws<IoError>([&] { (void)file.read<double>("x"); }, {"a.npz", "x", "damaged"});
}

TEST_CASE("a compressed-size bomb is refused before it inflates") {
    const test::Temporary folder;
    const auto path = folder / "bomb.npz";
    {
        ZipFile zip(path);
        zip.add("honest.npy", npy("<f4", "(25000000,)", std::string(100000000, '\0')), true);
    }
    CHECK(std::filesystem::file_size(path) < 200000);
    test::check_throws<IoError>([&] { (void)NpzReader(path).read<float>("honest"); },
                                {path.string(), "honest", "inflates"});
    NpzReader::Limits limits;
    limits.member_bytes = 1 << 20;
    test::check_throws<IoError>([&] { (void)NpzReader(path, limits).read<float>("honest"); },
                                {path.string(), "honest", "100000128", "1048576"});
    limits.member_bytes = std::size_t(1) << 30, limits.ratio = 2000;
    CHECK(NpzReader(path, limits).read<float>("honest").size() == 25000000);

    // The archive's directory states a smaller size than the member has.
    std::string bytes = read_file(path);
    const std::uint32_t truth = 100000128, claim = 1000;
    for (std::size_t i = 0; i + 4 <= bytes.size(); ++i)
        if (std::memcmp(&bytes[i], &truth, 4) == 0) std::memcpy(&bytes[i], &claim, 4);
    write_file(path, bytes);
    test::check_throws<Error>([&] { (void)NpzReader(path).read<float>("honest"); }, {path.string()});
}

TEST_CASE("elements without bytes, and rows without numbers, are counted before anything is allocated") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    {
        ZipFile zip(path);
        zip.add("text.npy", npy("<U0", "(1000000000000,)", ""), true);
        zip.add("none.npy", npy("<U0", "()", ""), true);
        zip.add("void.npy", npy("|V0", "(1000000000000,)", ""), true);
        zip.add("bytes.npy", npy("|S0", "(1000000000000,)", ""), true);
        zip.add("rows.npy", npy("<f8", "(1000000000000, 0)", ""), true);
        zip.add("wraps.npy", npy("<f8", "(0, 4294967296, 4294967296, 4)", ""), true);
        zip.add("structured.npy",
                test::npy_bytes_of_header("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (9, )}", ""),
                true);
        zip.add("axes.npy",
                npy(
                    "<f8",
                    "(" +
                        [] {
                            std::string text;
                            for (int i = 0; i < 32; ++i) text += "1000000000000000000, ";
                            return text;
                        }() +
                        ")",
                    ""),
                true);
        zip.add("empty.npy", npy("<U3", "(0,)", ""), true);
        zip.add("beyond.npy", npy("<U1", "()", std::string("\0\0\x11\0", 4)), true);
        zip.add("half.npy", npy("<U1", "()", std::string("\0\xd8\0\0", 4)), true); // of a pair of UTF-16
        zip.add("narrow.npy", npy("<f8", "(20000, 3, 0)", ""), true);
    }
    const NpzReader file(path);
    for (const char* key : {"text", "none", "bytes", "void"})
        test::check_throws<IoError>([&] { (void)file.read_texts(key); }, {path.string() + ": " + key, "no bytes"});
    for (const char* key : {"rows", "wraps"})
        test::check_throws<IoError>([&] { (void)file.read<double>(key); }, {path.string() + ": " + key, "damaged"});
    test::check_throws<IoError>([&] { (void)file.read<double>("structured"); }, {"structured array", "plain numbers"});
    test::check_throws<IoError>([&] { (void)file.read<double>("axes"); }, {"axes", "1000000000000000000, …)"});
    CHECK(file.read_texts("empty").empty());
    for (const char* key : {"beyond", "half"})
        test::check_throws<IoError>([&] { (void)file.read_texts(key); },
                                    {path.string() + ": " + key, "no character of Unicode"});
    CHECK(file.read<double>("narrow", {-1, 3, -1}).shape == Shape{20000, 3, 0});
}

TEST_CASE("numbers and texts are bounded as they are in memory, too") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    {
        ZipFile zip(path);
        zip.add("bytes.npy", npy("|u1", "(20000000,)", std::string(20'000'000, '\0')), true); // 160 MB as doubles
        zip.add("texts.npy", npy("<U1", "(4000000,)", std::string(16'000'000, '\0')), true);
    }
    CHECK(std::filesystem::file_size(path) < 100'000);
    const NpzReader file(path);
    test::check_throws<IoError>([&] { (void)file.read<double>("bytes", Numbers::any); },
                                {path.string() + ": bytes takes 160000000 bytes", "exhaust memory"});
    test::check_throws<IoError>([&] { (void)file.read_texts("texts"); }, {path.string() + ": texts takes 144000000"});
    CHECK(file.read<std::uint8_t>("bytes").size() == 20'000'000);
}

TEST_CASE("a stored member that claims more bytes than the archive has") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    {
        ZipFile zip(path);
        zip.add("x.npy", npy("<f8", "(100000000,)", ""), false);
    }
    std::string bytes = read_file(path); // 128 bytes of header alone; both directories state 800000128
    const std::uint32_t truth = 128, claim = 800000128;
    for (std::size_t i = 0; i + 4 <= bytes.size(); ++i)
        if (std::memcmp(&bytes[i], &truth, 4) == 0) std::memcpy(&bytes[i], &claim, 4);
    write_file(path, bytes);
    test::check_throws<IoError>([&] { (void)NpzReader(path).read<double>("x"); }, {path.string(), "x"});
}

TEST_CASE("numbers that widen beyond the limit are refused") {
    const test::Temporary folder;
    {
        NpzWriter file(folder / "a.npz");
        file.add("x", std::vector<std::uint8_t>(1000, 1));
        file.commit();
    }
    NpzReader::Limits limits;
    limits.member_bytes = 2000;
    const NpzReader file(folder / "a.npz", limits);
    CHECK(file.read<std::uint8_t>("x").size() == 1000);
    test::check_throws<IoError>([&] { (void)file.read<std::int64_t>("x"); }, {"x", "(1000,)", "2000"});
}

TEST_CASE("a single array in a file of its own") {
    const test::Temporary folder;
    const auto path = folder / "image.npy";
    const std::vector<float> pixels{0, 0.25f, 0.5f, 0.75f, 1, 2};
    write_npy<float>(path, pixels, {1, 2, 3});
    const auto read = read_npy<float>(path);
    CHECK(read.shape == Shape{1, 2, 3});
    CHECK(read.data == pixels);
    test::truncate_file(path, 1);
    test::check_throws<IoError>([&] { (void)read_npy<float>(path); }, {path.string(), "truncated"});
    test::check_throws<IoError>([&] { (void)read_npy<float>(folder / "none.npy"); }, {"none.npy", "No such file"});
    CHECK_THROWS_AS(write_npy<float>(path, pixels, {7}), ShapeError);
}

TEST_CASE("every member is read to its end, and a wrong byte is found by its checksum") {
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    {
        NpzWriter file(path);
        file.add("first", std::vector<float>(1000, 1.5f));
        file.add("second", std::vector<float>(1000, 2.5f));
        file.commit();
    }
    CHECK_NOTHROW(NpzReader(path).check_all());
    std::string bytes = read_file(path);
    bytes[bytes.find("second.npy") + 3000] ^= 1;
    write_file(path, bytes);
    test::check_throws<IoError>([&] { NpzReader(path).check_all(); }, {"a.npz: second is damaged"});
}
