// SPDX-License-Identifier: Apache-2.0
/// The whole table of splat formats: each row writes, is recognised, reads back, and keeps what it promises.
#include <gsh/io/splat/any_splats.hpp>

#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>
#include <regex>
#include <set>
#include <string>
#include <string_view>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

const fs::path root = GSH_SOURCE_DIR;

/// A file with y up, as a program reads it: a vertical that is not stated is that of the custom.
GaussianCloud<float> upright(const fs::path& path, const SplatFormatTraits& row) {
    StillSplats splats = load_any_splats(path);
    CHECK(splats.warnings.empty());
    if (!splats.notes.up && row.is_y_down) restate_up(splats, UpAxis::minus_y);
    return splats.cloud;
}

/// The line of a page that begins with this text.
std::string line_of(const std::string& page, const std::string& begin) {
    const std::size_t at = page.find("\n" + begin);
    REQUIRE(at != page.npos);
    return page.substr(at + 1, page.find('\n', at + 1) - at - 1);
}

} // namespace

TEST_CASE("the table has all formats, in the order of messages") {
    CHECK(splat_endings(SplatEndings::read, " or ") == ".ply, .compressed.ply, .spz, .splat, .glb or .gltf");
    CHECK(splat_endings(SplatEndings::written) == ".ply, .compressed.ply, .spz, .splat, .glb, .usda");
    CHECK(splat_endings(SplatEndings::y_down, " and ") == ".ply, .compressed.ply and .splat");
    CHECK(traits_of(SplatFormat::usda).ending == ".usda");
}

TEST_CASE("the table has every function that reads or writes a file of Gaussians") {
    static const std::regex reader("StillSplats (read_\\w+)\\(const InputFile& input\\b"),
        writer("(?:void|SplatLosses) (write_\\w+)\\(const std::filesystem::path& path, (?:const )?GaussianCloud<");
    const std::string table = read_file(root / "include/gsh/io/splat/splat_formats.hpp");
    std::size_t found = 0;
    for (const auto& entry : fs::directory_iterator(root / "include/gsh/io/splat")) {
        if (entry.path().filename() == "splat_formats.hpp") continue;
        const std::string text = read_file(entry.path());
        for (const std::regex* function : {&reader, &writer})
            for (std::sregex_iterator it(text.begin(), text.end(), *function), end; it != end; ++it) {
                const std::string name = (*it)[1].str();
                INFO(name);
                CHECK(std::regex_search(table, std::regex("\\b" + name + "\\b")));
                ++found;
            }
    }
    CHECK(found >= 10);
}

TEST_CASE("the page of exports names every ending") {
    const std::string page = read_file(root / "docs/exports.md");
    const std::string read = line_of(page, "| `INPUT` |"), written = line_of(page, "| `--to FILE` |"),
                      lost = page.substr(page.find("\n## What is lost"));
    for (const SplatFormatTraits& row : splat_formats) {
        const std::string ending = "`" + std::string(row.ending) + "`", other = "`" + std::string(row.other_ending);
        INFO(ending);
        if (row.read) CHECK(read.find(ending) != read.npos);
        if (row.read) CHECK(read.find(other) != read.npos);
        if (row.write) CHECK(written.find(ending) != written.npos);
        if (row.write) CHECK(lost.find(ending) != lost.npos);
    }
}

TEST_CASE("each format reads back what it writes, by its ending and by its content") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(300, 4); // more than a chunk of a compressed PLY
    const test::SplatTolerance near{
        .mean = 2e-3, .log_scale = 0.04, .rotation = 0.05, .opacity = 0.01, .dc = 0.02, .rest = 0.07};
    for (const SplatFormatTraits& row : splat_formats) {
        INFO(std::string(row.name));
        CHECK((row.read || row.write));
        if (!row.write) continue;
        for (const int version : std::set<int>(row.versions.begin(), row.versions.end())) {
            INFO(version);
            const fs::path path = folder / ("a" + std::string(row.ending));
            const SplatLosses losses = save_splats(path, cloud, {.version = version});
            CHECK(losses.gaussians == cloud.size());
            CHECK(losses.dropped_degree == (row.sh_degree < 4 ? 4 : 0));
            if (!row.read) {
                test::check_throws<IoError>([&] { (void)load_any_splats(path); }, {path.string(), "no known format"});
                continue;
            }
            CHECK(recognise_splats(path) == row.format);
            const auto found = upright(path, row);
            check_writable("found", found); // all numbers are finite
            CHECK(found.sh_degree == row.sh_degree);
            test::check_near(found, with_bands_up_to(cloud, row.sh_degree), near);

            const bool is_spz = row.format == SplatFormat::spz;
            for (const fs::path& other : {folder / "a", folder / (is_spz ? "a.glb" : "a.spz")}) {
                fs::copy_file(path, other, fs::copy_options::overwrite_existing);
                if (row.has_signature()) {
                    CHECK(recognise_splats(other) == row.format);
                    CHECK(upright(other, row).means == found.means);
                } else {
                    test::check_throws<IoError>([&] { (void)load_any_splats(other); }, {other.string()});
                }
            }
        }
    }
}

TEST_CASE("a file's vertical is the one that is given, else that of the custom") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(3, 0);
    for (const SplatFormatTraits& row : splat_formats) {
        INFO(std::string(row.name));
        if (!row.write) continue;
        const fs::path path = folder / ("a" + std::string(row.ending));
        save_splats(path, cloud, {.up = UpAxis::y});
        if (row.is_y_down) {
            CHECK(std::abs(load_any_splats(path).cloud.means[1].y - cloud.means[1].y) < 2e-3);
        } else {
            test::check_throws<ValueError>([&] { save_splats(path, cloud, {.up = UpAxis::minus_y}); },
                                           {path.string(), "has y up", ".ply, .compressed.ply and .splat"});
        }
        test::check_throws<ValueError>([&] { save_splats(path, cloud, {.version = 99}); },
                                       {path.string(), row.name, "is not written in version 99"});
    }
}

TEST_CASE("numbers that no Gaussian has are refused by each format, and nothing is written") {
    const test::Temporary folder;
    const float none = std::numeric_limits<float>::quiet_NaN();
    for (const SplatFormatTraits& row : splat_formats) {
        INFO(std::string(row.name));
        if (!row.write) continue;
        const auto refused = [&](const std::function<void(GaussianCloud<float>&)>& change) {
            auto cloud = test::splat_cloud(4, 1);
            change(cloud);
            test::check_throws<ValueError>([&] { save_splats(folder / ("a" + std::string(row.ending)), cloud); },
                                           {"Gaussian 2", "not finite"});
        };
        refused([&](GaussianCloud<float>& cloud) { cloud.means[2].y = none; });
        refused([&](GaussianCloud<float>& cloud) { cloud.log_scales[2].x = 45; }); // the variance is not finite
        refused([&](GaussianCloud<float>& cloud) { cloud.quats[2] = {0, 0, 0, 0}; });
        refused([&](GaussianCloud<float>& cloud) { cloud.opacity_logits[2] = none; });
        refused([&](GaussianCloud<float>& cloud) { cloud.sh[8].z = none; });
    }
    CHECK(folder.file_count() == 0);
}

TEST_CASE("the longest ending chooses the format, and an unknown one is refused") {
    const test::Temporary folder;
    CHECK(written_splat_format("a.compressed.ply")->format == SplatFormat::compressed_ply);
    CHECK(written_splat_format("folder.spz/a.b.ply")->format == SplatFormat::ply);
    const auto cloud = test::splat_cloud(3, 1);
    for (const char* name : {"a.obj", "a.gltf", "a", ".ply", "a.PLY"}) {
        INFO(std::string(name));
        CHECK(written_splat_format(name) == nullptr);
        test::check_throws<ValueError>([&] { save_splats(folder / name, cloud); },
                                       {(folder / name).string(), "unknown ending", ".splat, .glb or .usda"});
    }
    auto torn = cloud;
    torn.sh.pop_back();
    test::check_throws<ShapeError>([&] { save_splats(folder / "a.ply", torn); }, {"save_splats"});
    CHECK(folder.file_count() == 0);
}
