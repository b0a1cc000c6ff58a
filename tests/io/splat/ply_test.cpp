// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/ply.hpp>

#include "io/comma_locale.hpp"
#include "io/damage.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <gsh/io/file/input_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
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
    return {{"x", "float", 1},       {"y", "float", 2},        {"z", "float", 3},       {"f_dc_0", "float", 4},
            {"f_dc_1", "float", 5},  {"f_dc_2", "float", 6},   {"opacity", "float", 7}, {"scale_0", "float", 8},
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
        if (column.type == "double")
            append(column.value);
        else if (column.type == "uchar")
            append(static_cast<std::uint8_t>(column.value));
        else if (column.type == "short")
            append(static_cast<std::int16_t>(column.value));
        else
            append(static_cast<float>(column.value));
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
    CHECK(bytes.starts_with("ply\nformat binary_little_endian 1.0\ncomment written by gsh "));
    CHECK(bytes == test::contains("\nelement vertex 2\nproperty float x\nproperty float y\n"));
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
    expect(header(list, "1", "binary_middle_endian"), {"binary_middle_endian"});
    expect(header(list, "2") + row(list) + row(list).substr(1), {"truncated"});
    expect("ply\nformat ascii 1.0\nend_header\n", {"no vertex"});
    expect("ply\nelement vertex 0\nend_header\n", {"no format"});
    for (const std::string& rest : {std::string("element vertex 1\nproperty float x\n"), std::string("format ascii 1.0\n")})
        expect("ply\n" + rest + "format binary_little_endian 1.0\nend_header\n\1\2\3\4", {"second format line, or one behind an element"});
    expect("ply\nformat ascii 1.0\nelement face 2\nproperty int a\nelement vertex 0\nend_header\n1\n", {"2 face"});
    expect("ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n0\n", {"missing: x"});
    expect("ply\nformat ascii 1.0\nelement vertex 1\nproperty list float int x\nend_header\n", {"property x", "list"});
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
    const auto refused = [&](std::size_t column, double value, std::initializer_list<std::string_view> words) {
        list = columns();
        list[column].type = "double", list[column].value = value;
        write_file(path, header(list, "1") + row(list));
        test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "of vertex 0"});
        test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, words);
    };
    const double endless = std::numeric_limits<double>::infinity();
    refused(0, 1e300, {"x of vertex 0 is 1e+300"}); // in six digits
    refused(1, -endless, {"y of vertex 0 is -inf"});
    refused(4, endless, {"f_dc_1 of vertex 0 is inf"});
    refused(6, std::numeric_limits<double>::quiet_NaN(), {"opacity of vertex 0 is nan"});
    refused(7, endless, {"scale_0 of vertex 0 is inf", "at most 44"});
    refused(8, 90, {"scale_1 of vertex 0 is 90", "logarithm", "at most 44"});
    refused(10, endless, {"rot_0 of vertex 0 is inf"});
    list = columns();
    for (std::size_t i = 10; i < 14; ++i) list[i].value = 0;
    write_file(path, header(list, "1") + row(list));
    test::check_throws<ValueError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "rot_0", "vertex 0"});
    for (const double size : {1e25, 1e-25}) { // whose squares are beyond float: the rotation is what counts
        list = columns();
        for (std::size_t i = 10; i < 14; ++i) list[i].value *= size;
        write_file(path, header(list, "1") + row(list));
        const quat<float> q = read_gaussian_ply(path).quats[0];
        CHECK(dot(q, q) == doctest::Approx(1));
        CHECK(q.z / q.w == doctest::Approx(14.0 / 11));
    }
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
    for (const char* line :
         {"comment gsh.up -y\n", "comment gsh.filter dilation 0.1 compensated\n", "comment antialiased 1\n"})
        CHECK(text == test::contains(line));
    const StillSplats splats = read_ply_splats(path);
    check_equal(splats.cloud, cloud);
    CHECK(splats.notes.up == UpAxis::minus_y);
    REQUIRE(splats.notes.filter.has_value());
    CHECK(splats.notes.filter->dilation == 0.1);
    CHECK(splats.notes.filter->compensate_opacity);

    // A program that ignores the comments shows the cloud turned by half a turn about x.
    const auto stored = [&](std::initializer_list<std::string_view> lines) {
        std::string without = text;
        for (const std::string_view line : lines) without.replace(without.find(line), 3, "xxx");
        write_file(path, without);
        return read_ply_splats(path);
    };
    const StillSplats turned = stored({"gsh.up", "gsh.axes"});
    CHECK(!turned.notes.up.has_value());
    for (std::size_t i = 0; i < 9; ++i) {
        const vec3<float>& mean = cloud.means[i];
        CHECK(turned.cloud.means[i] == vec3<float>(mean.x, -mean.y, -mean.z));
        const vec3<double> dir = normalize(vec3<double>(0.3, -0.5, 0.8));
        const auto color = [&](const GaussianCloud<float>& c, const vec3<double>& d) {
            std::vector<vec3<double>> sh;
            for (std::size_t k = 0; k < 16; ++k) sh.push_back(vec3<double>(c.sh[16 * i + k]));
            return SHEval<3>::forward(sh.data(), d);
        };
        CHECK(length(color(turned.cloud, {dir.x, -dir.y, -dir.z}) - color(cloud, dir)) < 1e-6);
    }
    // Earlier versions of gsh wrote y down turned about z, and did not state the axes.
    const StillSplats earlier = stored({"gsh.axes"});
    CHECK(earlier.notes.up == UpAxis::minus_y);
    CHECK(earlier.cloud.means[4] == vec3<float>(-cloud.means[4].x, cloud.means[4].y, -cloud.means[4].z));
    const StillSplats by_others = stored({"gsh.axes", "written by"});
    CHECK(by_others.cloud.means == cloud.means);

    write_gaussian_ply(path, cloud, {.up = UpAxis::y});
    CHECK(read_ply_splats(path).notes.up == UpAxis::y);
    CHECK(!read_ply_splats(path).notes.filter.has_value());
    check_equal(read_ply_splats(path).cloud, cloud);
    write_gaussian_ply(path, cloud);
    CHECK(!read_ply_splats(path).notes.up.has_value());
}

TEST_CASE("a vertical that other programs state in a comment is heeded") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto read = [&](const std::string& comment) {
        std::string text = header(columns(), "1");
        text.replace(text.find("made by hand"), 12, comment);
        write_file(path, text + row(columns()));
        return read_ply_splats(path);
    };
    const auto mean_of = [&](const std::string& comment) { return read(comment).cloud.means[0]; }; // of (1, 2, 3)
    CHECK(mean_of("Vertical Axis: z") == vec3<float>(1, 3, -2)); // nerfstudio 1.1.5 means +z
    CHECK(read("Vertical Axis: z").notes.up == UpAxis::z);
    CHECK(read("Vertical Axis: z").warnings.empty());
    CHECK(mean_of("vertical axis:  -Z ") == vec3<float>(1, -3, 2));
    CHECK(mean_of("Vertical Axis: x") == vec3<float>(-2, 1, 3));
    CHECK(mean_of("Vertical Axis: +y") == vec3<float>(1, 2, 3));
    CHECK(read("Vertical Axis: +y").notes.up == UpAxis::y);
    CHECK(mean_of("Vertical Axis: -y") == vec3<float>(1, -2, -3));
    // Brush writes "y" where no other vertical was chosen, and means the custom, -y: as if nothing were stated.
    CHECK(mean_of("Vertical axis: y") == vec3<float>(1, 2, 3));
    CHECK(!read("Vertical axis: y").notes.up.has_value());
    // A chosen one it writes as a direction.
    CHECK(mean_of("Vertical axis: 0 -1 0") == vec3<float>(1, -2, -3));
    CHECK(mean_of("Vertical axis: [0, 0, 2]") == vec3<float>(1, 3, -2));
    const StillSplats oblique = read("Vertical axis: 0.6 -0.8 0");
    CHECK(oblique.notes.up == UpAxis::minus_y);
    CHECK(oblique.cloud.means[0].y == doctest::Approx(0.6 * 1 - 0.8 * 2));
    CHECK(oblique.cloud.means[0].z == doctest::Approx(-3));
    for (const char* comment : {"Vertical Axis: up", "Vertical Axis:", "Vertical Axis: 0 0 0", "Vertical Axis: 1 2",
                                "Vertical Axis: nan 1 0"}) {
        const StillSplats splats = read(comment);
        CHECK(!splats.notes.up.has_value());
        REQUIRE(splats.warnings.size() == 1);
        CHECK(splats.warnings[0].starts_with(path.string() + ": the comment 'Vertical Axis: "));
    }
    CHECK(read("gsh.up z").cloud.means[0] == vec3<float>(1, 3, -2));
    CHECK(read("gsh.up sideways").warnings.empty());
    // What a user states goes before what the file does.
    StillSplats restated = read("Vertical Axis: z");
    restate_up(restated, UpAxis::minus_y);
    CHECK(restated.notes.up == UpAxis::minus_y);
    CHECK(length(restated.cloud.means[0] - vec3<float>(1, -2, -3)) < 1e-6f);
    restated = read("nothing");
    restate_up(restated, UpAxis::x);
    CHECK(restated.cloud.means[0] == vec3<float>(-2, 1, 3));
}

TEST_CASE("big-endian files are read") {
    const test::Temporary folder;
    auto list = columns();
    list[5].type = "double", list[6].type = "short";
    std::string bytes;
    for (const auto& column : list) {
        std::string number = row({column});
        std::reverse(number.begin(), number.end());
        bytes += number;
    }
    write_file(folder / "a.ply", header(list, "1", "binary_big_endian") + bytes);
    const auto cloud = read_gaussian_ply(folder / "a.ply");
    CHECK(cloud.means[0] == vec3<float>(1, 2, 3));
    CHECK(cloud.sh[0] == vec3<float>(4, 5, 6));
    CHECK(cloud.opacity_logits[0] == 7);
    CHECK(cloud.quats[0].z == 14);
}

TEST_CASE("elements before the vertices and lists within them are skipped") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto list = columns();
    const std::string before = "element camera 3\nproperty float value\n"
                               "element face 2\nproperty uchar kind\nproperty list uchar int corners\n"
                               "element vertex 2\nproperty list ushort short neighbours\n";
    const auto with = [&](const std::string& format) {
        std::string text = header(list, "2", format);
        return text.replace(text.find("element vertex 2\n"), 17, before);
    };
    const auto check = [&] {
        const auto cloud = read_gaussian_ply(path);
        REQUIRE(cloud.size() == 2);
        for (const auto& mean : cloud.means) CHECK(mean == vec3<float>(1, 2, 3));
        CHECK(cloud.quats[1].z == 14);
    };
    std::string binary = with("binary_little_endian");
    binary += std::string(12, '\1') + std::string("\7\1abcd\7\2abcdefgh", 16);
    for (const char* neighbours : {"", "abcdef"}) {
        const std::string bytes(neighbours);
        binary += static_cast<char>(bytes.size() / 2) + std::string(1, '\0') + bytes + row(list);
    }
    write_file(path, binary);
    check();
    write_file(path, binary.substr(0, binary.size() - 1));
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "truncated"});
    std::string ascii = with("ascii") + "1\n2\n3\n7 0\n7 2 5 6\n";
    for (const char* neighbours : {"0", "2 -8 9"}) {
        ascii += neighbours;
        for (const auto& column : list) ascii += " " + std::to_string(column.value);
        ascii += "\n";
    }
    write_file(path, ascii);
    check();
    std::string bad = ascii;
    bad.replace(bad.find("7 2 5 6"), 3, "7 -2");
    write_file(path, bad);
    test::check_throws<IoError>([&] { (void)read_gaussian_ply(path); }, {path.string(), "corners", "length of -2"});
    CHECK(test::read_damaged(binary, folder / "fuzz.ply", 37, 1500,
                             [](const auto& file) { (void)read_ply_splats(file); }) > 200);
}

TEST_CASE("infinities that mean something are read: opacities of 1 and 0, and flat Gaussians") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const double endless = std::numeric_limits<double>::infinity();
    std::string text = header(columns(), "3");
    for (const auto& [opacity, scale] : {std::pair{endless, 9.0}, {-endless, 9.0}, {0.0, -endless}}) {
        auto list = columns();
        list[6].value = opacity, list[8].value = scale;
        text += row(list);
    }
    write_file(path, text);
    const auto cloud = read_gaussian_ply(path);
    CHECK(sigmoid(cloud.opacity_logits[0]) == 1);
    CHECK(sigmoid(cloud.opacity_logits[1]) < 1e-8f);
    CHECK(cloud.log_scales[2] == vec3<float>(8, -20, 10));
    CHECK(cloud.log_scales[1] == vec3<float>(8, 9, 10));
    check_writable("as read", cloud);
    // The same in a file of text, and a logit beyond float.
    std::string ascii = header(columns(), "1", "ascii") + "1 2 3 4 5 6 -1e300 8 9 -inf 11 12 13 14\n";
    write_file(path, ascii);
    CHECK(read_gaussian_ply(path).opacity_logits[0] == -certain_logit);
    CHECK(read_gaussian_ply(path).log_scales[0].z == flat_log_scale);
}

TEST_CASE("Gaussians with plain colours are read") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto color_of = [&](const char* type, double red, double green, double blue) {
        auto list = columns();
        list[3] = {"red", type, red}, list[4] = {"green", type, green}, list[5] = {"blue", type, blue};
        write_file(path, header(list, "1") + row(list));
        return read_gaussian_ply(path).sh[0] * 0.28209479f + 0.5f;
    };
    const vec3<float> expected(1, 0.2f, 0);
    CHECK(length(color_of("uchar", 255, 51, 0) - expected) < 1e-6f);
    CHECK(length(color_of("float", 1, 0.2, 0) - expected) < 1e-6f);
    CHECK(length(color_of("double", 255, 51, 0) - expected) < 1e-6f);
    // Where both are given, f_dc counts.
    auto list = columns();
    list.push_back({"red", "uchar", 9});
    write_file(path, header(list, "1") + row(list));
    CHECK(read_gaussian_ply(path).sh[0] == vec3<float>(4, 5, 6));
}

TEST_CASE("what is no cloud of 3D Gaussians is named") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const auto message = [&](std::vector<Column> list) {
        write_file(path, header(list, "1") + row(list));
        try {
            (void)read_gaussian_ply(path);
        } catch (const IoError& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    auto list = columns();
    list.erase(list.begin() + 9);
    CHECK(message(list) == test::contains("2D Gaussians (2DGS)"));
    list = columns();
    list.erase(list.begin() + 8, list.end());
    list.erase(list.begin() + 6);
    CHECK(message(list) != test::contains("point cloud")); // it has scale_0
    list.resize(3);
    CHECK(message(list) == test::contains("point cloud?"));
}

TEST_CASE("the 3D filter of Mip-Splatting becomes part of scales and opacities") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    auto list = columns();
    list[6].value = 0; // an opacity of 1/2
    const double scales[3] = {0.01, 0.02, 0.5}, width = 0.03;
    for (std::size_t k = 0; k < 3; ++k) list[7 + k].value = std::log(scales[k]);
    list.push_back({"filter_3D", "float", width});
    write_file(path, header(list, "1") + row(list));
    const auto cloud = read_gaussian_ply(path);
    double share = 1;
    for (int k = 0; k < 3; ++k) {
        const double after = std::sqrt(scales[k] * scales[k] + width * width);
        CHECK(std::exp(cloud.log_scales[0][k]) == doctest::Approx(after).epsilon(1e-5));
        share *= scales[k] / after;
    }
    CHECK(sigmoid(cloud.opacity_logits[0]) == doctest::Approx(0.5 * share).epsilon(1e-5));
    list.back().value = 0;
    write_file(path, header(list, "1") + row(list));
    CHECK(read_gaussian_ply(path).opacity_logits[0] == 0);
}

TEST_CASE("positions that a float holds only roughly are told with the greatest rounding") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    auto list = columns();
    for (std::size_t k = 0; k < 3; ++k) list[k].type = "double", list[7 + k].value = std::log(0.05);
    const auto list_of = [&](double x) {
        auto other = list;
        other[0].value = x;
        return other;
    };
    list[0].value = 4512345.3, list[1].value = 12.1; // floats have steps of 0.5 and 1e-6 there
    write_file(path, header(list, "2") + row(list) + row(list_of(1.5)));
    const StillSplats splats = read_ply_splats(path);
    REQUIRE(splats.warnings.size() == 1);
    CHECK(splats.warnings[0].starts_with(path.string() + ": positions of 1 of 2 Gaussians"));
    CHECK(splats.warnings[0] == test::contains("by up to 0.2 units"));
    list[0].value = 45.123456789;
    write_file(path, header(list, "1") + row(list));
    CHECK(read_ply_splats(path).warnings.empty());
}

TEST_CASE("messages hold no raw bytes of a file") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    const std::string good = header(columns(), "1") + row(columns());
    for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
             {"property float x", "property \xff"
                                  "float x"},
             {"property float x", "property \xff"
                                  "float \xfe"
                                  "x"},
             {"property float y", "property float \xc3"
                                  "x\nproperty float \xc3"
                                  "x"},
             {"element vertex 1", "element \xff"
                                  "a x\nelement vertex 1"},
             {"element vertex 1", "element \xff"
                                  "a 1000000\nproperty float x\nelement vertex 1"},
             {"format binary", "format \xff"
                               "binary"},
             {"end_header", "\xff"
                            "end_header"}}) {
        std::string bad = good;
        write_file(path, bad.replace(bad.find(from), from.size(), to));
        try {
            (void)read_ply_splats(path);
            FAIL_CHECK("was read");
        } catch (const Error& error) {
            for (const char c : std::string(error.what())) CHECK((static_cast<unsigned char>(c) & 0x80) == 0);
        }
    }
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
