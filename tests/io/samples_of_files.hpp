// SPDX-License-Identifier: Apache-2.0
/// @file  Samples of arrays, settings, networks, images, Gaussians, bodies, avatars and checkpoints.
#pragma once

#include "io/exif_files.hpp"
#include "io/gltf_files.hpp"
#include "io/makehuman_files.hpp"
#include "io/npz_files.hpp"
#include "io/safetensors_files.hpp"
#include "io/sample_files.hpp"
#include "io/samples.hpp"
#include "io/small_body.hpp"
#include "io/splat_clouds.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/region_file.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/safetensors.hpp>
#include <gsh/io/image/depth_map_file.hpp>
#include <gsh/io/image/environment_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/image/normal_map_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/io/model/lpips_file.hpp>
#include <gsh/io/splat/any_splats.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

inline void add_array_files(Samples& samples) {
    const auto npy = [](const std::filesystem::path& file) { return read_npy<double>(file, Numbers::any); };
    const std::vector<float> floats{1, 2.5f, -3, 4, 0, 6};
    write_array(samples.file("npy", "floats.npy", npy), floats, {2, 3});
    write_text(samples.file("npy", "fortran.npy", npy), npy_bytes("<f8", "(2, 2)", std::string(32, '\0'), true));
    write_text(samples.file("npy", "bytes.npy", npy), npy_bytes("|u1", "(3,)", "\x01\x02\x03", false, 2));
    write_text(samples.file("npy", "halves.npy", npy), npy_bytes("<f2", "(2,)", std::string("\0\x3c\0\x40", 4)));
    const auto npz = [](const std::filesystem::path& file) {
        const NpzReader archive(file);
        std::vector<NpyArray<double>> arrays;
        for (const std::string& key : archive.keys())
            if (archive.has_array(key) && !archive.header(key).is_text())
                arrays.push_back(archive.read<double>(key, Numbers::any));
        return arrays;
    };
    for (const bool packed : {false, true}) {
        NpzWriter file(samples.file("npz", packed ? "packed.npz" : "stored.npz", npz),
                       packed ? Packing::deflated : Packing::stored);
        file.add("floats", floats, {3, 2}), file.add("number", std::int64_t(7)), file.add_text("text", "a word");
        file.add_texts("texts", {"one", "two"});
        file.commit();
    }
    SafetensorsFile tensors;
    tensors.add("first", "2, 3", floats), tensors.add("second", "6", floats, "BF16");
    tensors.add("third", "3, 2", floats, "F16");
    tensors.write(samples.file("safetensors", "a.safetensors", [](const std::filesystem::path& file) {
        const SafetensorsReader reader(file);
        std::vector<NpyArray<float>> arrays;
        for (const std::string& key : reader.keys()) arrays.push_back(reader.read<float>(key));
        return arrays;
    }));
    write_text(
        samples.file("json", "a.json", [](const std::filesystem::path& file) { return detail::read_json(file); }),
        R"({"a": [1, -2.5e3, true, null], "b": {"c": "text \u00e9\n"}})");
    const auto configuration = [](const std::filesystem::path& file) { return read_configuration(file); };
    copy_of_0_1("settings.json", samples.file("configuration", "person.json", configuration));
    write_text(samples.file("configuration", "light.json", configuration),
               R"({"configuration": "paper", "rate.sh": 0.001, "hash_sh": false, "light": true, "ao": "pose"})");

    // A network's weights are too large for a sample: two layers of VGG16.
    const auto network = [](const std::filesystem::path& file) { return read_lpips(file); };
    const std::vector<float> weights(64 * 3 * 3 * 3, 0.5f), bias(64, 0.25f);
    SafetensorsFile layers;
    layers.add("features.0.weight", "64, 3, 3, 3", weights, "BF16"), layers.add("features.0.bias", "64", bias, "BF16");
    layers.write(samples.file("lpips", "layer.safetensors", network, false));
    NpzWriter file(samples.file("lpips-npz", "layer.npz", network, false), Packing::deflated);
    file.add("net.slice1.0.weight", weights, {64, 3, 3, 3}), file.add("net.slice1.0.bias", bias);
    file.commit();
}

/// Opaque on the left.
inline PixelImage coloured(int channels, int height, int width) {
    PixelImage image(channels, height, width);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c)
                image.pixel(y, x)[c] =
                    static_cast<std::uint8_t>(c == 3 ? (x < width / 2 ? 255 : 0) : 37 * x + 11 * y + 50 * c);
    return image;
}

inline void add_image_files(Samples& samples) {
    const auto image = [](const std::filesystem::path& file) { return read_image(file); };
    const auto mask = [](const std::filesystem::path& file) { return read_mask(file); };
    const auto normals = [](const std::filesystem::path& file) { return read_normal_map(file); };
    write_png(samples.file("png", "rgba.png", image), coloured(4, 8, 12));
    write_text(samples.file("png", "turned.png", image), with_exif(encode_png(coloured(3, 4, 6)), orientation_tiff(6)));
    write_png(samples.file("png", "grey.png", image), coloured(1, 4, 6));
    write_text(samples.file("jpeg", "plain.jpg", image), jpeg_bytes(coloured(3, 16, 24), 90));
    write_text(samples.file("jpeg", "turned.jpg", image),
               with_exif(jpeg_bytes(coloured(3, 8, 8), 50), orientation_tiff(3, true)));
    PixelImage white(1, 6, 8);
    for (std::size_t i = 0; i < white.data.size(); ++i) white.data[i] = i % 8 < 4 ? 255 : 0;
    write_png(samples.file("mask-png", "grey.png", mask), white);
    write_png(samples.file("mask-png", "alpha.png", mask), coloured(4, 6, 8));
    const std::vector<std::uint8_t> labels(48, 1);
    write_array(samples.file("mask-npy", "bytes.npy", mask), labels, {6, 8});
    write_text(samples.file("mask-npy", "bool.npy", mask), npy_bytes("|b1", "(6, 8)", std::string(48, '\1')));
    write_array(samples.file("mask-npy", "floats.npy", mask), std::vector<float>(48, 1.0f), {6, 8});
    PixelImage facing(3, 6, 8);
    for (std::size_t i = 0; i < facing.data.size(); ++i) facing.data[i] = i % 3 == 2 ? 255 : 128;
    write_png(samples.file("normals-png", "a.png", normals), facing);
    std::vector<float> vectors;
    for (int i = 0; i < 48; ++i) vectors.insert(vectors.end(), {0, 0.6f, 0.8f});
    write_array(samples.file("normals-npy", "a.npy", normals), vectors, {6, 8, 3});
    write_array(samples.file("depth-map", "a.npy",
                             [](const std::filesystem::path& file) { return read_depth_map(file, false); }),
                std::vector<float>(48, 2.0f), {6, 8});
    const auto environment = [](const std::filesystem::path& file) { return read_environment(file); };
    const std::string head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n";
    write_text(samples.file("environment", "flat.hdr", environment), head + std::string(128, '\x80'));
    std::string rows; // run lengths: each of four planes is one run of eight
    for (int y = 0; y < 4; ++y) rows += std::string("\2\2\0\x08\x88\x70\x88\x71\x88\x72\x88\x80", 12);
    write_text(samples.file("environment", "runs.hdr", environment), head + rows);
}

inline void add_splat_files(Samples& samples) {
    const auto read = [](const std::filesystem::path& file) { return load_any_splats(file); };
    for (const SplatFormatTraits& row : splat_formats) {
        if (!row.read || !row.write) continue;
        const std::string ending(row.ending);
        const std::string target = ending == ".glb" || ending == ".gltf" ? ending.substr(1) + "-splats"
                                   : ending == ".compressed.ply"         ? "compressed-ply"
                                                                         : ending.substr(1);
        for (const int version : std::set<int>(row.versions.begin(), row.versions.end()))
            for (const int degree : {0, 2})
                (void)save_splats(
                    samples.file(target, "degree" + std::to_string(degree) + "_v" + std::to_string(version) + ending,
                                 read),
                    splat_cloud(6, degree), {.version = version});
    }
    copy_of_0_1("scene.ply", samples.file("ply", "of_0_1.ply", read));
    // The same as text with its bytes in base64.
    const std::string glb =
        read_file(samples.all.front().place.parent_path().parent_path() / "glb-splats/degree0_v0.glb");
    std::uint32_t size = 0;
    std::memcpy(&size, glb.data() + 12, 4);
    detail::Json json = detail::Json::parse(glb.substr(20, size));
    json["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64_of(glb.substr(20 + size + 8));
    write_text(samples.file("gltf-splats", "degree0.gltf", read), json.dump());
}

inline void add_model_files(Samples& samples) {
    const auto body = [](const std::filesystem::path& file) { return load_body_model(file); };
    copy_of_0_1("body.npz", samples.file("body", "of_0_1.npz", body));
    save_body_model(samples.file("body", "small.npz", body), small_body(3, 2, 1));
    MakeHumanSample person;
    for (auto& [name, text] : person.files) // most targets move nothing, so that the archive is small
        if (name.starts_with("targets/") && !name.starts_with("targets/torso/") && !name.starts_with("targets/chin/"))
            text.clear();
    person.write_zip(
        samples.file("makehuman", "sample.zip", [](const std::filesystem::path& file) { return load_makehuman(file); }),
        "");
    const auto regions = [](const std::filesystem::path& file) { return read_regions(file, 57); };
    write_text(samples.file("regions", "lists.json", regions),
               R"({"face_vertices": [1, 2], "left_hand_vertices": [3], "right_hand_vertices": [4, 5], "high": [6]})");
    write_text(samples.file("regions", "importance.json", regions),
               detail::Json{{"importance", std::vector<double>(57, 0.25)}}.dump());
    const auto avatar = [](const std::filesystem::path& file) { return load_avatar(file); };
    for (const char* name : {"avatar.gsh", "avatar_compact.gsh", "avatar_paper.gsh", "avatar_paper_compact.gsh"})
        copy_of_0_1(name, samples.file("avatar", name, avatar));

    // The arrays of a training in tests/fuzz/model_targets.cpp.
    ArchiveWriter file(samples.file("checkpoint", "small.gsh",
                                    [](const std::filesystem::path& path) {
                                        const ArchiveReader archive(path, "checkpoint", checkpoint_version);
                                        return std::pair(archive.read_text("configuration"),
                                                         archive.read<float>("learned/means/values"));
                                    }),
                       "checkpoint", checkpoint_version);
    file.add("steps", std::uint64_t(4)), file.add("progress", 0.25), file.add("seed", std::uint64_t(3));
    file.add("arrays", std::uint64_t(2));
    for (const auto& [name, size] : {std::pair("means", 4), std::pair("opacity_logits", 2)})
        for (const char* part : {"values", "first_moment", "second_moment"})
            file.add("learned/" + std::string(name) + "/" + part,
                     std::vector<float>(static_cast<std::size_t>(size), 0.25f));
    file.add("refinement/steps", std::uint64_t(4)), file.add("refinement/updates", std::vector<std::uint64_t>{4, 4});
    for (const char* part : {"increments", "first_moment", "second_moment"})
        file.add("refinement/" + std::string(part), std::vector<float>(6, 0.125f));
    file.add_text("configuration", "gaussians = 2\nrate.sh = 0.002\n"), file.add_text("options", "words");
    file.commit();
}

} // namespace gsh::test
