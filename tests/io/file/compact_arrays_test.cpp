// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/compact_arrays.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"

#include <gsh/io/file/input_file.hpp>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

TEST_CASE("a sparse array comes back bit for bit") {
    const test::Temporary folder;
    std::vector<double> numbers(600, 0.0);
    numbers[0] = -0.0, numbers[7] = 1e-300, numbers[599] = -2.5;
    NpzWriter writer(folder / "a.npz");
    add_sparse(writer, "few", numbers, {20, 10, 3});
    const std::vector<double> many(4, 1.0);
    add_sparse(writer, "many", many, {2, 2});
    add_sparse(writer, "none", std::vector<double>(9, 0.0), {3, 3});
    writer.commit();
    const NpzReader file(folder / "a.npz");
    CHECK(!file.has("few"));
    CHECK(file.has("many")); // dense
    for (const char* key : {"few", "many", "none"}) CHECK(has_numbers(file, key));
    CHECK(!has_numbers(file, "other"));
    const auto few = read_numbers<double>(file, "few", {20, -1, 3});
    CHECK(few.data == numbers);
    CHECK(std::signbit(few.data[0]));
    CHECK(read_numbers<double>(file, "many", {-1, 2}).data == many);
    CHECK(read_numbers<double>(file, "none").shape == Shape{3, 3});
    test::check_throws<ShapeError>([&] { (void)read_numbers<double>(file, "few", {20, 30}); }, {"few", "(20, 10, 3)"});
}

TEST_CASE("a quantised array comes back within half a step") {
    const test::Temporary folder;
    test::Rng rng(1);
    std::vector<double> numbers = rng.numbers(300, -2, 5);
    for (std::size_t i = 2; i < 300; i += 3) numbers[i] = 0.125; // a column without extent
    for (std::size_t i = 1; i < 300; i += 3) numbers[i] *= 1e-3; // steps belong to columns
    const std::vector<double> directions{0, 1, 0, -0.5, 0, 0.001};
    NpzWriter writer(folder / "a.npz", Packing::deflated);
    add_quantised<std::int16_t, double>(writer, "fine", numbers, 3);
    add_quantised<std::int8_t, double>(writer, "coarse", numbers, 3);
    add_quantised<std::int8_t, double>(writer, "directions", directions, 1, true);
    add_quantised<std::int8_t, double>(writer, "empty", std::vector<double>(), 3);
    writer.commit();
    const NpzReader file(folder / "a.npz");
    const auto fine = read_numbers<double>(file, "fine", {100, 3}), coarse = read_numbers<double>(file, "coarse");
    for (std::size_t i = 0; i < 300; ++i) {
        const double reach = i % 3 == 0 ? 3.5 : i % 3 == 1 ? 3.5e-3 : 0;
        CHECK(std::abs(fine[i] - numbers[i]) <= reach / 32767 + 1e-6);
        CHECK(std::abs(coarse[i] - numbers[i]) <= reach / 127 + 1e-6);
    }
    const auto d = read_numbers<double>(file, "directions", {1, 3, 2}); // rows were joined
    CHECK(d.data[0] == 0);
    CHECK(d.data[1] == doctest::Approx(1));
    CHECK(d.data[3] == doctest::Approx(-0.5).epsilon(0.01));
    CHECK(d.data[5] == 0);
    CHECK(read_numbers<double>(file, "empty").size() == 0);
}

TEST_CASE("deflated archives are smaller, equal each time, and read as others") {
    const test::Temporary folder;
    const std::vector<double> numbers(5000, 1.5);
    for (const char* name : {"a.npz", "b.npz"}) {
        NpzWriter writer(folder / name, Packing::deflated);
        writer.add("x", numbers);
        writer.commit();
    }
    CHECK(read_file(folder / "a.npz") == read_file(folder / "b.npz"));
    CHECK(std::filesystem::file_size(folder / "a.npz") < 2000);
    CHECK(NpzReader(folder / "a.npz").read<double>("x").data == numbers);
}

TEST_CASE("parts that do not fit each other are refused") {
    const test::Temporary folder;
    const auto refuse = [&](const auto& fill, std::initializer_list<std::string_view> words) {
        NpzWriter writer(folder / "a.npz");
        fill(writer);
        writer.commit();
        const NpzReader file(folder / "a.npz");
        test::check_throws<Error>([&] { (void)read_numbers<double>(file, "x"); }, words);
    };
    const auto sparse = [](std::vector<std::uint32_t> indices, std::vector<double> values,
                           std::vector<std::int64_t> shape) {
        return [=](NpzWriter& file) {
            file.add("x.indices", indices), file.add("x.values", values), file.add("x.shape", shape);
        };
    };
    refuse(sparse({4}, {1}, {2, 2}), {"a.npz", "x.indices", "4"});
    refuse(sparse({1}, {1, 2}, {2, 2}), {"values"});
    refuse(sparse({1}, {1}, {2, -2}), {"x.shape", "-2"});
    refuse(sparse({1}, {1}, {1 << 20, 1 << 20}), {"1 GiB"});
    refuse(sparse({1}, {1}, {std::int64_t(1) << 62}), {"x.shape"});
    refuse(sparse({1}, {1}, {1 << 13, 1 << 13}), {"x inflates", "536870912"});
    const auto quantised = [](const Shape& shape, std::vector<float> offset, std::vector<float> step) {
        return [=](NpzWriter& file) {
            file.add("x.q", std::vector<std::int8_t>(detail::element_count(shape)), shape);
            file.add("x.offset", offset), file.add("x.step", step);
        };
    };
    refuse(quantised({2, 3}, {0, 0, 0}, {1, 1, 1}), {"x.q", "(2, 3)"});
    refuse(quantised({2, 3}, {0, 0}, {1}), {"step"});
    refuse(quantised({1, 3}, {NAN}, {1}), {"offset"});
    refuse(quantised({6}, {0}, {1}), {"x.q"});
    refuse([](NpzWriter& file) { file.add("y", 1.0); }, {"x", "missing"});

    // Bytes that deflate to next to nothing become doubles.
    NpzWriter writer(folder / "b.npz", Packing::deflated);
    quantised({1, 9000000}, {0}, {1})(writer);
    writer.commit();
    const NpzReader file(folder / "b.npz");
    test::check_throws<IoError>([&] { (void)read_numbers<double>(file, "x"); }, {"b.npz: x inflates", "72000000"});
}
