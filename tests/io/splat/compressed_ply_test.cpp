// SPDX-License-Identifier: Apache-2.0
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/compressed_ply.hpp>

#include "io/damage.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

// A chunk spans up to 2 m and 4 units of log-scale; one axis has 10 bits, the others 11.
constexpr test::SplatTolerance compressed_ply_tolerance{
    .mean = 1.01e-3, .log_scale = 2.01e-3, .rotation = 6e-3, .opacity = 2e-3, .dc = 0.0135, .rest = 0.0157};

} // namespace

TEST_CASE("clouds of degrees 0 to 3 come back within the steps of the format") {
    const test::Temporary folder;
    for (const std::size_t count : {1, 255, 256, 257, 1000})
        for (int degree = 0; degree <= (count == 257 ? 3 : 1); ++degree) {
            const auto cloud = test::splat_cloud(count, degree);
            write_compressed_ply(folder / "a.compressed.ply", cloud);
            test::check_near(read_compressed_ply(folder / "a.compressed.ply").cloud, cloud, compressed_ply_tolerance);
        }
}

TEST_CASE("the file has the layout of splat-transform") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(300, 1);
    cloud.means[0] = {-1.5f, 1.25f, 1.25f}; // the extremes of the first chunk
    cloud.quats[0] = {0, 0, -1, 0};
    cloud.opacity_logits[0] = 20;
    for (std::size_t k = 0; k < 4; ++k) cloud.sh[k] = vec3<float>(k ? 0.0f : 3.0f);
    cloud.sh[3] = {0.5f, -4, 0};
    write_compressed_ply(folder / "a.ply", cloud);
    const std::string bytes = read_file(folder / "a.ply");
    for (const char* line : {"element chunk 2\nproperty float min_x\n", "property float max_b\nelement vertex 300\n",
                             "property uint packed_color\nelement sh 300\nproperty uchar f_rest_0\n"})
        CHECK(bytes == test::contains(line));
    const std::size_t begin = bytes.find("end_header\n") + 11;
    CHECK(bytes.size() == begin + 2 * 72 + 300 * 16 + 300 * 9);
    float low_x = 0;
    std::memcpy(&low_x, bytes.data() + begin, 4);
    CHECK(low_x == -1.5f);
    std::uint32_t row[4];
    std::memcpy(row, bytes.data() + begin + 2 * 72, sizeof row);
    CHECK(row[0] == (0u << 21 | 1023u << 11 | 2047u));            // at the box's corner
    CHECK(row[1] == (2u << 30 | 512u << 20 | 512u << 10 | 512u)); // y is the largest, the others are zero
    CHECK(row[3] == 0xFFFFFFFFu);
    const auto* sh = reinterpret_cast<const unsigned char*>(bytes.data()) + begin + 2 * 72 + 300 * 16;
    CHECK(sh[0] == 128);
    CHECK(sh[2] == 144);     // red of the third coefficient: (0.5 / 8 + 0.5) 256
    CHECK(sh[3 + 2] == 0);   // green
    CHECK(sh[6 + 2] == 128); // blue
}

namespace {

/// For each Gaussian of `truth`, the distance to the nearest visible one of `found`, and how many of these there are.
std::pair<std::vector<double>, std::size_t> distances(const GaussianCloud<float>& truth,
                                                      const GaussianCloud<float>& found) {
    std::vector<double> result;
    std::size_t visible = 0;
    for (std::size_t k = 0; k < found.size(); ++k) visible += found.opacity_logits[k] > -6;
    for (const vec3<float>& mean : truth.means) {
        double least = 1e30;
        for (std::size_t k = 0; k < found.size(); ++k)
            if (found.opacity_logits[k] > -6)
                least = std::min(least, length(vec3<double>(found.means[k]) - vec3<double>(mean)));
        result.push_back(least);
    }
    return {result, visible};
}

} // namespace

TEST_CASE("outliers have chunks of their own, and the others keep their places") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(1000, 1);
    const std::vector<std::size_t> outliers{5, 400, 999};
    cloud.means[5] = {5e7f, 0, 0}, cloud.means[400] = {0, -8e6f, 1e6f}, cloud.means[999] = {0, 0, 7e8f};
    for (const bool sorted : {true, false}) {
        const auto order = morton_order(cloud);
        const auto written = sorted ? reordered(cloud, Span<const std::uint32_t>(order)) : cloud;
        const SplatLosses losses = write_compressed_ply(folder / "a.ply", written, UpAxis::minus_y);
        const auto read = read_compressed_ply(folder / "a.ply").cloud;
        CHECK(losses.fillers > 0);
        CHECK(losses.fillers < (sorted ? 1024 : 1275));
        CHECK(read.size() == 1000);
        CHECK(PlyFile(folder / "a.ply").vertices().count == 1000 + losses.fillers);
        const auto [away, visible] = distances(cloud, read);
        CHECK(visible == 1000);
        for (std::size_t i = 0; i < 1000; ++i)
            if (std::find(outliers.begin(), outliers.end(), i) == outliers.end()) CHECK(away[i] < 2e-3);
        CHECK(away[5] < 5e7 / 1000);
        CHECK(losses.position_step < 3e4); // two outliers may share a chunk
    }
    // One colour far beyond white would leave the others of its chunk a few steps.
    cloud = test::splat_cloud(256, 0);
    cloud.sh[100] = vec3<float>(1000);
    CHECK(write_compressed_ply(folder / "a.ply", cloud).fillers > 0);
    const auto read = read_compressed_ply(folder / "a.ply").cloud;
    CHECK(length(read.sh[0] - cloud.sh[0]) < 0.03f);
    CHECK(length(read.sh.back() - cloud.sh.back()) < 0.03f);
}

TEST_CASE("chunks that cannot be divided well are told, and files do not grow without bound") {
    const test::Temporary folder;
    auto cloud = test::splat_cloud(4000, 0);
    for (auto& mean : cloud.means) mean = mean * 1e6f; // small Gaussians in a wide space
    const SplatLosses losses = write_compressed_ply(folder / "a.ply", cloud);
    CHECK(losses.coarse > 2000);
    CHECK(losses.position_step > 500);
    CHECK(losses.fillers <= 2024);
    cloud = test::splat_cloud(10, 1);
    cloud.log_scales[3].y = 30, cloud.sh[5].x = -4.5f;
    CHECK(write_compressed_ply(folder / "a.ply", cloud).scales == 1);
    CHECK(write_compressed_ply(folder / "a.ply", cloud).coefficients == 1);
}

TEST_CASE("an element sh without properties is none, as gsplat 1.5.3 writes it where there are no bands") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(300, 0);
    write_compressed_ply(folder / "a.ply", cloud);
    std::string bytes = read_file(folder / "a.ply");
    bytes.insert(bytes.find("end_header"), "element sh 300\n");
    write_file(folder / "a.ply", bytes);
    test::check_near(read_compressed_ply(folder / "a.ply").cloud, cloud, compressed_ply_tolerance);
}

TEST_CASE("vertical and filter are stated and heeded") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(300, 2);
    write_compressed_ply(folder / "a.ply", cloud, UpAxis::minus_y, PixelFilter{0.1, true});
    const StillSplats splats = read_compressed_ply(folder / "a.ply");
    CHECK(splats.notes.up == UpAxis::minus_y);
    REQUIRE(splats.notes.filter.has_value());
    CHECK(splats.notes.filter->dilation == 0.1);
    test::check_near(splats.cloud, cloud, compressed_ply_tolerance);
    CHECK_THROWS_AS(write_compressed_ply(folder / "a.ply", test::splat_cloud(2, 4)), ValueError);
    CHECK_THROWS_AS(write_compressed_ply(folder / "a.ply", test::splat_cloud(0, 0)), ValueError);
}

TEST_CASE("damaged files are refused before memory is allocated") {
    const test::Temporary folder;
    const auto path = folder / "a.ply";
    write_compressed_ply(path, test::splat_cloud(300, 1));
    const std::string good = read_file(path);
    const auto expect = [&](std::string_view from, std::string_view to, std::initializer_list<std::string_view> words) {
        std::string bad = good;
        const std::size_t at = bad.find(from);
        REQUIRE(at != std::string::npos);
        bad.replace(at, from.size(), to);
        write_file(path, bad);
        test::check_throws<Error>([&] { (void)read_compressed_ply(path); }, {path.string()});
        test::check_throws<Error>([&] { (void)read_compressed_ply(path); }, words);
    };
    expect("element chunk 2", "element chunk 1", {"1 chunk", "expected 2"});
    expect("element chunk 2", "element chunk 2000000000", {"2000000000 chunk"});
    expect("element vertex 300", "element vertex 90000000000000", {"vertices"});
    expect("element sh 300", "element sh 10", {"10 sh", "expected 300"});
    expect("property uchar f_rest_8\n", "", {"8 f_rest"});
    expect("property uint packed_scale", "property uint packed_scalf", {"packed_scale", "missing"});
    expect("property float max_b", "property float max_c", {"max_b", "missing"});
    for (const std::size_t missing : {std::size_t(1), std::size_t(3000), good.size() - 100}) {
        write_file(path, good.substr(0, good.size() - missing));
        test::check_throws<IoError>([&] { (void)read_compressed_ply(path); }, {path.string()});
    }
    // A table of SH behind the vertices that the file is too short for: known before rows of vertices are read, and
    // before memory is taken for its degree.
    write_compressed_ply(path, test::splat_cloud(300, 3));
    write_file(path, read_file(path).substr(0, std::filesystem::file_size(path) - 1));
    const PlyFile file(path);
    test::check_throws<IoError>([&] { file.check_present(*file.find("sh")); }, {path.string(), "300 sh", "truncated"});
    test::check_throws<IoError>([&] { (void)detail::compressed_ply_degree(file, 300); }, {"truncated"});
}

TEST_CASE("a file that is cut or changed anywhere is read or refused, never anything else") {
    const test::Temporary folder;
    write_compressed_ply(folder / "good.ply", test::splat_cloud(3, 1), UpAxis::minus_y, PixelFilter{0.1, true});
    CHECK(test::read_damaged(read_file(folder / "good.ply"), folder / "fuzz.ply", 37, 1500,
                             [](const auto& path) { (void)read_compressed_ply(path); }) > 200);
}
