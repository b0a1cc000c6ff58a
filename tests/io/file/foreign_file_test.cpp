// SPDX-License-Identifier: Apache-2.0
/// @file  Files of other programs are named, by every reader that is given one, with the way to convert them.
#include <gsh/io/file/foreign_file.hpp>

#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/io/file/number_lines.hpp>
#include <gsh/io/file/opencv_yaml.hpp>
#include <gsh/io/file/safetensors.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/bvh_file.hpp>

#include <doctest/doctest.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;
using namespace std::string_view_literals;

namespace {

/// A zip archive with one stored member of 10 bytes; readers see its beginning only.
std::string zip_of(std::string_view name) {
    std::string bytes =
        std::string("PK\x03\x04\x14\0\0\0\0\0\0\0\0\0\0\0\0\0"sv) + std::string("\x0a\0\0\0\x0a\0\0\0"sv);
    bytes.push_back(static_cast<char>(name.size()));
    return bytes + std::string("\0\0\0"sv) + std::string(name) + "0123456789";
}

struct Kinds {
    test::Temporary folder;
    [[nodiscard]] ForeignKind kind(std::string_view bytes) const {
        write_file(folder / "file", bytes);
        return foreign_kind(folder / "file");
    }
};

} // namespace

TEST_CASE_FIXTURE(Kinds, "kinds by first bytes") {
    const std::pair<std::string, std::string_view> known[] = {
        // What pickle.dumps({'a': 1}) of Python 3.11 gives for protocols 0 to 5, and others
        {"(dp0\nVa\np1\nI1\ns.", "pickle of Python (protocol 0)"},
        {std::string("}q\0X\x01\0\0\0aq\x01K\x01s."sv), "pickle of Python (protocol 1)"},
        {std::string("\x80\x02}q\0X\x01\0\0\0aq\x01K\x01s."sv), "pickle of Python (protocol 2)"},
        {std::string("\x80\x03}q\0."sv), "pickle of Python (protocol 3)"},
        {std::string("\x80\x04\x95\x0a\0\0\0\0\0\0\0}."sv), "pickle of Python (protocol 4)"},
        {std::string("\x80\x05\x95\x0a\0\0\0\0\0\0\0}."sv), "pickle of Python (protocol 5)"},
        {"cnumpy.core.multiarray\n_reconstruct\np0\n.", "pickle of Python (protocol 0)"},
        {"ccopy_reg\n_reconstructor\n.", "pickle of Python (protocol 0)"},
        // torch.save of PyTorch 1.5 and of later versions
        {std::string("\x80\x02\x8a\x0al\xfc\x9c\x46\xf9 j\xa8P\x19.\x80\x02M\xe9\x03."sv),
         "PyTorch before version 1.6"},
        {zip_of("archive/data.pkl"), "file of PyTorch"},
        {zip_of("motions/walk.bvh"), "zip archive of other files"},
        {zip_of("model.usdc"), "USD package"},
        {std::string("\x93NUMPY\x01\0v\0{'descr': '|O', 'fortran_order': False, 'shape': (), }"sv), "pickled object"},
        {std::string("\x93NUMPY\x01\0v\0{'descr': '<f4', 'fortran_order': False, 'shape': (20, 322), }"sv),
         "single array of NumPy (.npy) of shape (20, 322)"},
        {std::string("\x93NUMPY\x01\0v\0{'shape': (2\n\x01, "sv) + std::string(99, '1') + ")",
         "of shape (2??, 1111111111111111111111111111111111…"},
        {"\x89HDF\r\n\x1a\n", "HDF5"},
        {"MATLAB 5.0 MAT-file, Platform: posix", "version 5"},
        {"MATLAB 7.3 MAT-file, Platform: posix", "7.3, which is HDF5"},
        {"Kaydara FBX Binary  ", "FBX"},
        {"; FBX 7.4.0 project file\n", "FBX file (as text)"},
        {"BLENDER-v279", ".blend"},
        {std::string("\x28\xb5\x2f\xfd\0"sv), "Zstandard"},
        {"PXR-USDC", "USD"},
        {"#usda 1.0\n", "USD file (as text)"},
        {"\x02\x50" + std::string(600, '\1'), ".c3d"},
        {"PathFileType\t4\t(X/Y/Z)", ".trc"},
        {"# AST/ASF file generated using VICON BODY LANGUAGE\n:version 1.10\n:name VICON\n", ".asf"},
        {"#!OML:ASF\n:FULLY-SPECIFIED\n", ".amc"},
        {":FULLY-SPECIFIED\n:DEGREES\n", ".amc"},
        {std::string("\0\0\0\x20"
                     "ftypisom"sv),
         "MP4 video"},
        {std::string("\0\0\0\x14"
                     "ftypqt  "sv),
         "QuickTime"},
        {std::string("\0\0\0\x18"
                     "ftypheic"sv),
         "HEIC"},
        {"RIFF1234WEBPVP8 ", "WebP"},
        {"RIFF1234AVI LIST", "AVI"},
        {std::string("\xff\xd8\xff\xe0\0"sv), "JPEG"},
        {"\x89PNG\r\n\x1a\n", "PNG"},
        {std::string("II*\0"sv), "TIFF"},
        {std::string("\x1f\x8b\x08\0"sv), "gzip"},
        {"\x78\x9c\x01\x02", "joblib"},
        {"version https://git-lfs.github.com/spec/v1\noid sha256:12\n", "Git LFS"},
        {"\n <!DOCTYPE html><html>", "web page"},
        {"<?xml version=\"1.0\"?>\n<COLLADA xmlns=\"\">", "COLLADA"},
        {"<?xml version=\"1.0\"?>\n<opencv_storage>", "XML of OpenCV"},
        {"\xef\xbb\xbfHIERARCHY\n", "BVH"},
        {"ply\nformat ascii 1.0\n", "PLY"},
        {std::string("\x14\0\0\0\0\0\0\0{\"a\":{\"dtype\":\"F32\"}}"sv), "safetensors"},
        {"", "empty"},
    };
    for (const auto& [bytes, name] : known) {
        const ForeignKind found = kind(bytes);
        INFO("expected " << std::string(name) << ", found " << found.name);
        CHECK(found.name == test::contains(name));
    }
    for (const std::string_view text :
         {"{\"a\": 1}"sv, "hello."sv, "1, 2, 3\n"sv, "%YAML:1.0\n---\n"sv, "(a) text."sv, "\x80"sv})
        CHECK(!kind(text));
    CHECK(!foreign_kind(folder / "none"));
    CHECK(!foreign_kind(folder / ""));
}

TEST_CASE_FIXTURE(Kinds, "a file of the reader's own kind is damaged, not foreign") {
    NpzWriter whole(folder / "a.npz");
    whole.add("a", std::vector<double>(100, 0.5));
    whole.commit();
    CHECK(foreign_kind(folder / "a.npz").family == "npz");
    test::truncate_file(folder / "a.npz", 30);
    test::check_throws<IoError>([&] { NpzReader reader(folder / "a.npz"); }, {"a.npz: cannot be opened", "truncated"});
    CHECK(not_the_kind(folder / "a.npz", "JSON", "json", "x") == "is an .npz archive of NumPy, expected JSON");
    CHECK(not_the_kind(folder / "none", "JSON", "json", "otherwise") == "otherwise");
}

TEST_CASE_FIXTURE(Kinds, "an archive whose members are all pickled") {
    NpzWriter file(folder / "a.npz");
    file.add("params", std::vector<double>(2, 0.0));
    file.commit();
    std::string bytes = read_file(folder / "a.npz");
    const auto change = [&](std::string_view from, std::string_view to) { // the checksum is that of the numbers' reader
        bytes.replace(bytes.find(from), from.size(), to);
    };
    change("'<f8'", "'|O' ");
    write_file(folder / "a.npz", bytes);
    test::check_throws<IoError>([&] { (void)NpzReader(folder / "a.npz").read<double>("poses"); },
                                {"a.npz: poses is missing; the file holds: params, pickled", "docs/captures.md"});
}

TEST_CASE_FIXTURE(Kinds, "every reader names a pickle and a file of PyTorch, and the page that converts them") {
    const auto file = folder / "fit.pkl";
    for (const auto& [bytes, name] :
         {std::pair{std::string("\x80\x04}."sv), "fit.pkl: is a pickle of Python (protocol 4), "},
          std::pair{zip_of("fit/data.pkl"), "fit.pkl: is a file of PyTorch (.pt, .pth), "}}) {
        write_file(file, bytes);
        const auto refuses = [&, name = name](const auto& read, std::string_view expected) {
            test::check_throws<IoError>(read, {name, expected, "docs/captures.md"});
        };
        refuses([&] { NpzReader reader(file); }, "expected an .npz archive");
        refuses([&] { (void)detail::read_json(file); }, "expected JSON");
        refuses([&] { (void)load_bvh(file); }, "expected a BVH file");
        refuses([&] { OpenCvYaml reader(file); }, "expected YAML");
        refuses([&] { NumberLines reader(file); }, "expected lines of numbers");
        refuses([&] { (void)read_image(file); }, "expected a PNG or JPEG image");
        refuses([&] { detail::GltfFile reader(file); }, "expected glTF");
    }
}
