// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/splat/any_splats.hpp>

#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <string>

using namespace gsh;

TEST_CASE("a format is recognised by content, whatever the file's name") {
    const test::Temporary folder;
    const auto cloud = test::splat_cloud(10, 1);
    write_gaussian_ply(folder / "a", cloud);
    CHECK(recognise_splats(folder / "a") == SplatFormat::ply);
    CHECK(load_any_splats(folder / "a").cloud.sh_degree == 3);
    write_compressed_ply(folder / "a", cloud);
    CHECK(recognise_splats(folder / "a") == SplatFormat::compressed_ply);
    CHECK(load_any_splats(folder / "a").cloud.size() == 10);
    for (const int version : {3, 4}) {
        write_spz(folder / "a", cloud, {.version = version});
        CHECK(recognise_splats(folder / "a") == SplatFormat::spz);
        CHECK(load_any_splats(folder / "a").cloud.size() == 10);
    }
    write_gltf_splats(folder / "a", cloud);
    CHECK(recognise_splats(folder / "a") == SplatFormat::glb);
    CHECK(load_any_splats(folder / "a").cloud.size() == 10);
    write_splat(folder / "a.splat", cloud);
    CHECK(recognise_splats(folder / "a.splat") == SplatFormat::splat);
    CHECK(load_any_splats(folder / "a.splat").cloud.size() == 10);
    // A first position whose bytes are those of gzip.
    std::string bytes = read_file(folder / "a.splat");
    write_file(folder / "b.splat", bytes.replace(0, 2, "\x1f\x8b"));
    CHECK(load_any_splats(folder / "b.splat").cloud.size() == 10);
    CHECK(is_y_down_by_custom(SplatFormat::splat));
    CHECK(!is_y_down_by_custom(SplatFormat::spz));
}

TEST_CASE("other files are refused") {
    const test::Temporary folder;
    const auto path = folder / "a.dat";
    test::check_throws<IoError>([&] { (void)load_any_splats(path); }, {path.string(), "No such file"});
    write_file(path, "hello, world");
    test::check_throws<IoError>([&] { (void)load_any_splats(path); }, {path.string(), "no known format", ".spz"});
    write_file(path, "BLENDER-v279");
    test::check_throws<IoError>(
        [&] { (void)load_any_splats(path); },
        {"no known format of Gaussians, but a file of Blender (.blend); expected .ply", "as GLB"});
    write_file(path, "");
    test::check_throws<IoError>([&] { (void)load_any_splats(path); }, {path.string(), "no known format"});
    test::check_throws<IoError>([&] { (void)load_any_splats(folder / ""); }, {"directory"});
}
