// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as PLY files in the layout of the reference code of 3D Gaussian splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/ply_comments.hpp>
#include <gsh/io/splat/ply_file.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
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
/// of any number type; other properties and other elements are ignored. Binary or ASCII. Instead of f_dc there may be
/// red, green and blue: integers of their type's range, or floats from 0 to 1 or from 0 to 255.
///
/// f_rest holds 0, 9, 24, 45 or 72 numbers (degrees 0 to 4), channel by channel: all of red, then green, then blue.
///
/// An infinite opacity is 1, or 0 if negative, and a scale of minus infinity is flat. A filter_3D of Mip-Splatting is
/// made part of scales and opacity, as its own fused files have it. Positions that a float holds only roughly are a
/// warning.
///
/// Comments of the header are heeded: "gsh.up" and "gsh.filter" of write_gaussian_ply, "antialiased" of Postshot,
/// "SplatRenderMode" of Brush, and "Vertical Axis" of nerfstudio and Brush.
///
/// Errors  IoError for a file that is missing, truncated, not PLY, or lacks a property; ShapeError for another number
///         of f_rest; ValueError for NaN, other infinities, scales above e^44 and a quaternion of length 0.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, the files of their code.
[[nodiscard]] inline StillSplats read_ply_splats(const InputFile& input);

/// The Gaussians alone.
[[nodiscard]] inline GaussianCloud<float> read_gaussian_ply(const InputFile& input) {
    return read_ply_splats(input).cloud;
}

/// Writes x y z nx ny nz f_dc f_rest opacity scale rot as floats, atomically. Normals are zero. The header states the
/// program, and the vertical and the filter of the options.
inline void write_gaussian_ply(const std::filesystem::path& path, GaussianCloud<float> cloud,
                               const PlyOptions& options = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Numbers of f_rest for a degree.
constexpr std::size_t sh_rest_count(int degree) {
    return 3 * static_cast<std::size_t>(degree * (degree + 2));
}

/// The columns of a table of Gaussians, and how their numbers become those of a cloud.
class PlyGaussians {
public:
    explicit PlyGaussians(const PlyFile& file) : file_(file), vertices_(file.vertices()) {
        std::size_t rest = 0;
        for (const auto& property : vertices_.properties) rest += property.name.starts_with("f_rest_");
        while (degree_ <= 4 && sh_rest_count(degree_) != rest) ++degree_;
        if (degree_ > 4)
            throw ShapeError(file.name() + ": has " + std::to_string(rest) +
                             " f_rest properties, expected 0, 9, 24, 45 or 72");
        is_plain_color_ = !vertices_.find("f_dc_0") && vertices_.find("red");
        for (const char* name :
             {"x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"})
            want(name);
        for (const char* name : {"red", "green", "blue"})
            if (is_plain_color_) want(name);
        for (const char* name : {"f_dc_0", "f_dc_1", "f_dc_2"})
            if (!is_plain_color_) want(name);
        for (std::size_t i = 0; i < rest; ++i) want("f_rest_" + std::to_string(i));
        refuse_missing();
        if (const auto* filter = vertices_.find("filter_3D")) wanted_.push_back(*filter), has_filter_ = true;
        if (!is_plain_color_) return;
        const PlyType type = vertices_.find("red")->type;
        if (type.kind != 'f') color_unit_ = type.width == 1 ? 255 : type.width == 2 ? 65535 : 4294967295.0;
    }

    [[nodiscard]] const std::vector<PlyProperty>& wanted() const { return wanted_; }
    [[nodiscard]] GaussianCloud<float> empty_cloud() const {
        return GaussianCloud<float>(static_cast<std::size_t>(vertices_.count), degree_);
    }

    /// Sets Gaussian i of the cloud from its row.
    void set(GaussianCloud<float>& cloud, std::size_t i, const std::vector<double>& v) {
        const auto basis = static_cast<std::size_t>(sh_basis_count(degree_));
        const auto real = [&](std::size_t k) {
            const auto value = static_cast<float>(v[k]);
            if (!std::isfinite(value)) refuse(k, i, v[k]);
            return value;
        };
        double opacity = static_cast<float>(v[3]), log_scale[3];
        if (std::isnan(opacity)) refuse(3, i, v[3]);
        for (std::size_t k = 0; k < 3; ++k) {
            log_scale[k] = static_cast<float>(v[4 + k]);
            if (log_scale[k] == -HUGE_VAL) log_scale[k] = flat_log_scale; // the logarithm of 0
            if (!(log_scale[k] <= largest_log_scale))
                refuse(4 + k, i, v[4 + k], "the logarithm of a length, at most " + number_text(largest_log_scale));
        }
        opacity = std::isinf(opacity) ? std::copysign(certain_logit, opacity) : opacity;
        if (has_filter_) apply_filter(real(v.size() - 1), log_scale, opacity);
        cloud.means[i] = {real(0), real(1), real(2)};
        cloud.opacity_logits[i] = static_cast<float>(opacity);
        cloud.log_scales[i] = {float(log_scale[0]), float(log_scale[1]), float(log_scale[2])};
        cloud.quats[i] = rotation({real(7), real(8), real(9), real(10)}, i);
        const vec3<float> color(real(11), real(12), real(13));
        greatest_color_ = std::max({greatest_color_, color.x, color.y, color.z});
        vec3<float>* sh = &cloud.sh[i * basis];
        sh[0] = is_plain_color_ ? color * static_cast<float>(1 / color_unit_) : color;
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel)
                sh[k][static_cast<int>(channel)] = real(14 + channel * (basis - 1) + k - 1);
        note_rounding(cloud, i, v);
    }

    /// What is known only after the last row: the unit of plain colours, and positions that a float does not hold.
    void finish(StillSplats& splats) const {
        if (is_plain_color_) {
            // Floats are 0 to 1 or 0 to 255. Colours of more than twice white are not seen in the first.
            const float unit = color_unit_ == 1 && greatest_color_ > 2 ? 255.0f : 1.0f;
            const auto basis = static_cast<std::size_t>(sh_basis_count(degree_));
            for (std::size_t i = 0; i < splats.cloud.size(); ++i)
                splats.cloud.sh[i * basis] = sh_of_color(splats.cloud.sh[i * basis] * (1 / unit));
        }
        if (rounded_ > 0)
            splats.warnings.push_back(
                file_.name() + ": positions of " + std::to_string(rounded_) + " of " +
                std::to_string(splats.cloud.size()) + " Gaussians are rounded to float, by up to " +
                number_text(greatest_rounding_) +
                " units of the file, which is more than a twentieth of their size; move the scene to the origin");
    }

private:
    const PlyFile& file_;
    const PlyElement& vertices_;
    std::vector<PlyProperty> wanted_;
    std::vector<std::string> missing_;
    int degree_ = 0;
    bool is_plain_color_ = false, has_filter_ = false;
    double color_unit_ = 1, greatest_rounding_ = 0;
    float greatest_color_ = 0;
    std::size_t rounded_ = 0;

    void want(const std::string& name) {
        if (const auto* property = vertices_.find(name))
            wanted_.push_back(*property);
        else
            missing_.push_back(name);
    }
    void refuse_missing() const {
        if (missing_.empty()) return;
        if (missing_ == std::vector<std::string>{"scale_2"})
            throw IoError(file_.name() +
                          ": property scale_2 is missing: these are 2D Gaussians (2DGS), which are not read; a scale_2 "
                          "of -20 makes flat 3D Gaussians of them");
        std::string list;
        for (const std::string& name : missing_) list += (list.empty() ? "" : ", ") + name;
        const bool is_cloud = !vertices_.find("opacity") && !vertices_.find("scale_0") && !vertices_.find("rot_0");
        throw IoError(file_.name() + ": properties of a Gaussian are missing: " + list +
                      (is_cloud ? "; is it a plain point cloud?" : ""));
    }
    [[noreturn]] void refuse(std::size_t k, std::size_t i, double value,
                             const std::string& expected = "a finite number") const {
        file_.refuse(vertices_, wanted_[k].name, i, value, expected);
    }

    [[nodiscard]] quat<float> rotation(const quat<double>& q, std::size_t i) const {
        const auto found = rotation_of_file(q);
        check_value(found.has_value(), file_.name(),
                    "the quaternion rot_0..3 of vertex " + std::to_string(i) + " is 0, expected a rotation");
        return *found;
    }

    /// Mip-Splatting's files hold Gaussians before their 3D filter, a Gaussian of its own width: variances are sums,
    /// and the opacity shrinks as the volume grows.
    static void apply_filter(double width, double log_scale[3], double& logit_of_opacity) {
        double share = 1;
        for (int k = 0; k < 3; ++k) {
            const double before = std::exp(2 * log_scale[k]), after = before + width * width;
            if (!(after > before)) continue;
            share *= std::sqrt(before / after);
            log_scale[k] = std::log(after) / 2;
        }
        if (share == 1) return;
        const double opacity = sigmoid(logit_of_opacity) * share;
        logit_of_opacity = opacity > 0 ? std::max<double>(logit(opacity), -certain_logit) : -certain_logit;
    }

    void note_rounding(const GaussianCloud<float>& cloud, std::size_t i, const std::vector<double>& v) {
        double rounding = 0;
        for (int axis = 0; axis < 3; ++axis)
            rounding = std::max(rounding, std::abs(v[static_cast<std::size_t>(axis)] - double(cloud.means[i][axis])));
        if (rounding == 0 || rounding < size_of(cloud.log_scales[i]) / 20) return;
        ++rounded_;
        greatest_rounding_ = std::max(greatest_rounding_, rounding);
    }
};

} // namespace detail

inline StillSplats read_ply_splats(const InputFile& input) {
    PlyFile file(input);
    detail::PlyGaussians gaussians(file);
    StillSplats splats{gaussians.empty_cloud()};
    file.read_rows<double>(file.vertices(), gaussians.wanted(),
                           [&](std::size_t i, const std::vector<double>& v) { gaussians.set(splats.cloud, i, v); });
    gaussians.finish(splats);
    detail::heed_statements(splats, detail::statements_of_comments(file.comments()), file.name());
    check_writable(file.name(), splats.cloud);
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
