// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include <gsh/io/image/depth_map_file.hpp>
#include <gsh/io/image/environment_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/image/normal_map_file.hpp>

#include <cmath>

namespace gsh::fuzz {

namespace {

void read_picture(const InputFile& file) {
    const StoredImage stored = read_stored_image(file);
    must(stored.orientation >= 1 && stored.orientation <= 8, "an orientation is not one of Exif's");
    const std::string again = encode_png(stored.image);
    must(read_image(InputFile::in_memory("again.png", again)).data == stored.image.data,
         "an image that is written again and read again differs");
}
const Registered png_target("png", "a.png", read_picture);
const Registered jpeg_target("jpeg", "a.jpg", read_picture);

void read_mask_file(const InputFile& file) {
    const StoredMask mask = read_mask(file);
    must(mask.values.channels == 1, "a mask has several channels");
    must(mask_meaning(file.name(), mask.levels, false) <= MaskMeaning::binary, "a mask has no meaning");
}
const Registered mask_png_target("mask-png", "a.png", read_mask_file);
const Registered mask_npy_target("mask-npy", "a.npy", read_mask_file);

void check_map(const PriorMap& map) {
    for (const double value : map.values.data) must(std::isfinite(value), "a map holds a number that is not finite");
}
void read_normals(const InputFile& file) {
    check_map(read_normal_map(file));
}
const Registered normals_png_target("normals-png", "a.png", read_normals);
const Registered normals_npy_target("normals-npy", "a.npy", read_normals);
const Registered depths_target("depth-map", "a.npy", [](const InputFile& file) { check_map(read_depth_map(file, false)); });

const Registered environment_target("environment", "a.hdr", [](const InputFile& file) {
    for (const float value : read_environment(file).data)
        must(std::isfinite(value) && value >= 0, "an environment is negative or not finite");
});

} // namespace

} // namespace gsh::fuzz
