// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/archive.hpp>

#include "io/small_body.hpp"
#include "io/temporary.hpp"

#include <gsh/math/quat.hpp>
#include <gsh/math/vec.hpp>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

using namespace gsh;

namespace {
template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}
} // namespace

TEST_CASE("numbers come back bit for bit, whatever they are") {
    const test::Temporary folder;
    test::Rng rng(3);
    std::vector<float> floats(999);
    for (auto& value : floats) {
        const auto bits = static_cast<std::uint32_t>(rng.bits()); // NaN, infinities and denormals among them
        std::memcpy(&value, &bits, 4);
    }
    floats[0] = std::numeric_limits<float>::quiet_NaN(), floats[1] = -0.0f,
    floats[2] = std::numeric_limits<float>::denorm_min();
    std::vector<double> doubles(100);
    for (auto& value : doubles) value = rng.normal();
    const std::vector<std::uint64_t> wide{0, ~std::uint64_t(0), 1ull << 63};
    const std::vector<std::uint8_t> bytes{1, 2, 255};
    const std::vector<vec3<float>> vectors{{1, 2, 3}, {4, 5, 6}};
    const std::vector<quat<double>> quats{{1, 2, 3, 4}};
    {
        ArchiveWriter file(folder / "a.gsh", "avatar", 3);
        file.add("floats", floats, {3, 333});
        file.add("doubles", doubles);
        file.add("wide", wide);
        file.add("bytes", bytes);
        file.add_rows<float>("vectors", vectors);
        file.add_rows<double>("quats", quats);
        file.add_rows<float>("none", std::vector<vec3<float>>());
        file.add("step", std::int64_t(-17));
        file.add_text("note", "größe");
        file.commit();
    }
    const ArchiveReader file(folder / "a.gsh", "avatar", 3);
    CHECK(file.read<float>("floats").shape == Shape{3, 333});
    CHECK(same_bits(file.read<float>("floats").data, floats));
    CHECK(same_bits(file.read<double>("doubles").data, doubles));
    CHECK(same_bits(file.read<std::uint64_t>("wide").data, wide));
    CHECK(same_bits(file.read<std::uint8_t>("bytes").data, bytes));
    CHECK(file.read_rows<float, vec3<float>>("vectors") == vectors);
    CHECK(same_bits(file.read_rows<double, quat<double>>("quats"), quats));
    CHECK(file.read_rows<float, vec3<float>>("none").empty());
    CHECK(file.read_number<std::int64_t>("step") == -17);
    CHECK(file.read_text("note") == "größe");
    CHECK(file.has("note"));
    CHECK(!file.has("nothing"));
    CHECK(archive_kind(folder / "a.gsh") == "avatar");

    test::check_throws<IoError>([&] { (void)file.read<double>("floats"); }, {"a.gsh", "floats", "<f4", "<f8"});
    test::check_throws<IoError>([&] { (void)file.read<std::int64_t>("wide"); }, {"a.gsh", "wide", "<u8", "<i8"});
    test::check_throws<IoError>([&] { (void)file.read<float>("nothing"); }, {"a.gsh", "nothing is missing"});
    test::check_throws<ShapeError>([&] { (void)file.read_rows<double, vec3<double>>("quats"); },
                                   {"a.gsh", "quats", "(1, 4)", "(*, 3)"});
}

TEST_CASE("other kinds, other versions and other files are told apart") {
    const test::Temporary folder;
    const auto path = folder / "a.gsh";
    {
        ArchiveWriter file(path, "avatar", 3);
        file.commit();
    }
    test::check_throws<IoError>([&] { ArchiveReader(path, "avatar", 2); },
                                {path.string(), "avatar 3", "avatar 2", "version"});
    test::check_throws<IoError>([&] { ArchiveReader(path, "avatar", 33); }, {path.string(), "avatar 3", "avatar 33"});
    test::check_throws<IoError>([&] { ArchiveReader(path, "checkpoint", 3); },
                                {path.string(), "avatar 3", "checkpoint"});
    {
        NpzWriter file(path);
        file.add("x", 1);
        file.commit();
    }
    test::check_throws<IoError>([&] { ArchiveReader(path, "avatar", 3); }, {path.string(), "not a gsh file"});
    CHECK(archive_kind(path).empty());
    {
        NpzWriter file(path);
        file.add("gsh_format", 3);
        file.commit();
    }
    test::check_throws<IoError>([&] { ArchiveReader(path, "avatar", 3); }, {path.string(), "not a gsh file"});
    write_file(path, "ply");
    test::check_throws<IoError>([&] { ArchiveReader(path, "avatar", 3); }, {path.string(), "not an .npz"});
    test::check_throws<IoError>([&] { ArchiveReader(folder / "b.gsh", "avatar", 3); }, {"b.gsh", "No such file"});
}

TEST_CASE("a body model travels inside an archive") {
    const test::Temporary folder;
    const BodyModel model = test::small_body(4, 2, 1, true);
    {
        ArchiveWriter file(folder / "a.gsh", "avatar", 1);
        add_body_model(file, model, "body_");
        file.commit();
    }
    const ArchiveReader file(folder / "a.gsh", "avatar", 1);
    CHECK(file.has("body_v_template"));
    const BodyModel read = read_body_model(file.file(), "body_");
    CHECK(read.v_template == model.v_template);
    CHECK(read.weights == model.weights);
    CHECK(read.exprdirs == model.exprdirs);
    CHECK(read.hands_mean_right == model.hands_mean_right);
    test::check_throws<IoError>([&] { (void)read_body_model(file.file(), "other_"); },
                                {"a.gsh", "other_v_template is missing"});
}
