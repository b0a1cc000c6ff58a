// SPDX-License-Identifier: Apache-2.0
/// @file  Files of OpenCV's FileStorage, as the versions 4.14 and 5.0 write them.

#include "io/sample_files.hpp"
#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/io/file/opencv_yaml.hpp>

#include <chrono>
#include <string>
#include <vector>

using namespace gsh;
using Doubles = std::vector<double>;

namespace {

struct Yaml {
    test::Temporary folder;

    [[nodiscard]] OpenCvYaml read(const std::string& text) const {
        test::write_text(folder / "a.yml", text);
        return OpenCvYaml(folder / "a.yml");
    }
};

} // namespace

TEST_CASE_FIXTURE(Yaml, "arrays of one dimension: OpenCV 4 gives them rows and cols, OpenCV 5 sizes") {
    const Doubles five{0.10000000000000001, -0.05, 0, 0, 0.33333333333333331};
    const OpenCvYaml four = read(R"(%YAML:1.0
---
v_1: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.10000000000000001, -0.050000000000000003, 0., 0.,
       0.33333333333333331 ]
)");
    CHECK(four.matrix("v_1", 5) == five);
    const OpenCvYaml fifth = read(R"(%YAML 1.2
---
v_1: !!opencv-nd-matrix
   sizes: [ 5 ]
   dt: d
   data: [ 0.10000000000000001, -0.050000000000000003, 0., 0.,
       0.33333333333333331 ]
K_1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: f
   data: [ 1000., 0., 512., 0., 1000., 384., 0., 0., 1. ]
i_1: !!opencv-nd-matrix
   sizes: [ 2 ]
   dt: i
   data: [ 3, -4 ]
t_1: hello world
)");
    CHECK(fifth.matrix("v_1", 5) == five);
    CHECK(fifth.matrix("K_1", 9)[2] == 512);
    CHECK(fifth.matrix("i_1", 2) == Doubles{3, -4});
}

TEST_CASE_FIXTURE(Yaml, "several dimensions and channels, fields in any order, plain lists") {
    const OpenCvYaml file = read(R"(%YAML 1.2
---
# made by hand: with a colon
nd: !!opencv-nd-matrix   # a comment
   data: [ 1., 2.,
           3., 4., 5., 6. ]
   dt: "d"
   sizes: [ 1,
            2, 3 ]
channels: !!opencv-matrix
   rows: 1
   cols: 2
   dt: "3f"
   data: [ 1., 2., 3., 4., 5., 6. ]
flow: [ 1, 2, 3 ]
nested: [ [ 1, 2 ], [ 3, 4 ] ]
block:
   - 1.5
   - -2.
)");
    const Doubles six{1, 2, 3, 4, 5, 6};
    CHECK(file.matrix("nd", 6) == six);
    CHECK(file.matrix("channels", 0) == six);
    CHECK(file.matrix("flow", 3) == Doubles{1, 2, 3});
    CHECK(file.matrix("nested", 4) == Doubles{1, 2, 3, 4});
    CHECK(file.matrix("block", 2) == Doubles{1.5, -2});
    CHECK(!file.has("# made by hand"));
}

TEST_CASE_FIXTURE(Yaml, "names in all forms, ends of lines of Windows") {
    const std::vector<std::string> names{"01", "2", "cam 3", "a:b"};
    CHECK(read("%YAML:1.0\n---\nnames:\n   - \"01\"\n   - \"2\"\n   - cam 3\n   - \"a:b\"\n").texts("names") == names);
    CHECK(read("names: [ \"01\", '2', cam 3, \"a:b\" ]\n").texts("names") == names);
    CHECK(read("names:\r\r\n  - \"01\"\r\r\n  - \"2\"\r\r\nH_01: 60\r\r\n").texts("names") ==
          std::vector<std::string>{"01", "2"});
    CHECK(read("H_01: 60\r\r\n").number("H_01") == 60);
    // EasyMocap's first writer with OpenCV 5.0
    CHECK(read("names: \"[\"\nnone: \"01\"\nnone: \"2\"\nnone: \"]\"\n").texts("names") ==
          std::vector<std::string>{"01", "2"});
}

TEST_CASE_FIXTURE(Yaml, "what does not fit is refused with file and key") {
    const auto refuse = [&](const std::string& text, std::initializer_list<std::string_view> words) {
        test::check_throws<Error>([&] { (void)read(text).matrix("v", 0); }, words);
    };
    const std::string head = "%YAML 1.2\n---\nv: !!opencv-nd-matrix\n";
    refuse(head + "   sizes: [ 4 ]\n   dt: d\n   data: [ 1., 2. ]\n",
           {"a.yml: v", "is 4 by its size, but has 2 numbers"});
    refuse("v: !!opencv-matrix\n   rows: 1\n   cols: 2\n   dt: \"3f\"\n   data: [ 1., 2. ]\n",
           {"v is 1 x 2 of 3 channels by its size, but has 2 numbers"});
    refuse(head + "   sizes: [ 1 ]\n   dt: d\n   data: [ .Nan ]\n", {"v holds '.Nan', expected finite numbers"});
    refuse(head + "   sizes: [ 1 ]\n   dt: d\n", {"v has no data"});
    refuse(head + "   dt: d\n   data: !!binary |\n      MWQgICAgICAgICAg\n", {"v holds its data in base64"});
    refuse("v: 3\n", {"v has no data"});
    refuse("v: [1]\nv: [2]\n", {"v occurs twice"});
    refuse("w: [1]\n", {"v is missing"});
    refuse("PK\x03\x04 no text\n", {"a.yml: is a zip archive"});
    refuse("\x01\x02 no text\n", {"a.yml: '?? no text' is not KEY: VALUE"});
}

TEST_CASE_FIXTURE(Yaml, "blanks without end are read in time, and sizes without end are refused in short") {
    const std::string blanks(1 << 20, ' ');
    const auto begin = std::chrono::steady_clock::now();
    CHECK(read("names: [" + blanks + "\"01\"," + blanks + "02" + blanks + "]\n").texts("names") ==
          std::vector<std::string>{"01", "02"});
    CHECK(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() < 5);
    std::string sizes;
    for (int k = 0; k < 1000; ++k) sizes += "1 ";
    test::check_throws<ShapeError>(
        [&] { (void)read("a: !!opencv-nd-matrix\n  sizes: [ " + sizes + "]\n  data: [ 1, 2 ]\n").matrix("a", 0); },
        {"a.yml: a has 1000 sizes"});
}
