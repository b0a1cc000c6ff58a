// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/file/input_file.hpp>

#include "io/bvh_files.hpp"
#include "io/gltf_files.hpp"
#include "io/small_body.hpp"
#include "io/splat_clouds.hpp"
#include "io/temporary.hpp"
#include "support/sample_rig.hpp"
#include "support/tube_avatar.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/splat/any_splats.hpp>

#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

using namespace gsh;
using test::check_throws;

namespace {

/// Calls read with a file, and with its bytes in memory under the same name. The results must be equal.
template <class Read, class Same>
void check_same(const std::filesystem::path& path, const Read& read, const Same& same) {
    CAPTURE(path.string());
    const std::string bytes = read_file(path);
    std::filesystem::rename(path, path.string() + ".away"); // so that the bytes alone can be read
    const auto from_memory = read(InputFile::in_memory(path, bytes));
    std::filesystem::rename(path.string() + ".away", path);
    CHECK(same(read(path), from_memory));
}

} // namespace

TEST_CASE("a file and its bytes in memory are read alike") {
    const test::Temporary folder;
    const auto equal = [](const auto& a, const auto& b) { return a == b; };
    const BodyModel body = test::small_body();

    write_npy<float>(folder / "a.npy", std::vector<float>{1, 2, 3}, {3});
    check_same(folder / "a.npy", [](const InputFile& file) { return read_npy<float>(file).data; }, equal);
    write_png(folder / "a.png", PixelImage(3, 4, 5));
    check_same(folder / "a.png", [](const InputFile& file) { return read_image(file).data; }, equal);
    save_body_model(folder / "body.npz", body);
    check_same(folder / "body.npz", [](const InputFile& file) { return load_body_model(file).weights; }, equal);
    save_motion(folder / "motion.npz", test::still_motion(body, 3));
    check_same(
        folder / "motion.npz", [&](const InputFile& file) { return load_any_motion(file, body).timestamps; }, equal);
    save_avatar(folder / "a.gsh", test::tube_avatar(3));
    check_same(
        folder / "a.gsh", [](const InputFile& file) { return load_avatar(file).gaussians.opacity_logits; }, equal);
    const auto cloud = test::splat_cloud(20, 1);
    for (const char* name : {"a.ply", "a.compressed.ply", "a.spz", "a.splat", "a.glb"}) {
        save_splats(folder / name, cloud);
        check_same(
            folder / name, [](const InputFile& file) { return load_any_splats(file).cloud.opacity_logits; }, equal);
    }
    const auto rig = test::sample_rig({.spine = 1, .toes = false, .frames = 2});
    write_file(folder / "a.bvh", test::bvh_text(rig));
    check_same(folder / "a.bvh", [](const InputFile& file) { return load_bvh(file).names; }, equal);
    write_file(folder / "motion.glb", test::gltf_of(rig, {.skin = true}).glb());
    check_same(folder / "motion.glb", [](const InputFile& file) { return load_gltf_motion(file).names; }, equal);
}

TEST_CASE("messages about bytes in memory begin with their name") {
    const std::string bytes = "neither one nor the other";
    const InputFile file = InputFile::in_memory("pack/a.npz", bytes);
    check_throws<IoError>([&] { NpzReader reader(file); }, {"pack/a.npz: ", "not an .npz archive"});
    check_throws<IoError>([&] { (void)read_cameras(file); }, {"pack/a.npz: ", "is not JSON"});
    check_throws<IoError>([&] { (void)load_any_splats(file); }, {"pack/a.npz: ", "in no known format of Gaussians"});
    check_throws<IoError>([&] { (void)read_file(file, 5); }, {"pack/a.npz: ", "larger than 5 bytes"});
    const std::string pickle("\x80\x04\x95.", 4);
    check_throws<IoError>([&] { NpzReader reader(InputFile::in_memory("a.npz", pickle)); }, {"a.npz: ", "pickle"});
    check_throws<IoError>([&] { NpzReader reader(InputFile::in_memory("a.npz", "")); }, {"a.npz: ", "is empty"});
}

TEST_CASE("a stream reads from any place, in memory as from the disk") {
    const test::Temporary folder;
    const std::string bytes = "0123456789";
    write_file(folder / "a", bytes);
    for (const InputFile& file : {InputFile(folder / "a"), InputFile::in_memory("a", bytes)}) {
        InputStream stream(file);
        CHECK(stream.size() == 10);
        char read[4] = {};
        CHECK(stream.read(read, 3) == 3);
        CHECK(std::string(read) == "012");
        CHECK(stream.next() == '3');
        CHECK(stream.position() == 4);
        CHECK(stream.seek(8));
        CHECK(stream.read(read, 3) == 2);
        CHECK(stream.next() == EOF);
        CHECK(stream.seek(100)); // as with a file, the next read finds nothing
        CHECK(stream.read(read, 3) == 0);
        CHECK(stream.next() == EOF);
    }
}

TEST_CASE("a folder, a missing file and a pipe are told apart") {
    const test::Temporary folder;
    CHECK(InputFile(folder / "").is_folder());
    CHECK(!InputFile::in_memory(folder / "", "").is_folder());
    check_throws<IoError>([&] { InputStream stream(folder / ""); }, {"is a directory, expected a file"});
    check_throws<IoError>([&] { InputStream stream(folder / "none"); }, {"none: cannot be opened: No such file"});

    const std::string pipe = (folder / "pipe").string();
    REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
    const auto feed = [&](std::string_view text) {
        return std::thread([&pipe, text] {
            std::FILE* const stream = std::fopen(pipe.c_str(), "wb");
            std::fwrite(text.data(), 1, text.size(), stream);
            std::fclose(stream);
        });
    };
    std::thread writer = feed("whole");
    CHECK(read_file(pipe) == "whole"); // what is read from its beginning to its end may come from a pipe
    writer.join();
    writer = feed("x"); // which is read before the next line goes on
    check_throws<IoError>([&] { (void)InputStream(pipe).size(); }, {"pipe: is a pipe", "store it in a file"});
    writer.join();
    check_throws<IoError>([&] { (void)read_file(pipe); }, {"pipe: is a pipe that nobody writes to"}); // after 2 seconds
    writer = std::thread([&pipe] { // it comes later than the reader, and pauses
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        std::FILE* const stream = std::fopen(pipe.c_str(), "wb");
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
        std::fputs("late", stream);
        std::fclose(stream);
    });
    CHECK(read_file(pipe) == "late");
    writer.join();
    // Archives, Gaussians and motions are looked at more than once: their readers refuse a pipe before they open it.
    check_throws<IoError>([&] { NpzReader reader(pipe); }, {"pipe: is a pipe"});
    check_throws<IoError>([&] { (void)load_any_splats(pipe); }, {"pipe: is a pipe"});
    check_throws<IoError>([&] { (void)load_any_motion(pipe, test::small_body()); }, {"pipe: is a pipe"});
    CHECK(!InputFile(folder / "none").is_pipe());
    CHECK(InputFile("/dev/null").is_pipe());
    CHECK(!InputFile::in_memory(pipe, "").is_pipe());
}

TEST_CASE("a file that shrinks, grows or goes away while it is read is read as far as it goes") {
    const test::Temporary folder;
    write_file(folder / "a", std::string(200'000, 'x'));
    InputStream stream(folder / "a");
    std::string read(100'000, ' ');
    CHECK(stream.read(read.data(), read.size()) == read.size());
    std::filesystem::resize_file(folder / "a", 110'000);
    CHECK(stream.read(read.data(), read.size()) < read.size());
    CHECK(stream.size() == 110'000);
    std::filesystem::remove(folder / "a");
    check_throws<IoError>([&] { (void)stream.size(); }, {"/a: cannot be read"});
    CHECK(stream.next() == EOF);
}
