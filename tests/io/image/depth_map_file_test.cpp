// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/image/depth_map_file.hpp>

#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// A file of 2 x 3 depths.
template <class T>
void write_depths(const std::filesystem::path& path, const std::vector<T>& depths) {
    write_npy<T>(path, depths, {2, 3});
}

} // namespace

TEST_CASE("depths are kept, and NaN, infinity, 0 and points behind the camera are invalid") {
    const test::Temporary folder;
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
    write_depths<double>(folder / "depth.npy", {1.25, nan, 0, -2, infinity, 0.1});
    const PriorMap map = read_depth_map(folder / "depth.npy", false);
    CHECK(map.values.channels == 1);
    CHECK(map.values.height == 2);
    CHECK(map.values.width == 3);
    CHECK(map.mask.data == std::vector<std::uint8_t>{1, 0, 0, 0, 0, 1});
    CHECK(map.values.data == std::vector<double>{1.25, 0, 0, 0, 0, 0.1});

    const PriorMap orthographic = read_depth_map(folder / "depth.npy", true);
    CHECK(orthographic.mask.data == std::vector<std::uint8_t>{1, 0, 0, 1, 0, 1});
    CHECK(orthographic.values.at(0, 1, 0) == -2);
}

TEST_CASE("depths of 16, 32 and 64 bits give the same map") {
    const test::Temporary folder;
    write_depths<double>(folder / "double.npy", {1, 2, 3, 4, 5, 6});
    write_depths<float>(folder / "float.npy", {1, 2, 3, 4, 5, 6});
    const std::vector<std::uint16_t> halves{0x3C00, 0x4000, 0x4200, 0x4400, 0x4500, 0x4600};
    const std::string bytes(reinterpret_cast<const char*>(halves.data()), 2 * halves.size());
    write_file(folder / "half.npy", test::npy_bytes("<f2", "(2, 3)", bytes));
    for (const char* name : {"double.npy", "float.npy", "half.npy"})
        CHECK(read_depth_map(folder / name, false).values.data == std::vector<double>{1, 2, 3, 4, 5, 6});
}

TEST_CASE("what is no depth map is refused by the file's name") {
    const test::Temporary folder;
    write_npy<float>(folder / "row.npy", std::vector<float>(6), {6});
    write_npy<std::int32_t>(folder / "whole.npy", std::vector<std::int32_t>(6), {2, 3});
    write_file(folder / "depth.png", "x");
    const auto refuse = [&](const char* name) { return [&, name] { (void)read_depth_map(folder / name, false); }; };
    test::check_throws<ShapeError>(refuse("row.npy"), {"row.npy", "(6,)", "(height, width)"});
    test::check_throws<IoError>(refuse("whole.npy"), {"whole.npy", "<i4"});
    test::check_throws<ValueError>(refuse("depth.png"), {"depth.png", ".npy"});
    test::check_throws<IoError>(refuse("none.npy"), {"none.npy"});
}
