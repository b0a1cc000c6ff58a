// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/spz.hpp>

#include "io/damage.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>

using namespace gsh;

namespace {

// 2^-13 m; 1/32 of log-scale; half a step of 9 bits, several times in a product; half a byte; half a bucket of 16/128,
// after rounding to 1/128.
constexpr test::SplatTolerance spz_tolerance{
    .mean = 1.23e-4, .log_scale = 0.0313, .rotation = 6e-3, .opacity = 2e-3, .dc = 0.0132, .rest = 0.0665};

std::string inflated(const std::string& bytes, std::size_t size) {
    std::string out(size, '\0');
    GzipReader(bytes, "test").read(out.data(), size);
    return out;
}

template <class Number>
void append_spz(std::string& bytes, Number number) {
    bytes.append(reinterpret_cast<const char*>(&number), sizeof number);
}

/// The header of a gzip file.
std::string spz_header(std::uint32_t version, std::uint32_t count, int degree, int flags = 0) {
    std::string bytes;
    append_spz(bytes, std::uint32_t(0x5053474e)), append_spz(bytes, version), append_spz(bytes, count);
    for (const int byte : {degree, 12, flags, 0}) append_spz(bytes, static_cast<std::uint8_t>(byte));
    return bytes;
}

} // namespace

TEST_CASE("clouds of degrees 0 to 3 come back within the steps of the format, in both versions") {
    const test::Temporary folder;
    for (const int version : {3, 4})
        for (const std::size_t count : {1, 500})
            for (int degree = 0; degree <= 3; ++degree) {
                const auto cloud = test::splat_cloud(count, degree);
                write_spz(folder / "a.spz", cloud, {.version = version});
                const StillSplats splats = read_spz(folder / "a.spz");
                test::check_near(splats.cloud, cloud, spz_tolerance);
                CHECK(splats.notes.up == UpAxis::y);
                CHECK(!splats.notes.filter.has_value());
            }
}

TEST_CASE("the bytes of version 3 are those of the format") {
    const test::Temporary folder;
    GaussianCloud<float> cloud(1, 1);
    cloud.means[0] = {1, -0.5f, 0.25f};
    cloud.log_scales[0] = {-10, -4, 5.9375f};
    cloud.opacity_logits[0] = 0;
    cloud.quats[0] = {-0.5f, 0.5f, 0.5f, 0.5f}; // any may be the largest; x comes first
    cloud.sh = {{0, 1, -1}, {0.5f, -1, 1}, {0, 0, 0}, {3, -3, 0.06f}};
    const SplatLosses losses = write_spz(folder / "a.spz", cloud, {.filter = {0.1, true}});
    CHECK(losses.coefficients == 2);
    CHECK(losses.positions + losses.scales + losses.colors == 0);
    CHECK(losses.position_step == 0);
    const std::string bytes = inflated(read_file(folder / "a.spz"), 16 + 9 + 1 + 3 + 3 + 4 + 9);
    const auto* b = reinterpret_cast<const std::uint8_t*>(bytes.data());
    CHECK(std::string_view(bytes).starts_with("NGSP"));
    const std::array<int, 8> header{1, 0, 0, 0, 1, 12, 1, 0}; // count, degree, bits, flags
    for (std::size_t i = 0; i < 8; ++i) CHECK(b[8 + i] == header[i]);
    const std::array<int, 9> position{0x00, 0x10, 0x00, 0x00, 0xF8, 0xFF, 0x00, 0x04, 0x00};
    for (std::size_t i = 0; i < 9; ++i) CHECK(b[16 + i] == position[i]);
    CHECK(b[25] == 128); // opacity 1/2
    CHECK(b[26] == 128); // 127.5 rounded
    CHECK(b[27] == 166); // 165.75
    CHECK(b[28] == 89);  // 89.25
    CHECK(b[29] == 0);
    CHECK(b[30] == 96);
    CHECK(b[31] == 255);
    std::uint32_t rotation = 0;
    std::memcpy(&rotation, b + 32, 4);
    const std::uint32_t half = 361;                                         // 511 / 2 * sqrt(2), rounded
    CHECK(rotation == (0u << 30 | half << 20 | half << 10 | (512 | half))); // x largest; y, z, then -w
    const std::array<int, 9> sh{192, 0, 255, 128, 128, 128, 255, 0, 136};
    for (std::size_t i = 0; i < 9; ++i) CHECK(b[36 + i] == sh[i]);
    const StillSplats splats = read_spz(folder / "a.spz");
    REQUIRE(splats.notes.filter.has_value());
    CHECK(splats.notes.filter->compensate_opacity);
}

TEST_CASE("version 4 has a table of frames and ends with the last of them") {
    const test::Temporary folder;
    write_spz(folder / "a.spz", test::splat_cloud(100, 0), {.version = 4});
    const std::string bytes = read_file(folder / "a.spz");
    CHECK(bytes.starts_with("NGSP"));
    CHECK(bytes[15] == 5); // no stream for SH
    std::uint64_t end = 32 + 5 * 16, sizes[2];
    for (std::size_t k = 0; k < 5; ++k) {
        std::memcpy(sizes, bytes.data() + 32 + 16 * k, 16);
        CHECK(sizes[1] == 100 * std::array{9, 1, 3, 3, 4}[k]);
        CHECK(bytes.substr(end, 4) == "\x28\xB5\x2F\xFD"); // Zstandard's magic number
        end += sizes[0];
    }
    CHECK(end == bytes.size());
}

TEST_CASE("versions 1 and 2 are read") {
    const test::Temporary folder;
    for (const std::uint32_t version : {1u, 2u}) {
        std::string bytes = spz_header(version, 1, 0);
        if (version == 1)
            for (const int half : {0x3C00, 0xB800, 0x0001}) append_spz(bytes, static_cast<std::uint16_t>(half));
        else
            for (const int byte : {0x00, 0x10, 0x00, 0x00, 0xF8, 0xFF, 0x00, 0x00, 0x00})
                append_spz(bytes, static_cast<std::uint8_t>(byte));
        for (const int byte : {255, 0, 128, 255, 96, 96, 96, 255, 128, 0})
            append_spz(bytes, static_cast<std::uint8_t>(byte));
        write_file(folder / "a.spz", gzip(bytes));
        const auto cloud = read_spz(folder / "a.spz").cloud;
        REQUIRE(cloud.size() == 1);
        CHECK(cloud.means[0].x == 1);
        CHECK(cloud.means[0].y == -0.5f);
        CHECK(cloud.means[0].z == (version == 1 ? std::ldexp(1.0f, -24) : 0));
        CHECK(cloud.opacity_logits[0] > 6);
        CHECK(cloud.log_scales[0].x == -4);
        CHECK(cloud.quats[0].x == 1);
        CHECK(cloud.quats[0].z == -1);
        CHECK(cloud.quats[0].w == 0);
    }
    std::string bytes = spz_header(1, 1, 0);
    for (int k = 0; k < 3; ++k) append_spz(bytes, std::uint16_t(0x7C00)); // infinity
    bytes.append(10, '\x40');
    write_file(folder / "a.spz", gzip(bytes));
    test::check_throws<ValueError>([&] { (void)read_spz(folder / "a.spz"); }, {"position 0", "finite"});
}

namespace {

/// A file of version 3 or 4 with extension records, and the flag that announces them.
std::string with_extensions(const std::filesystem::path& path, const GaussianCloud<float>& cloud, int version,
                            const std::string& records) {
    write_spz(path, cloud, {.version = version});
    std::string bytes = read_file(path);
    if (version == 3) {
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        bytes = inflated(bytes, 16 + cloud.size() * (20 + 3 * (basis - 1)));
        bytes[14] = 2;
        return gzip(bytes + records);
    }
    bytes[14] = 2;
    bytes[16] = static_cast<char>(32 + records.size());
    return bytes.insert(32, records);
}

std::string record(std::uint32_t type, const std::string& content) {
    std::string bytes;
    append_spz(bytes, type), append_spz(bytes, static_cast<std::uint32_t>(content.size()));
    return bytes + content;
}
std::string system_record(std::uint32_t number) {
    std::string content;
    append_spz(content, number);
    return record(0xADBE0003u, content);
}

} // namespace

TEST_CASE("Gaussians are turned from the coordinate system that a file states") {
    const test::Temporary folder;
    const auto path = folder / "a.spz";
    const auto cloud = test::splat_cloud(20, 3);
    // Where a file's x, y and z point to, as Niantic's library (21715c3, July 2026) converts files of each number to
    // RUB.
    const std::array<std::string_view, 16> systems = {"LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF", "RUF",
                                                      "LBU", "RBU", "LFU", "RFU", "LBD", "RBD", "LFD", "RFD"};
    for (const int version : {3, 4})
        for (std::uint32_t number = 1; number <= 16; ++number) {
            CAPTURE(number);
            const mat3<double> axes = *axes_of_letters(systems[number - 1]);
            auto stored = cloud;
            turn_axes(stored, transpose(axes));
            write_file(path, with_extensions(path, stored, version, system_record(number)));
            const StillSplats splats = read_spz(path);
            CHECK(splats.warnings.empty());
            // Rotations by their covariances: a mirror may turn axes round.
            auto tolerance = spz_tolerance;
            tolerance.rotation = 3, tolerance.rest = 0.12;
            test::check_near(splats.cloud, cloud, tolerance);
            for (std::size_t i = 0; i < 20; ++i) {
                const auto covariance = [&](const GaussianCloud<float>& c) {
                    const mat3<double> R = rotation_matrix(
                        normalize(quat<double>{c.quats[i].w, c.quats[i].x, c.quats[i].y, c.quats[i].z}));
                    mat3<double> S(0.0);
                    for (int k = 0; k < 3; ++k) S[k][k] = std::exp(2.0 * cloud.log_scales[i][k] + 6);
                    return R * S * transpose(R);
                };
                const mat3<double> found = covariance(splats.cloud), expected = covariance(cloud);
                for (int c = 0; c < 3; ++c) CHECK(length(found[c] - expected[c]) < 0.02);
            }
        }
    write_file(path, with_extensions(path, cloud, 4, system_record(12)));
    CHECK(read_spz(path).notes.up == UpAxis::z);
    write_file(path, with_extensions(path, cloud, 4, system_record(6)));
    CHECK(read_spz(path).notes.up == UpAxis::minus_y);
}

TEST_CASE("extensions that are not known, or say nothing, are warnings; those of the camera are not") {
    const test::Temporary folder;
    const auto path = folder / "a.spz";
    const auto cloud = test::splat_cloud(20, 1);
    const auto warnings_of = [&](const std::string& records) {
        write_file(path, with_extensions(path, cloud, 4, records));
        const StillSplats splats = read_spz(path);
        test::check_near(splats.cloud, cloud, spz_tolerance); // as RUB
        for (const std::string& warning : splats.warnings) CHECK(warning.starts_with(path.string() + ": "));
        return splats.warnings;
    };
    CHECK(warnings_of(record(0xADBE0002u, "twelve bytes")).empty());
    CHECK(warnings_of(system_record(4)).empty());
    CHECK(warnings_of(system_record(4) + system_record(6)).empty()); // the first counts
    CHECK(warnings_of(record(0x12340001u, "zzzz") + system_record(4)).at(0) == test::contains("0x12340001"));
    for (const std::uint32_t number : {0u, 17u, 4000000000u})
        CHECK(warnings_of(system_record(number)).at(0) == test::contains(std::to_string(number)));
    CHECK(warnings_of(record(0xADBE0003u, "zz")).size() == 1);
    CHECK(warnings_of(system_record(4) + "short").at(0) == test::contains("damaged"));
    std::string too_long = system_record(4);
    too_long[4] = 99;
    CHECK(warnings_of(too_long).at(0) == test::contains("damaged"));
    // Without the flag there are none.
    std::string bytes = with_extensions(path, cloud, 4, system_record(6));
    bytes[14] = 0;
    write_file(path, bytes);
    test::check_near(read_spz(path).cloud, cloud, spz_tolerance);
}

TEST_CASE("a large scene has fewer fractional bits; outliers end at the edge and are counted") {
    const test::Temporary folder;
    const auto path = folder / "a.spz";
    auto cloud = test::splat_cloud(300, 0);
    for (auto& mean : cloud.means) mean = mean * 6000.0f;
    for (auto& scale : cloud.log_scales) scale = vec3<float>(0);
    SplatLosses losses = write_spz(path, cloud);
    CHECK(losses.positions == 0);
    CHECK(losses.position_step == std::ldexp(1.0, -10)); // 6,000 m are below 2^23 / 2^10
    auto tolerance = spz_tolerance;
    tolerance.mean = std::ldexp(1.0, -11) * 1.01;
    test::check_near(read_spz(path).cloud, cloud, tolerance);

    cloud = test::splat_cloud(300, 0);
    cloud.means[3] = {5e7f, 0, 0}, cloud.means[4] = {0, -8e6f, 1e6f}; // not worth planes through all others
    losses = write_spz(path, cloud);
    CHECK(losses.positions == 2);
    CHECK(losses.position_step == 0);
    const auto read = read_spz(path).cloud;
    CHECK(read.means[3].x == doctest::Approx(2048));
    CHECK(length(read.means[5] - cloud.means[5]) < 3e-4f);

    cloud = test::splat_cloud(300, 0); // at the coordinates of a map: better in steps of 1 m than all in one corner
    for (auto& mean : cloud.means) mean = mean + vec3<float>(4500000, 5400000, 0);
    losses = write_spz(path, cloud);
    CHECK(losses.positions == 0);
    CHECK(losses.coarse == 300);
    CHECK(losses.position_step == 1);

    cloud = test::splat_cloud(300, 0);
    cloud.log_scales[0] = {8, -12, 7}, cloud.log_scales[1].x = 5.96f, cloud.log_scales[2].y = -10.02f;
    cloud.sh[7].y = 4, cloud.sh[8].x = -3.4f, cloud.sh[9].z = 3.3f;
    losses = write_spz(path, cloud);
    CHECK(losses.scales == 1);
    CHECK(losses.colors == 2);
    CHECK(losses.gaussians == 300);
}

TEST_CASE("damaged SPZ files are refused before memory is allocated") {
    const test::Temporary folder;
    const auto path = folder / "a.spz";
    const auto expect = [&](const std::string& bytes, std::initializer_list<std::string_view> words) {
        write_file(path, bytes);
        test::check_throws<IoError>([&] { (void)read_spz(path); }, {path.string()});
        test::check_throws<IoError>([&] { (void)read_spz(path); }, words);
    };
    expect("", {"truncated"});
    expect("solid cube, and so on, with enough bytes", {"not an SPZ"});
    expect(gzip("short"), {"truncated"});
    expect(gzip(std::string(64, 'x')), {"not an SPZ"});
    expect(gzip(spz_header(9, 1, 0)), {"version 9"});
    expect(gzip(spz_header(4, 1, 0)), {"version 4 within gzip"});
    expect(gzip(spz_header(3, 4000000000u, 0)), {"4000000000"});
    expect(gzip(spz_header(3, 0, 0)), {"holds no Gaussians"});
    expect(gzip(spz_header(3, 1, 5)), {"degree 5"});
    expect(gzip(spz_header(3, 100, 0)), {"truncated"});

    write_spz(path, test::splat_cloud(300, 2));
    std::string good = read_file(path);
    expect(good.substr(0, good.size() / 2), {"truncated"});
    std::string damaged = good;
    for (std::size_t i = 1000; i < 1100; ++i) damaged[i] = '\xFF';
    expect(damaged, {"damaged"});
    damaged = good;
    damaged[good.size() - 7] = static_cast<char>(damaged[good.size() - 7] ^ 1); // of the checksum
    expect(damaged, {"damaged", "checksum"});
    expect(good.substr(0, good.size() - 1), {"truncated", "checksum"});

    write_spz(path, test::splat_cloud(300, 2), {.version = 4});
    good = read_file(path);
    const auto with = [&](std::size_t at, std::uint64_t value, std::size_t size) {
        std::string bytes = good;
        std::memcpy(bytes.data() + at, &value, size);
        return bytes;
    };
    expect(good.substr(0, 31), {"truncated", "32"});
    expect(good.substr(0, good.size() - 1), {"truncated in stream 5"});
    expect(good + "x", {"1 bytes after"});
    expect(with(4, 3, 4), {"version 3 outside"});
    expect(with(8, 4000000000u, 4), {"4000000000"});
    expect(with(8, 301, 4), {"stream 0", "expected 2709"});
    expect(with(15, 5, 1), {"5 streams", "expected 6"});
    expect(with(16, 8, 4), {"table"});
    expect(with(16, 0xFFFFFFFFu, 4), {"table"});
    expect(with(32, ~0ull, 8), {"truncated in stream 0"});
    expect(with(40, ~0ull, 8), {"stream 0 claims"});
    expect(with(128 + 8, 0, 8), {"stream 0", "damaged"});
    CHECK_THROWS_AS(write_spz(path, test::splat_cloud(2, 4)), ValueError);
    CHECK_THROWS_AS(write_spz(path, test::splat_cloud(2, 1), {.version = 2}), ValueError);
    CHECK_THROWS_AS(write_spz(path, test::splat_cloud(0, 1)), ValueError);
}

TEST_CASE("memory is bounded by the file's size, at every degree") {
    const test::Temporary folder;
    const auto refused = [&](std::uint32_t count, std::uint8_t degree, std::size_t row) {
        std::string bytes = gzip(spz_header(3, count, degree) + std::string(count * row, '\x80'));
        CAPTURE(bytes.size());
        write_file(folder / "a.spz", bytes);
        test::check_throws<IoError>([&] { (void)read_spz(folder / "a.spz"); },
                                    {"a.spz", "claims " + std::to_string(count), "exhaust memory"});
    };
    refused(200'000, 4, 92);
    refused(1'000'000, 0, 20);
    // Many equal Gaussians that take no more than 64 MiB in all are read, however well they were compressed.
    write_file(folder / "a.spz", gzip(spz_header(3, 300'000, 0) + std::string(300'000 * 20, '\x80')));
    CHECK(std::filesystem::file_size(folder / "a.spz") < 10'000);
    CHECK(read_spz(folder / "a.spz").cloud.size() == 300'000);
}

TEST_CASE("what follows the Gaussians in a gzip stream is skipped, up to a bound, and checked") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(20, 1);
    write_spz(folder / "a.spz", cloud);
    const std::string good = inflated(read_file(folder / "a.spz"), 16 + 20 * (9 + 1 + 3 + 3 + 4 + 9));
    write_file(folder / "a.spz", gzip(good + std::string(100000, 'z')));
    test::check_near(read_spz(folder / "a.spz").cloud, cloud, spz_tolerance);
    const std::string stream = gzip(std::string(100000, 'z'));
    GzipReader(stream, "test").finish();
    test::check_throws<IoError>([&] { GzipReader(stream, "test").finish(99999); }, {"test", "99999 bytes"});
}

TEST_CASE("a frame of Zstandard with another checksum is refused") {
    const std::string text(1000, 'z');
    ZSTD_CCtx* const context = ZSTD_createCCtx();
    ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
    std::string frame(ZSTD_compressBound(text.size()), '\0');
    frame.resize(ZSTD_compress2(context, frame.data(), frame.size(), text.data(), text.size()));
    ZSTD_freeCCtx(context);
    CHECK(zstd_decompressed(frame, 1000, "test") == text);
    frame.back() = static_cast<char>(frame.back() ^ 1);
    test::check_throws<IoError>([&] { (void)zstd_decompressed(frame, 1000, "test"); }, {"test", "damaged", "checksum"});
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    for (const int version : {3, 4}) {
        write_spz(folder / "good.spz", test::splat_cloud(5, 1), {.version = version});
        CHECK(test::read_damaged(read_file(folder / "good.spz"), folder / "fuzz.spz", 7, 1000,
                                 [](const auto& path) { (void)read_spz(path); }) > 200);
    }
}
