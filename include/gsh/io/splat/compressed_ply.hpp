// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes compressed PLY files: 16 bytes a Gaussian in chunks of 256, and a byte for each SH number.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/io/splat/ply_comments.hpp>
#include <gsh/io/splat/ply_file.hpp>
#include <gsh/io/splat/spz_points.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// Reads a compressed PLY file. Comments of the header are heeded as by read_ply_splats. Invisible copies of the
/// Gaussian before, by which write_compressed_ply fills up chunks, are left out.
///
/// Errors  those of PlyFile; IoError if a table or a property is missing, or if chunks are too few.
/// Source  PlayCanvas' program splat-transform, its compressed-chunk.ts.
[[nodiscard]] inline StillSplats read_compressed_ply(const InputFile& input);

/// Writes a compressed PLY file, atomically, in the order of the cloud. A chunk of 256 neighbours in the order spans a
/// box of positions, log-scales and colours, within which they have 8 to 11 bits; so neighbours in the order should be
/// neighbours in space (morton_order).
///
/// Where an outlier would widen a box so much that its other Gaussians change visibly, the chunk ends before it and is
/// filled up with invisible copies of its last Gaussian. Returns their number, and how many numbers do not fit.
///
/// Errors  ValueError for an empty cloud or SH above degree 3. Coefficients beyond -4 to 4 end there.
inline SplatLosses write_compressed_ply(const std::filesystem::path& path, GaussianCloud<float> cloud,
                                        std::optional<UpAxis> up = {}, std::optional<PixelFilter> filter = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::size_t ply_chunk_size = 256;
inline constexpr std::array<const char*, 18> ply_chunk_properties = {
    "min_x",       "min_y",       "min_z",       "max_x", "max_y", "max_z", "min_scale_x", "min_scale_y", "min_scale_z",
    "max_scale_x", "max_scale_y", "max_scale_z", "min_r", "min_g", "min_b", "max_r",       "max_g",       "max_b"};

/// The box of a chunk in one of its three spaces: positions, log-scales, colours.
struct ChunkBox {
    vec3<float> low = vec3<float>(std::numeric_limits<float>::infinity()), high = -low;

    void add(const vec3<float>& v) { low = glm::min(low, v), high = glm::max(high, v); }
    /// Where v lies between the ends of the box, 0 to 1.
    [[nodiscard]] vec3<double> place(const vec3<float>& v) const {
        vec3<double> result(0);
        for (int axis = 0; axis < 3; ++axis)
            if (high[axis] > low[axis]) result[axis] = (double(v[axis]) - low[axis]) / (double(high[axis]) - low[axis]);
        return result;
    }
    [[nodiscard]] vec3<float> at(const vec3<double>& place) const {
        return vec3<float>(vec3<double>(low) + (vec3<double>(high) - vec3<double>(low)) * place);
    }
};

/// The boxes of a chunk, and what its Gaussians lose in them.
struct ChunkBoxes {
    ChunkBox positions, log_scales, colors;
    double log_sizes = 0; ///< their sum
    std::size_t count = 0;

    void add(const vec3<float>& mean, const vec3<float>& log_scale, const vec3<float>& color) {
        positions.add(mean), log_scales.add(log_scale), colors.add(color);
        log_sizes += log_size_of(log_scale), ++count;
    }
    /// The largest step of a position.
    [[nodiscard]] double step() const {
        const vec3<double> extent = vec3<double>(positions.high) - vec3<double>(positions.low);
        return std::max({extent.x / 2047, extent.y / 1023, extent.z / 2047});
    }
    /// The largest step of a number over what is seen: a Gaussian's size, 5% of a scale, 2% of a colour.
    [[nodiscard]] double harm() const {
        if (count == 0) return 0;
        const auto widest = [](const ChunkBox& box) {
            const vec3<double> extent = vec3<double>(box.high) - vec3<double>(box.low);
            return std::max({extent.x, extent.y, extent.z});
        };
        return std::max({step() / std::exp(log_sizes / static_cast<double>(count)), widest(log_scales) / 1023 / 0.05,
                         widest(colors) / 255 / 0.02});
    }
};

inline std::uint32_t unit_bits(double value, int bits) {
    const double steps = (1u << bits) - 1;
    return static_cast<std::uint32_t>(std::clamp(std::floor(value * steps + 0.5), 0.0, steps));
}
inline double unit_of_bits(std::uint32_t packed, int shift, int bits) {
    const std::uint32_t mask = (1u << bits) - 1;
    return (packed >> shift & mask) / static_cast<double>(mask);
}
inline std::uint32_t packed_place(const vec3<double>& p) {
    return unit_bits(p.x, 11) << 21 | unit_bits(p.y, 10) << 11 | unit_bits(p.z, 11);
}
inline vec3<double> place_of_packed(std::uint32_t packed) {
    return {unit_of_bits(packed, 21, 11), unit_of_bits(packed, 11, 10), unit_of_bits(packed, 0, 11)};
}

/// 2 bits name the largest of w x y z, then come the others, each with 10 bits from -√½ to √½.
inline std::uint32_t packed_rotation(const quat<float>& given) {
    const quat<double> q = normalize(quat<double>{given.w, given.x, given.y, given.z});
    const double parts[4] = {q.w, q.x, q.y, q.z};
    std::uint32_t largest = 0;
    for (std::uint32_t k = 1; k < 4; ++k)
        if (std::abs(parts[k]) > std::abs(parts[largest])) largest = k;
    std::uint32_t packed = largest;
    for (std::uint32_t k = 0; k < 4; ++k)
        if (k != largest)
            packed = packed << 10 | unit_bits((parts[largest] < 0 ? -parts[k] : parts[k]) * std::sqrt(0.5) + 0.5, 10);
    return packed;
}
inline quat<float> quat_of_packed(std::uint32_t packed) {
    const std::uint32_t largest = packed >> 30;
    double parts[4], squares = 0;
    int shift = 20;
    for (std::uint32_t k = 0; k < 4; ++k) {
        if (k == largest) continue;
        parts[k] = (unit_of_bits(packed, shift, 10) - 0.5) * std::sqrt(2.0);
        squares += parts[k] * parts[k];
        shift -= 10;
    }
    parts[largest] = std::sqrt(std::max(0.0, 1 - squares));
    return {float(parts[0]), float(parts[1]), float(parts[2]), float(parts[3])};
}

/// The Gaussians of a cloud as chunks store them.
struct ChunkedCloud {
    const GaussianCloud<float>& cloud;

    [[nodiscard]] vec3<float> log_scale(std::size_t i) const { return glm::clamp(cloud.log_scales[i], -20.0f, 20.0f); }
    [[nodiscard]] vec3<float> color(std::size_t i) const {
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        return unclamped_color<0>(&cloud.sh[i * basis], vec3<float>(0, 0, 1));
    }
    void add(ChunkBoxes& boxes, std::size_t i) const { boxes.add(cloud.means[i], log_scale(i), color(i)); }
    [[nodiscard]] ChunkBoxes boxes(std::size_t begin, std::size_t end) const {
        ChunkBoxes all;
        for (std::size_t i = begin; i < end; ++i) add(all, i);
        return all;
    }

    /// Where each chunk ends. A chunk whose steps are seen ends early where its parts together lose a quarter as much,
    /// as long as fillers stay below a quarter of the Gaussians and some.
    [[nodiscard]] std::vector<std::size_t> chunk_ends() const {
        std::vector<std::size_t> ends;
        std::size_t fillers_left = cloud.size() / 4 + 1024;
        while (ends.empty() || ends.back() < cloud.size()) {
            const std::size_t begin = ends.empty() ? 0 : ends.back();
            std::size_t end = std::min(begin + ply_chunk_size, cloud.size());
            if (const double harm = boxes(begin, end).harm(); harm > seen) {
                const std::size_t cut = best_cut(begin, end, harm);
                const std::size_t fillers = ply_chunk_size - (cut - begin);
                if (cut < end && fillers <= fillers_left) end = cut, fillers_left -= fillers;
            }
            ends.push_back(end);
        }
        return ends;
    }

private:
    static constexpr double seen = 0.5; ///< harm above it

    /// Where a chunk with this harm ends if it is divided best, in two or three: an outlier may stand between others.
    /// Its end if that is no gain.
    [[nodiscard]] std::size_t best_cut(std::size_t begin, std::size_t end, double harm) const {
        const auto loss = [](const ChunkBoxes& part) { // what is not seen counts the same
            return static_cast<double>(part.count) * std::max(part.harm(), seen);
        };
        std::vector<double> behind(end - begin + 1, 0.0); // the loss from there to the end
        ChunkBoxes part;
        for (std::size_t i = end; i-- > begin;) add(part, i), behind[i - begin] = loss(part);
        std::size_t cut = end;
        double least = static_cast<double>(end - begin) * harm / 4;
        ChunkBoxes first;
        for (std::size_t i = begin; i < end; add(first, i), ++i) {
            const double before = i == begin ? 0 : loss(first);
            if (before >= least) continue;
            ChunkBoxes middle;
            for (std::size_t j = i + 1; j < end; ++j) {
                add(middle, j - 1);
                const double lost = before + loss(middle) + behind[j - begin];
                if (lost < least) least = lost, cut = i == begin ? j : i;
            }
        }
        return cut;
    }
};

/// A table of at least `least` rows.
inline const PlyElement& compressed_ply_table(const PlyFile& file, const char* name, std::size_t least) {
    const PlyElement* found = file.find(name);
    if (!found || found->count < least)
        throw IoError(file.name() + ": has " + std::to_string(found ? found->count : 0) + " " + name +
                      " elements, expected " + std::to_string(least) + " for a compressed PLY file");
    return *found;
}

inline std::vector<PlyProperty> compressed_ply_columns(const PlyFile& file, const PlyElement& table,
                                                       Span<const std::string> names) {
    std::vector<PlyProperty> wanted;
    for (const std::string& name : names) {
        const PlyProperty* found = table.find(name);
        if (!found) throw IoError(file.name() + ": property " + name + " is missing");
        wanted.push_back(*found);
    }
    return wanted;
}

/// The boxes of positions, log-scales and colours of each chunk.
inline std::vector<std::array<ChunkBox, 3>> read_ply_chunks(PlyFile& file, std::size_t count) {
    const PlyElement& table = compressed_ply_table(file, "chunk", (count + ply_chunk_size - 1) / ply_chunk_size);
    std::vector<std::string> names(ply_chunk_properties.begin(), ply_chunk_properties.end());
    if (!table.find("min_r")) names.resize(12); // files of early versions; their colours span 0 to 1
    std::vector<std::array<ChunkBox, 3>> chunks;
    file.read_rows(table, compressed_ply_columns(file, table, names), [&](std::size_t, const std::vector<float>& v) {
        auto& boxes = chunks.emplace_back();
        boxes[2] = {vec3<float>(0), vec3<float>(1)};
        for (std::size_t k = 0; k < v.size() / 6; ++k)
            boxes[k] = {{v[6 * k], v[6 * k + 1], v[6 * k + 2]}, {v[6 * k + 3], v[6 * k + 4], v[6 * k + 5]}};
    });
    return chunks;
}

/// The SH degree of `count` Gaussians, whose table of SH the file is large enough to hold.
inline int compressed_ply_degree(const PlyFile& file, std::size_t count) {
    const PlyElement* bands = file.find("sh");
    if (!bands || bands->count == 0 || bands->properties.empty()) return 0; // gsplat 1.5.3 writes "element sh N" alone
    int degree = 0;
    while (degree <= 3 && sh_rest_count(degree) != bands->properties.size()) ++degree;
    if (degree > 3)
        throw ShapeError(file.name() + ": has " + std::to_string(bands->properties.size()) +
                         " f_rest properties, expected 9, 24 or 45");
    file.check_present(compressed_ply_table(file, "sh", count));
    return degree;
}

/// Sets the coefficients of a cloud above the constant one.
inline void read_ply_bands(PlyFile& file, GaussianCloud<float>& cloud) {
    if (cloud.sh_degree == 0) return;
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    std::vector<std::string> names;
    for (std::size_t k = 0; k < sh_rest_count(cloud.sh_degree); ++k) names.push_back("f_rest_" + std::to_string(k));
    const PlyElement& table = compressed_ply_table(file, "sh", cloud.size());
    file.read_rows(table, compressed_ply_columns(file, table, names), [&](std::size_t i, const std::vector<float>& v) {
        if (i >= cloud.size()) return;
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel) // the middle of the step
                cloud.sh[i * basis + k][static_cast<int>(channel)] =
                    ((v[channel * (basis - 1) + k - 1] + 0.5f) / 256 - 0.5f) * 8;
    });
}

} // namespace detail

inline StillSplats read_compressed_ply(const InputFile& input) {
    PlyFile file(input);
    const std::size_t count = file.vertices().count;
    const auto chunks = detail::read_ply_chunks(file, count);
    const int degree = detail::compressed_ply_degree(file, count);
    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    const std::vector<std::string> names{"packed_position", "packed_rotation", "packed_scale", "packed_color"};
    const auto packed = detail::compressed_ply_columns(file, file.vertices(), names);
    StillSplats splats{GaussianCloud<float>(count, degree)};
    GaussianCloud<float>& cloud = splats.cloud;
    std::vector<std::uint32_t> kept, before;
    file.read_rows<std::uint32_t>(file.vertices(), packed, [&](std::size_t i, const std::vector<std::uint32_t>& v) {
        const auto& [positions, scales, colors] = chunks[i / detail::ply_chunk_size];
        cloud.means[i] = positions.at(detail::place_of_packed(v[0]));
        cloud.quats[i] = detail::quat_of_packed(v[1]);
        cloud.log_scales[i] = scales.at(detail::place_of_packed(v[2]));
        const vec3<double> place(detail::unit_of_bits(v[3], 24, 8), detail::unit_of_bits(v[3], 16, 8),
                                 detail::unit_of_bits(v[3], 8, 8));
        cloud.sh[i * basis] = sh_of_color(colors.at(place));
        cloud.opacity_logits[i] = detail::logit_of_byte(static_cast<std::uint8_t>(v[3] & 255u));
        const bool fills = i > 0 && (v[3] & 255u) == 0 && std::equal(v.begin(), v.begin() + 3, before.begin()) &&
                           v[3] >> 8 == before[3] >> 8;
        if (!fills) kept.push_back(static_cast<std::uint32_t>(i));
        before = v;
    });
    detail::read_ply_bands(file, cloud);
    if (kept.size() < count) cloud = reordered(cloud, Span<const std::uint32_t>(kept));
    detail::heed_statements(splats, detail::statements_of_comments(file.comments()), file.name());
    check_writable(file.name(), cloud);
    return splats;
}

inline SplatLosses write_compressed_ply(const std::filesystem::path& path, GaussianCloud<float> given,
                                        std::optional<UpAxis> up, std::optional<PixelFilter> filter) {
    check_writable("write_compressed_ply", given);
    check_value(given.size() > 0, "write_compressed_ply", "there must be a Gaussian");
    check_value(given.sh_degree <= 3, "write_compressed_ply",
                "the format holds SH up to degree 3; use with_bands_up_to");
    const GaussianCloud<float> cloud = as_stored(std::move(given), up);
    const detail::ChunkedCloud chunked{cloud};
    const std::vector<std::size_t> ends = chunked.chunk_ends();
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const std::size_t rest = detail::sh_rest_count(cloud.sh_degree);
    SplatLosses losses{.gaussians = cloud.size()};
    std::vector<float> boxes;
    std::vector<std::uint32_t> rows;
    std::vector<std::size_t> sources; // the Gaussian of each row
    for (std::size_t begin = 0; const std::size_t end : ends) {
        const detail::ChunkBoxes box = chunked.boxes(begin, end);
        for (const auto& [low, high] : {box.positions, box.log_scales, box.colors})
            boxes.insert(boxes.end(), {low.x, low.y, low.z, high.x, high.y, high.z});
        for (std::size_t i = begin; i < end; ++i) {
            const vec3<double> place = box.colors.place(chunked.color(i));
            rows.insert(rows.end(), {detail::packed_place(box.positions.place(cloud.means[i])),
                                     detail::packed_rotation(cloud.quats[i]),
                                     detail::packed_place(box.log_scales.place(chunked.log_scale(i))),
                                     detail::unit_bits(place.x, 8) << 24 | detail::unit_bits(place.y, 8) << 16 |
                                         detail::unit_bits(place.z, 8) << 8 |
                                         detail::unit_bits(sigmoid(double(cloud.opacity_logits[i])), 8)});
            sources.push_back(i);
            const vec3<float>& s = cloud.log_scales[i];
            losses.scales += std::max({s.x, s.y, s.z}) > 20;
            if (box.harm() > 1 && size_of(s) < box.step()) {
                ++losses.coarse;
                losses.position_step = std::max(losses.position_step, box.step());
            }
        }
        if (end < cloud.size()) // the last chunk may be short
            for (; sources.size() % detail::ply_chunk_size != 0; ++losses.fillers) {
                rows.insert(rows.end(), rows.end() - 4, rows.end());
                rows.back() &= ~255u; // no opacity
                sources.push_back(end - 1);
            }
        begin = end;
    }
    std::string header = "ply\nformat binary_little_endian 1.0\n" + detail::ply_comments({.up = up, .filter = filter}) +
                         "element chunk " + std::to_string(ends.size()) + "\n";
    for (const char* name : detail::ply_chunk_properties) header += std::string("property float ") + name + "\n";
    header += "element vertex " + std::to_string(sources.size()) + "\n";
    for (const char* name : {"position", "rotation", "scale", "color"})
        header += std::string("property uint packed_") + name + "\n";
    if (rest) header += "element sh " + std::to_string(sources.size()) + "\n";
    for (std::size_t k = 0; k < rest; ++k) header += "property uchar f_rest_" + std::to_string(k) + "\n";

    AtomicFile file(path);
    file.write(header + "end_header\n");
    file.write(boxes.data(), boxes.size() * sizeof(float));
    file.write(rows.data(), rows.size() * sizeof(std::uint32_t));
    std::vector<std::uint8_t> bytes(rest);
    for (std::size_t row = 0; row < sources.size() && rest; ++row) {
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel) {
                const double value = cloud.sh[sources[row] * basis + k][static_cast<int>(channel)];
                bytes[channel * (basis - 1) + k - 1] =
                    static_cast<std::uint8_t>(std::clamp(std::floor((value / 8 + 0.5) * 256), 0.0, 255.0));
            }
        file.write(bytes.data(), bytes.size());
    }
    for (std::size_t k = 0; k < cloud.sh.size(); ++k)
        for (int channel = 0; channel < 3; ++channel)
            losses.coefficients += k % basis != 0 && std::abs(cloud.sh[k][channel]) > 4;
    file.commit();
    return losses;
}

} // namespace gsh
