// SPDX-License-Identifier: Apache-2.0
/// @file  The table of splat formats: names, endings, first bytes, what each holds, and its reader and writer.
#pragma once

#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/compressed_ply.hpp>
#include <gsh/io/splat/gltf_splats.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/ply_file.hpp>
#include <gsh/io/splat/splat_axes.hpp>
#include <gsh/io/splat/splat_file.hpp>
#include <gsh/io/splat/spz.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/io/splat/usda.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// In the order of the table.
enum class SplatFormat { ply, compressed_ply, spz, splat, glb, usda }; ///< glb: also .gltf

/// How a cloud is written. A format leaves out what it cannot state.
struct SplatFileOptions {
    std::optional<UpAxis> up = {};          ///< of the file's numbers; none: the custom of the format
    std::optional<PixelFilter> filter = {}; ///< that the Gaussians were trained with
    int version = 0;                        ///< of a format that has several; 0: the usual one
};

/// The ranges beyond which numbers are clamped, as messages say them. Formats that store floats need none.
struct SplatLimits {
    std::string_view holder = "the format";
    std::string_view scales = "e^20", colors = "-0.44 to 1.44", coefficients = "-4 to 4";
    std::string_view reach = {}; ///< the distance beyond which positions are in larger steps than usual; empty: none
};

/// A row of the table. A format without a reader is only written, one without a writer only read.
struct SplatFormatTraits {
    using Order = std::vector<std::uint32_t> (*)(const GaussianCloud<float>& cloud);
    using Test = bool (*)(const InputFile& input);
    using Reader = StillSplats (*)(const InputFile& input);
    using Writer = SplatLosses (*)(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                                   const SplatFileOptions& options);

    SplatFormat format;
    std::string_view name;
    std::string_view ending;                         ///< ".compressed.ply"
    std::string_view other_ending = {};              ///< that is read, but not written
    std::array<std::string_view, 2> signatures = {}; ///< first bytes; none: recognised by the ending alone
    Test holds = nullptr;             ///< tells the file from one of another format with the same first bytes
    int sh_degree = 3;                ///< the highest that is written
    bool is_y_down = false;           ///< by custom, unless a file states otherwise
    bool holds_motion = false;        ///< in one file; otherwise a motion is a folder of files
    std::array<int, 2> versions = {}; ///< that are written, the usual one first
    Order order = nullptr;            ///< of Gaussians that suits the format best; none: their own
    SplatLimits limits = {};
    Reader read = nullptr;
    Writer write = nullptr; ///< for a cloud with y up, of sh_degree at most; the options are complete

    /// True if files with these first bytes may be of this format.
    [[nodiscard]] constexpr bool begins_with(std::string_view bytes) const {
        for (const std::string_view signature : signatures)
            if (!signature.empty() && bytes.starts_with(signature)) return true;
        return false;
    }
    [[nodiscard]] constexpr bool has_signature() const { return !signatures[0].empty(); }
    [[nodiscard]] constexpr bool has_ending(std::string_view text) const {
        return text == ending || (!other_ending.empty() && text == other_ending);
    }
};

namespace detail {

inline bool is_compressed_ply(const InputFile& input) {
    return PlyFile(input).vertices().find("packed_position") != nullptr;
}
/// At rest, if its nodes are animated.
inline StillSplats read_still_gltf(const InputFile& input) {
    return read_gltf_splats(input);
}
inline SplatLosses save_ply(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                            const SplatFileOptions& o) {
    write_gaussian_ply(path, cloud, {.pad_to_degree = 0, .up = o.up, .filter = o.filter});
    return {.gaussians = cloud.size()};
}
inline SplatLosses save_compressed_ply(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                                       const SplatFileOptions& o) {
    return write_compressed_ply(path, cloud, o.up, o.filter);
}
inline SplatLosses save_spz(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                            const SplatFileOptions& o) {
    return write_spz(path, cloud, {.version = o.version, .filter = o.filter.value_or(PixelFilter{})});
}
inline SplatLosses save_splat(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                              const SplatFileOptions& o) {
    return write_splat(path, cloud, o.up);
}
inline SplatLosses save_gltf(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                             const SplatFileOptions& o) {
    write_gltf_splats(path, cloud, o.filter);
    return {.gaussians = cloud.size()};
}
inline SplatLosses save_usda(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                             const SplatFileOptions& o) {
    UsdaSplats file(path, o.filter);
    file.add(cloud);
    file.commit();
    return {.gaussians = cloud.size()};
}

} // namespace detail

/// All formats. Programs and messages name them in this order.
inline constexpr std::array splat_formats = std::to_array<SplatFormatTraits>({
    {.format = SplatFormat::ply,
     .name = "PLY",
     .ending = ".ply",
     .signatures = {"ply"},
     .sh_degree = 3, // degree 4 is read, too, but other programs do not know it
     .is_y_down = true,
     .read = read_ply_splats,
     .write = detail::save_ply},
    {.format = SplatFormat::compressed_ply,
     .name = "compressed PLY",
     .ending = ".compressed.ply",
     .signatures = {"ply"},
     .holds = detail::is_compressed_ply,
     .is_y_down = true,
     .order = morton_order<float>,
     .read = read_compressed_ply,
     .write = detail::save_compressed_ply},
    {.format = SplatFormat::spz,
     .name = "SPZ",
     .ending = ".spz",
     .signatures = {"NGSP", "\x1f\x8b"},
     .versions = {3, 4},
     .order = morton_order<float>,
     .limits = {.holder = "SPZ", .scales = "e^-10 to e^5.94", .coefficients = "-1 to 1", .reach = "2048"},
     .read = read_spz,
     .write = detail::save_spz},
    {.format = SplatFormat::splat,
     .name = ".splat",
     .ending = ".splat", // files may begin with any bytes
     .sh_degree = 0,
     .is_y_down = true,
     .order = importance_order<float>,
     .limits = {.colors = "0 to 1"},
     .read = read_splat,
     .write = detail::save_splat},
    {.format = SplatFormat::glb,
     .name = "glTF",
     .ending = ".glb",
     .other_ending = ".gltf",
     .signatures = {"glTF"},
     .holds_motion = true,
     .read = detail::read_still_gltf,
     .write = detail::save_gltf},
    {.format = SplatFormat::usda, .name = "USD", .ending = ".usda", .holds_motion = true, .write = detail::save_usda},
});

static_assert(
    [] {
        for (std::size_t k = 0; k < splat_formats.size(); ++k)
            if (splat_formats[k].format != static_cast<SplatFormat>(k)) return false;
        return true;
    }(),
    "a row for each SplatFormat, in its order");

[[nodiscard]] constexpr const SplatFormatTraits& traits_of(SplatFormat format) {
    return splat_formats[static_cast<std::size_t>(format)];
}

/// The format in which a file of this name is written: the one with the longest ending that the name has.
///
/// Errors  none: null for another ending, and for a name that is nothing but an ending.
[[nodiscard]] inline const SplatFormatTraits* written_splat_format(const std::filesystem::path& path) {
    const std::string name = path.filename().string();
    const SplatFormatTraits* found = nullptr;
    for (const SplatFormatTraits& row : splat_formats)
        if (row.write && name.size() > row.ending.size() && name.ends_with(row.ending) &&
            (!found || row.ending.size() > found->ending.size()))
            found = &row;
    return found;
}

/// Which formats a list is about.
enum class SplatEndings { read, written, y_down };

/// Their endings as a list for messages: ".ply, .compressed.ply, …", with other words before the last one.
[[nodiscard]] inline std::string splat_endings(SplatEndings which, std::string_view before_last = ", ") {
    std::vector<std::string_view> endings;
    for (const SplatFormatTraits& row : splat_formats) {
        if (which == SplatEndings::read ? !row.read : !row.write) continue;
        if (which == SplatEndings::y_down && !row.is_y_down) continue;
        endings.push_back(row.ending);
        if (which == SplatEndings::read && !row.other_ending.empty()) endings.push_back(row.other_ending);
    }
    std::string list;
    for (std::size_t k = 0; k < endings.size(); ++k)
        list += std::string(k == 0 ? "" : k + 1 == endings.size() ? before_last : ", ") + std::string(endings[k]);
    return list;
}

} // namespace gsh
