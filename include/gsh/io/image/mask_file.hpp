// SPDX-License-Identifier: Apache-2.0
/// @file  Reads masks of people, and decides what their numbers mean: soft masks, or label images of one person.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/image/image_file.hpp>

#include <stb/stb_image.h>

#include <algorithm>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The different numbers in a mask: grey values, or the colours of a label image.
struct MaskLevels {
    std::bitset<256> grey;
    std::set<std::uint32_t> colors = {}; ///< 0xRRGGBB; not empty if the file is not grey, and then without black
    bool unit = false;                   ///< an array of 0 and 1, which was scaled to 0 and 255

    /// The greatest grey value, -1 without any.
    [[nodiscard]] int greatest() const;
    /// Whether no pixel shows anybody.
    [[nodiscard]] bool empty() const { return colors.empty() && greatest() <= 0; }
    /// Whether the file alone shows that it is a mask: grey, and white on a person. The best masks of JPEG files, and
    /// of networks, reach 250.
    [[nodiscard]] bool plain() const { return colors.empty() && greatest() >= 240; }
    void add(const MaskLevels& other);
};

/// A mask as a file stores it.
struct StoredMask {
    PixelImage values;   ///< one channel; 255 is the person. Of colours, 255 is every one but black
    int orientation = 1; ///< of its Exif data
    MaskLevels levels;
};

/// Reads a mask: the alpha of an image with transparency, else its grey values; or an array .npy of 0 and 1, or up to
/// 255. Label images of 16 bits keep their numbers.
///
/// Errors  those of read_image and read_npy; ShapeError for an array of another shape, ValueError for numbers outside
///         of 0 to 255, and for a picture of many colours.
[[nodiscard]] inline StoredMask read_mask(const InputFile& input);

/// The levels of an image's alpha.
[[nodiscard]] inline MaskLevels alpha_levels(const PixelImage& image);

/// What the numbers mean in masks that belong together, those of a camera.
enum class MaskMeaning {
    soft,   ///< the number is the share of the person, 255 being all
    binary, ///< two numbers: 0, and one for the person, however small
};

/// Decides by the levels of all of them. `plain` tells whether some are plain, apart from arrays of 0 and 1. Then
/// others are soft, too: a network leaves faint values beside the person.
///
/// Errors  ValueError for other masks: labels of several objects, colours, or soft masks that nowhere come near 255.
///         The message begins with `where` and lists what was found.
[[nodiscard]] inline MaskMeaning mask_meaning(const std::string& where, const MaskLevels& all, bool plain);

// -------------------------------------------------------------------------------------------------------------

inline int MaskLevels::greatest() const {
    for (int value = 255; value >= 0; --value)
        if (grey[static_cast<std::size_t>(value)]) return value;
    return -1;
}

inline void MaskLevels::add(const MaskLevels& other) {
    grey |= other.grey;
    colors.insert(other.colors.begin(), other.colors.end());
    unit = unit || other.unit;
}

inline MaskLevels alpha_levels(const PixelImage& image) {
    MaskLevels levels;
    for (std::size_t i = 3; i < image.data.size(); i += 4) levels.grey.set(image.data[i]);
    return levels;
}

namespace detail {

/// The grey values of a label image of 16 bits, which are small; no values if it is none.
inline std::vector<std::uint8_t> wide_labels(const InputFile& input) {
    const std::string bytes = read_file(input);
    const auto release = [](stbi_us* pixels) { stbi_image_free(pixels); };
    int width = 0, height = 0, channels = 0;
    const std::unique_ptr<stbi_us, decltype(release)> pixels(
        stbi_load_16_from_memory(reinterpret_cast<const stbi_uc*>(bytes.data()), static_cast<int>(bytes.size()), &width,
                                 &height, &channels, 1),
        release);
    if (!pixels) return {};
    const std::size_t count = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    if (*std::max_element(pixels.get(), pixels.get() + count) > 255) return {};
    std::vector<std::uint8_t> values(count);
    for (std::size_t i = 0; i < count; ++i) values[i] = static_cast<std::uint8_t>(pixels.get()[i]);
    return values;
}

inline StoredMask read_mask_image(const InputFile& input) {
    constexpr int tint = 16; // JPEG files of grey pictures, and their chroma
    constexpr std::size_t most = 256;
    const StoredImage stored = read_stored_image(input);
    const PixelImage& image = stored.image;
    StoredMask mask{PixelImage(1, image.height, image.width), stored.orientation, {}};
    std::vector<std::uint8_t>& values = mask.values.data;
    const std::size_t pixels = values.size();
    bool opaque = true;
    for (std::size_t i = 0; i < pixels && opaque; ++i) opaque = image.data[4 * i + 3] == 255;
    const auto is_tinted = [&](std::size_t i) {
        const auto [low, high] = std::minmax({image.data[4 * i], image.data[4 * i + 1], image.data[4 * i + 2]});
        return high - low > tint;
    };
    bool colored = false;
    for (std::size_t i = 0; opaque && !colored && i < pixels; ++i) colored = is_tinted(i);
    for (std::size_t i = 0; i < pixels; ++i) {
        const std::uint8_t* rgba = &image.data[4 * i];
        values[i] = opaque ? rgba[0] : rgba[3];
        if (!colored) {
            mask.levels.grey.set(values[i]);
            continue;
        }
        const std::uint32_t color =
            static_cast<std::uint32_t>(rgba[0]) << 16 | static_cast<std::uint32_t>(rgba[1]) << 8 | rgba[2];
        values[i] = color == 0 ? 0 : 255;
        if (color == 0)
            mask.levels.grey.set(0);
        else if (mask.levels.colors.insert(color).second)
            check_value(mask.levels.colors.size() <= most, input.name(),
                        "is a picture of many colours, expected a mask: white on the person, black elsewhere");
    }
    if (stored.sixteen_bits && mask.levels.empty())
        if (auto labels = wide_labels(input); labels.size() == pixels) {
            values = std::move(labels);
            for (const std::uint8_t value : values) mask.levels.grey.set(value);
        }
    return mask;
}

inline StoredMask read_mask_array(const InputFile& input) {
    const bool real = npy_header_of(input).is_real();
    const NpyArray<float> array = read_npy<float>(input, Numbers::any);
    // Dimensions of 1 behind height and width are allowed.
    if (array.shape.size() < 2 || array.size() != array.dim(0) * array.dim(1) || array.size() == 0 ||
        array.size() > std::size_t(1) << 26)
        throw ShapeError(input.name() + ": is an array " + shape_text(array.shape) + ", expected (height, width)");
    float high = 0;
    for (const float value : array.data) {
        check_value(value >= 0 && value <= 255, input.name(),
                    "holds " + number_text(value) + ", expected 0 to 1, or 0 to 255");
        high = std::max(high, value);
    }
    StoredMask mask{PixelImage(1, static_cast<int>(array.dim(0)), static_cast<int>(array.dim(1))), 1, {}};
    const float scale = high <= 1 ? 255.0f : 1.0f;
    mask.levels.unit = !real && high == 1;
    for (std::size_t i = 0; i < array.size(); ++i) {
        mask.values.data[i] = static_cast<std::uint8_t>(array[i] * scale + 0.5f);
        mask.levels.grey.set(mask.values.data[i]);
    }
    return mask;
}

/// "0, 1, 2 and 3 more" of the levels.
inline std::string level_text(const MaskLevels& levels) {
    std::vector<std::string> names;
    for (std::size_t value = 0; value < 256; ++value)
        if (levels.grey[value]) names.push_back(std::to_string(value));
    for (const std::uint32_t color : levels.colors)
        names.push_back("(" + std::to_string(color >> 16) + ", " + std::to_string(color >> 8 & 255) + ", " +
                        std::to_string(color & 255) + ")");
    return listing(names.size(), 6, [&](std::size_t i) { return names[i]; });
}

} // namespace detail

inline StoredMask read_mask(const InputFile& input) {
    return input.ending() == ".npy" ? detail::read_mask_array(input) : detail::read_mask_image(input);
}

inline MaskMeaning mask_meaning(const std::string& where, const MaskLevels& all, bool plain) {
    MaskLevels levels = all;
    if (levels.unit && !plain) levels.grey.reset(255), levels.grey.set(1);                  // what the arrays hold
    const std::size_t values = levels.grey.count() - levels.grey[0] + levels.colors.size(); // without black
    if (levels.colors.empty() && (plain || levels.greatest() >= 240 || levels.empty())) return MaskMeaning::soft;
    if (values == 1 && !plain) return MaskMeaning::binary;
    constexpr std::size_t most_labels = 64;
    const bool labels = !levels.colors.empty() || values <= most_labels;
    throw ValueError(where + ": found the " + (labels ? "labels " : "values ") + detail::level_text(levels) +
                     ", expected white (255) on the person, or on all people, and black (0) elsewhere; " +
                     (labels ? "write 255 for the labels of people, and 0 for all others"
                             : "scale the masks so that the person is white"));
}

} // namespace gsh
