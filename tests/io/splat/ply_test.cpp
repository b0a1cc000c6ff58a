// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/ply.hpp>

#include "io/comma_locale.hpp"
#include "io/damage.hpp"
#include "io/temporary.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

GaussianCloud<float> make_cloud(std::size_t count, int degree) {
    GaussianCloud<float> cloud(count, degree);
    test::Rng rng(8);
    const auto vec = [&] { return vec3<float>(rng.vec()); };
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec(), cloud.log_scales[i] = vec();
        const auto q = rng.quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.opacity_logits[i] = static_cast<float>(rng.normal());
    }
    for (auto& sh : cloud.sh) sh = vec();
    return cloud;
}

void check_equal(const GaussianCloud<float>& a, const GaussianCloud<float>& b) {
    REQUIRE(a.size() == b.size());
    CHECK(a.sh_degree == b.sh_degree);
    CHECK(a.means == b.means);
    CHECK(a.log_scales == b.log_scales);
    CHECK(a.opacity_logits == b.opacity_logits);
    CHECK(a.sh == b.sh);
    CHECK(std::equal(a.quats.begin(), a.quats.end(), b.quats.begin(), [](const quat<float>& p, const quat<float>& q) {
        return p.w == q.w && p.x == q.x && p.y == q.y && p.z == q.z;
    }));
}

/// The properties that a plain Gaussian must have: name, type and value.
struct Column {
    std::string name, type;
    double value;
};
std::vector<Column> columns() {
    return {{"x", "float", 1},       {"y", "float", 2},       {"z", "float", 3},       {"f_dc_0", "float", 4},
            {"f_dc_1", "float", 5},  {"f_dc_2", "float", 6},  {"opacity", "float", 7}, {"scale_0", "float", 8},
            {"scale_1", "float", 9}, {"scale_2", "float", 10}, {"rot_0", "float", 11},  {"rot_1", "float", 12},
            {"rot_2", "float", 13},  {"rot_3", "float", 14}};
}

std::string header(const std::vector<Column>& list, const std::string& count,
                   const std::string& format = "binary_little_endian") {
    std::string text = "ply\nformat " + format + " 1.0\ncomment made by hand\nelement vertex " + count + "\n";
    for (const auto& column : list) text += "property " + column.type + " " + column.name + "\n";
    return text + "end_header\n";
}
std::string row(const std::vector<Column>& list) {
    std::string bytes;
    const auto append = [&](auto value) { bytes.append(reinterpret_cast<const char*>(&value), sizeof value); };
    for (const auto& column : list) {
        if (column.type == "double") append(column.value);
        else if (column.type == "uchar") append(static_cast<std::uint8_t>(column.value));
        else if (column.type == "short") append(static_cast<std::int16_t>(column.value));
        else append(static_cast<float>(column.value));
    }
    return bytes;
}

} // namespace

TEST_CASE("clouds of every degree come back, padded or not") {
    const test::Temporary folder;
    for (const std::size_t count : {0, 1, 5, 5000})
        for (int degree = 0; degree <= (count == 5 ? 4 : 1); ++degree) {
            const auto cloud = make_cloud(count, degree);
            write_gaussian_ply(folder / "a.ply", cloud, {.pad_to_degree = 0});
            check_equal(read_gaussian_ply(folder / "a.ply"), cloud);
        }
    const auto cloud = make_cloud(7, 2);
    write_gaussian_ply(folder / "b.ply", cloud);
    const auto padded = read_gaussian_ply(folder / "b.ply");
    CHECK(padded.sh_degree == 3);
    for (std::size_t i = 0; i < 7; ++i)
        for (std::size_t k = 0; k < 16; ++k)
            CHECK(padded.sh[16 * i + k] == (k < 9 ? cloud.sh[9 * i + k] : vec3<float>(0)));
}

TEST_CASE("the file has the reference code's layout") {
    const test::Temporary folder;
    const auto cloud = make_cloud(2, 1);
    write_gaussian_ply(folder / "a.ply", cloud);
    const std::string bytes = read_file(folder / "a.ply");
    const std::size_t begin = bytes.find("end_header\n") + 11;
    CHECK(bytes.starts_with(
        "ply\nformat binary_little_endian 1.0\ncomment written by gsh "));
    CHECK(bytes.find("\nelement vertex 2\nproperty float x\nproperty float y\n") != std::string::npos);
    CHECK(bytes.size() == begin + 2 * 62 * 4);
    float second[62];
    std::memcpy(second, bytes.data() + begin + 62 * 4, sizeof second);
    CHECK(second[2] == cloud.means[1].z);
    CHECK(second[3] == 0); // normal
    CHECK(second[7] == cloud.sh[4].y);
    CHECK(second[9] == cloud.sh[5].x);          // f_rest_0: red of k = 1
    CHECK(second[9 + 15 + 2] == cloud.sh[7].y); // f_rest_17: green of k = 3
    CHECK(second[9 + 30 + 1] == cloud.sh[6].z); // f_rest_31: blue of k = 2
    CHECK(second[9 + 3] == 0);                  // padding
    CHECK(second[54] == cloud.opacity_logits[1]);
    CHECK(second[55] == cloud.log_scales[1].x);
    CHECK(second[58] == cloud.quats[1].w);
    CHECK(second[61] == cloud.quats[1].z);
}

TEST_CASE("properties are found by name, in any order and type") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    auto list = columns();
    std::swap(list[0], list[9]);
    std::swap(list[3], list[13]);
    list[5].type = "double", list[6].type = "short";
    list.insert(list.begin() + 2, {{"red", "uchar", 200}, {"nx", "float", 0}});
    list.push_back({"extra", "double", 1});
    const auto check = [&] {
        const auto cloud = read_gaussian_ply(path);
        REQUIRE(cloud.size() == 2);
        CHECK(cloud.sh_degree == 0);
        CHECK(cloud.means[1] == vec3<float>(1, 2, 3));
        CHECK(cloud.sh[1] == vec3<float>(4, 5, 6));
        CHECK(cloud.opacity_logits[1] == 7);
        CHECK(cloud.log_scales[1] == vec3<float>(8, 9, 10));
        CHECK(cloud.quats[1].w == 11);
        CHECK(cloud.quats[1].z == 14);
    };
    write_file(path, header(list, "2") + row(list) + row(list));
    check();
    // Other elements after the vertices, and Windows line ends.
    std::string text = header(list, "2");
    text.replace(text.find("end_header"), 0, "element face 1\nproperty list uchar int vertex_indices\n");
    write_file(path, text + row(list) + row(list) + "tail");
    check();
    std::string ascii = header(list, "2", "ascii");
    for (std::size_t at = 0; (at = ascii.find('\n', at)) != std::string::npos; at += 2) ascii.insert(at, "\r");
    for (int i = 0; i < 2; ++i) {
        for (const auto& column : list) ascii += std::to_string(column.value) + " ";
        ascii += "\r\n";
    }
    write_file(path, ascii);
    check();
}

TEST_CASE("numbers of ASCII files are read in any locale, and not beyond their ends") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const std::string begin = header(columns(), "1", "ascii");
    const auto x_of = [&](const std::string& x) {
        write_file(path, begin + x + " 1 1 1 1 1 1 1 1 1 1 1 1 1");
        return read_gaussian_ply(path).means[0].x;
    };
    const test::CommaLocale comma; // in which 1.5 is written 1,5
    CHECK(x_of("1.5") == 1.5f);
    CHECK(x_of("\t\r\n +2.5e-1\n") == 0.25f);
    CHECK(x_of("-3.5e-400") == 0);
    test::check_throws<ValueError>([&] { (void)x_of("1e400"); }, {"a.ply", "x of vertex 0"});
    for (const std::string& bad : std::vector<std::string>{"1,5", "1.5x", "0x10", "--1", "0." + std::string(500, '1')})
        test::check_throws<IoError>([&] { (void)x_of(bad); }, {"a.ply", "damaged", "vertex 0", bad.substr(0, 3)});
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    const auto read = [](const auto& path) { (void)read_ply_splats(path); };
    write_gaussian_ply(folder / "good.ply", make_cloud(3, 1), {.up = UpAxis::minus_y, .filter = PixelFilter{}});
    CHECK(test::read_damaged(read_file(folder / "good.ply"), folder / "fuzz.ply", 37, 1500, read) > 200);
    std::string ascii = header(columns(), "2", "ascii");
    for (int i = 0; i < 28; ++i) ascii += std::to_string(i) + ".25 ";
    CHECK(test::read_damaged(ascii, folder / "fuzz.ply", 17, 1500, read) > 200);
}

TEST_CASE("missing properties are all named") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    auto list = columns();
    list.erase(list.begin() + 10); // rot_0
    list.erase(list.begin() + 3);  // f_dc_0
    write_file(path, header(list, "1") + row(list));
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "rot_0", "f_dc_0"});
    list = columns();
    for (int i = 0; i < 9; ++i) list.push_back({"f_rest_" + std::to_string(i == 3 ? 12 : i), "float", 0});
    write_file(path, header(list, "1") + row(list));
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "f_rest_3"});
    list.pop_back();
    write_file(path, header(list, "1") + row(list));
    test::check_throws<ShapeError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "8 f_rest", "45"});
}

TEST_CASE("absurd counts are refused before anything is allocated") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto list = columns();
    for (const char* format : {"binary_little_endian", "ascii"})
        for (const char* count : {"1000", "1000000000000", "18446744073709551615"}) {
            write_file(path, header(list, count, format) + row(list));
            test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), count, "bytes"});
        }
    for (const char* count : {"-1", "many", "99999999999999999999999", "1.5"}) {
        write_file(path, header(list, count) + row(list));
        test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "vertex", count});
    }
    write_file(path, "ply\nformat ascii 1.0\nelement vertex 5\nend_header\n");
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string()});
}

TEST_CASE("what is no PLY, or no longer one") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto read = [&] { (void)read_gaussian_ply(path); };
    const auto list = columns();
    test::check_throws<IoError>(read, {path.string(), "No such file"});
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(folder / ""); }, {"directory"});
    const auto expect = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        write_file(path, text);
        test::check_throws<IoError>(read, {path.string()});
        test::check_throws<IoError>(read, words);
    };
    expect("", {"not a PLY"});
    expect("solid cube", {"not a PLY"});
    expect("ply\nformat ascii 1.0\nelement vertex", {"unknown header line"});
    expect("ply\nformat ascii 1.0\nelement vertex 3\n", {"end_header"});
    expect("ply\n" + std::string(10000, 'x'), {"4096"});
    expect(header(list, "1", "binary_big_endian"), {"binary_big_endian"});
    expect(header(list, "2") + row(list) + row(list).substr(1), {"truncated"});
    expect("ply\nformat ascii 1.0\nend_header\n", {"no vertex"});
    expect("ply\nelement vertex 0\nend_header\n", {"no format"});
    expect("ply\nformat ascii 1.0\nelement face 2\nelement vertex 0\nend_header\n", {"face", "before"});
    expect("ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n", {"property x", "list"});
    expect("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n", {"property x", "quad"});
    expect("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float x\nend_header\n", {"x", "twice"});
    std::string ascii = header(list, "1", "ascii");
    for (std::size_t i = 0; i < list.size(); ++i) ascii += i == 5 ? "word " : "1.5 ";
    expect(ascii, {"damaged", "vertex 0"});
}

TEST_CASE("numbers that are no Gaussian") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    auto list = columns();
    list[2].value = std::numeric_limits<double>::quiet_NaN();
    write_file(path, header(columns(), "2") + row(columns()) + row(list));
    test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "z of vertex 1", "nan"});
    list = columns();
    list[6].type = "double", list[6].value = 1e300;
    write_file(path, header(list, "1") + row(list));
    test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "opacity of vertex 0"});
    list = columns();
    for (std::size_t i = 10; i < 14; ++i) list[i].value = 0;
    write_file(path, header(list, "1") + row(list));
    test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "rot_0", "vertex 0"});
    auto cloud = make_cloud(3, 1);
    CHECK_THROWS_AS(write_gaussian_ply(path, cloud, {.pad_to_degree = 5}), ValueError);
    cloud.sh.pop_back();
    CHECK_THROWS_AS(write_gaussian_ply(path, cloud), ShapeError);
}

TEST_CASE("the header states vertical and filter, and the reader heeds them") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto cloud = make_cloud(9, 3);
    write_gaussian_ply(path, cloud, {.up = UpAxis::minus_y, .filter = PixelFilter{0.1, true}});
    const std::string text = read_file(path);
    for (const char* line : {"comment gsh.up -y\n", "comment gsh.filter dilation 0.1 compensated\n",
                             "comment antialiased 1\n"})
        CHECK(text.find(line) != std::string::npos);
    const StillSplats splats = read_ply_splats(path);
    check_equal(splats.cloud, cloud);
    CHECK(splats.notes.up == UpAxis::minus_y);
    REQUIRE(splats.notes.filter.has_value());
    CHECK(splats.notes.filter->dilation == 0.1);
    CHECK(splats.notes.filter->compensate_opacity);

    // A program that ignores the comment shows the cloud turned by half a turn about z.
    std::string without = text;
    without.replace(without.find("gsh.up"), 6, "xxx.up");
    write_file(path, without);
    const StillSplats turned = read_ply_splats(path);
    CHECK(!turned.notes.up.has_value());
    for (std::size_t i = 0; i < 9; ++i) {
        const vec3<float>& mean = cloud.means[i];
        CHECK(turned.cloud.means[i] == vec3<float>(-mean.x, -mean.y, mean.z));
        const vec3<double> dir = normalize(vec3<double>(0.3, -0.5, 0.8));
        const auto color = [&](const GaussianCloud<float>& c, const vec3<double>& d) {
            std::vector<vec3<double>> sh;
            for (std::size_t k = 0; k < 16; ++k) sh.push_back(vec3<double>(c.sh[16 * i + k]));
            return SHEval<3>::forward(sh.data(), d);
        };
        CHECK(length(color(turned.cloud, {-dir.x, -dir.y, dir.z}) - color(cloud, dir)) < 1e-6);
    }

    write_gaussian_ply(path, cloud, {.up = UpAxis::y});
    CHECK(read_ply_splats(path).notes.up == UpAxis::y);
    CHECK(!read_ply_splats(path).notes.filter.has_value());
    check_equal(read_ply_splats(path).cloud, cloud);
    write_gaussian_ply(path, cloud);
    CHECK(!read_ply_splats(path).notes.up.has_value());
}

TEST_CASE("comments of other programs name a filter, too") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto filter_of = [&](const std::string& comment) {
        std::string text = header(columns(), "1");
        text.replace(text.find("made by hand"), 12, comment);
        write_file(path, text + row(columns()));
        return read_ply_splats(path).notes.filter;
    };
    CHECK(filter_of("antialiased 1")->compensate_opacity);
    CHECK(filter_of("antialiased 1")->dilation == 0.3);
    CHECK(!filter_of("antialiased 0")->compensate_opacity);
    CHECK(filter_of("SplatRenderMode: mip")->dilation == 0.1);
    CHECK(!filter_of("SplatRenderMode: default")->compensate_opacity);
    for (const char* comment : {"gsh.filter dilation -1 plain", "gsh.filter dilation nan plain", "gsh.filter dilation",
                                "gsh.filter dilation 0.3 sharp", "something else"})
        CHECK(!filter_of(comment).has_value());
}
