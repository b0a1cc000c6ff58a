// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as PLY files in the layout of the reference code of 3D Gaussian splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/file_author.hpp>
#include <gsh/io/splat/ply_file.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// How a PLY file is written.
struct PlyOptions {
    int pad_to_degree = 3;                  ///< bands up to it are written as zeros; many viewers demand degree 3
    std::optional<UpAxis> up = {};          ///< minus_y: turned, as most viewers expect; none: not stated
    std::optional<PixelFilter> filter = {}; ///< stated in the header
};

/// Reads x y z, f_dc_0..2, f_rest_*, opacity (logit), scale_0..2 (log), rot_0..3 (w, x, y, z) by name, in any order and
/// of any number type; other properties are ignored. Binary little-endian or ASCII.
///
/// f_rest holds 0, 9, 24, 45 or 72 numbers (degrees 0 to 4), channel by channel: all of red, then green, then blue.
///
/// Comments of the header are heeded: "gsh.up" and "gsh.filter" of write_gaussian_ply, "antialiased" of Postshot, and
/// "SplatRenderMode" of Brush.
///
/// Errors  IoError for a file that is missing, truncated, not PLY, or lacks a property; ShapeError for another number
///         of f_rest; ValueError for NaN, infinities, numbers beyond float and a quaternion of length 0.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, the files of their code.
[[nodiscard]] inline StillSplats read_ply_splats(const std::filesystem::path& path);

/// The Gaussians alone.
[[nodiscard]] inline GaussianCloud<float> read_gaussian_ply(const std::filesystem::path& path) {
    return read_ply_splats(path).cloud;
}

/// Writes x y z nx ny nz f_dc f_rest opacity scale rot as floats, atomically. Normals are zero. The header states the
/// program, and the vertical and the filter of the options.
inline void write_gaussian_ply(const std::filesystem::path& path, GaussianCloud<float> cloud,
                               const PlyOptions& options = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Comment lines for the header of a PLY file. The filter is stated as gsh.filter and as Postshot's "antialiased".
/// Brush's SplatRenderMode is only read.
inline std::string ply_comments(const SplatNotes& notes) {
    std::string text = "comment written by " + file_author() + "\n";
    if (notes.up) text += std::string("comment gsh.up ") + (notes.up == UpAxis::y ? "y" : "-y") + "\n";
    if (notes.filter) {
        char number[32];
        const auto end = std::to_chars(number, number + sizeof number, notes.filter->dilation).ptr;
        text += "comment gsh.filter dilation " + std::string(number, end) +
                (notes.filter->compensate_opacity ? " compensated\n" : " plain\n");
        text += std::string("comment antialiased ") + (notes.filter->compensate_opacity ? "1\n" : "0\n");
    }
    return text;
}

/// What the comments of a header state. The filter in gsh's own words has precedence.
inline SplatNotes notes_of_comments(const std::vector<std::string>& comments) {
    SplatNotes notes;
    std::optional<PixelFilter> foreign;
    for (const std::string& comment : comments) {
        if (comment == "gsh.up y") notes.up = UpAxis::y;
        if (comment == "gsh.up -y") notes.up = UpAxis::minus_y;
        if (comment == "antialiased 1") foreign = PixelFilter{.dilation = 0.3, .compensate_opacity = true};
        if (comment == "antialiased 0") foreign = PixelFilter{};
        if (comment == "SplatRenderMode: mip") foreign = PixelFilter{.dilation = 0.1, .compensate_opacity = true};
        if (comment == "SplatRenderMode: default") foreign = PixelFilter{};
        constexpr std::string_view own = "gsh.filter dilation ";
        if (comment.starts_with(own)) {
            double dilation = 0;
            const char* const last = comment.data() + comment.size();
            const auto [end, code] = std::from_chars(comment.data() + own.size(), last, dilation);
            const std::string_view rest(end, static_cast<std::size_t>(last - end));
            if (code == std::errc() && dilation >= 0 && dilation < 1e6 && (rest == " compensated" || rest == " plain"))
                notes.filter = PixelFilter{.dilation = dilation, .compensate_opacity = rest == " compensated"};
        }
    }
    if (!notes.filter) notes.filter = foreign;
    return notes;
}

/// Numbers of f_rest for a degree.
constexpr std::size_t sh_rest_count(int degree) { return 3 * static_cast<std::size_t>(degree * (degree + 2)); }

} // namespace detail

inline StillSplats read_ply_splats(const std::filesystem::path& path) {
    PlyFile file(path);
    const PlyElement& vertices = file.vertices();
    std::size_t rest = 0;
    for (const auto& property : vertices.properties) rest += property.name.starts_with("f_rest_");
    int degree = 0;
    while (degree <= 4 && detail::sh_rest_count(degree) != rest) ++degree;
    if (degree > 4)
        throw ShapeError(file.name() + ": has " + std::to_string(rest) +
                         " f_rest properties, expected 0, 9, 24, 45 or 72");

    std::vector<PlyProperty> wanted;
    std::string missing;
    const auto want = [&](const std::string& name) {
        if (const auto* property = vertices.find(name)) wanted.push_back(*property);
        else missing += (missing.empty() ? "" : ", ") + name;
    };
    for (const char* name : {"x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
                             "rot_3", "f_dc_0", "f_dc_1", "f_dc_2"})
        want(name);
    for (std::size_t i = 0; i < rest; ++i) want("f_rest_" + std::to_string(i));
    if (!missing.empty())
        throw IoError(file.name() + ": properties of a Gaussian are missing: " + missing +
                      "; is it a plain point cloud?");

    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    StillSplats splats{GaussianCloud<float>(vertices.count, degree), detail::notes_of_comments(file.comments())};
    GaussianCloud<float>& cloud = splats.cloud;
    file.read_rows(vertices, wanted, [&](std::size_t i, const std::vector<float>& v) {
        cloud.means[i] = {v[0], v[1], v[2]};
        cloud.opacity_logits[i] = v[3];
        cloud.log_scales[i] = {v[4], v[5], v[6]};
        cloud.quats[i] = {v[7], v[8], v[9], v[10]};
        check_value(dot(cloud.quats[i], cloud.quats[i]) > 0, file.name(),
                    "the quaternion rot_0..3 of vertex " + std::to_string(i) + " is 0, expected a rotation");
        vec3<float>* sh = &cloud.sh[i * basis];
        sh[0] = {v[11], v[12], v[13]};
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel)
                sh[k][static_cast<int>(channel)] = v[14 + channel * (basis - 1) + k - 1];
    });
    turn_from_stored(cloud, splats.notes.up);
    return splats;
}

inline void write_gaussian_ply(const std::filesystem::path& path, GaussianCloud<float> given,
                               const PlyOptions& options) {
    check_writable("write_gaussian_ply", given);
    check_value(options.pad_to_degree >= 0 && options.pad_to_degree <= 4, "write_gaussian_ply",
                "pad_to_degree must be 0 to 4");
    const GaussianCloud<float> cloud = as_stored(std::move(given), options.up);
    const int degree = std::max(cloud.sh_degree, options.pad_to_degree);
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto written = static_cast<std::size_t>(sh_basis_count(degree));

    std::string header = "ply\nformat binary_little_endian 1.0\n" +
                         detail::ply_comments({.up = options.up, .filter = options.filter}) + "element vertex " +
                         std::to_string(cloud.size()) + "\n";
    const auto property = [&](const std::string& name) { header += "property float " + name + "\n"; };
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) property(name);
    for (std::size_t i = 0; i < detail::sh_rest_count(degree); ++i) property("f_rest_" + std::to_string(i));
    for (const char* name : {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"})
        property(name);

    AtomicFile file(path);
    file.write(header + "end_header\n");
    std::vector<float> row;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        row.assign({cloud.means[i].x, cloud.means[i].y, cloud.means[i].z, 0, 0, 0});
        const vec3<float>* sh = &cloud.sh[i * basis];
        row.insert(row.end(), {sh[0].x, sh[0].y, sh[0].z});
        for (int channel = 0; channel < 3; ++channel)
            for (std::size_t k = 1; k < written; ++k) row.push_back(k < basis ? sh[k][channel] : 0.0f);
        const vec3<float>& s = cloud.log_scales[i];
        const quat<float>& q = cloud.quats[i];
        row.insert(row.end(), {cloud.opacity_logits[i], s.x, s.y, s.z, q.w, q.x, q.y, q.z});
        file.write(row.data(), row.size() * sizeof(float));
    }
    file.commit();
}

} // namespace gsh
