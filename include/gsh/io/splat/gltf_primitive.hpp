// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians as primitives of glTF (KHR_gaussian_splatting): attributes, written and read.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/glb_writer.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The attributes of a cloud as arrays of a GLB file. Ranges of the cloud become primitives that share these arrays, so
/// a file with many pieces has few views.
///
/// Values are those of the extension: rotations x y z w, linear scales, opacities after the sigmoid, SH coefficients as
/// they are. COLOR_0 is for viewers without the extension, which show points.
///
/// Source  Khronos, KHR_gaussian_splatting, release candidate of 2026.
class GltfSplatArrays {
public:
    GltfSplatArrays(GlbWriter& file, const GaussianCloud<float>& cloud) : file_(&file) {
        check_writable("GltfSplatArrays", cloud);
        check_value(cloud.size() > 0, "GltfSplatArrays", "there must be a Gaussian");
        check_value(cloud.sh_degree <= 3, "GltfSplatArrays",
                    "the extension holds SH up to degree 3; use with_bands_up_to");
        const std::size_t N = cloud.size();
        const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
        std::vector<float> means, rotations, scales, opacities;
        for (std::size_t i = 0; i < N; ++i) {
            const vec3<float>&m = cloud.means[i], &s = cloud.log_scales[i];
            const quat<float> q = normalize(cloud.quats[i]);
            means.insert(means.end(), {m.x, m.y, m.z});
            rotations.insert(rotations.end(), {q.x, q.y, q.z, q.w});
            scales.insert(scales.end(), {std::exp(s.x), std::exp(s.y), std::exp(s.z)});
            opacities.push_back(sigmoid(cloud.opacity_logits[i]));
            const vec3<float> color = detail::unclamped_color<0>(&cloud.sh[i * basis], vec3<float>(0, 0, 1));
            for (int c = 0; c < 4; ++c)
                colors_.push_back(static_cast<std::uint8_t>(
                    std::lround(255 * std::clamp(c < 3 ? color[c] : opacities.back(), 0.0f, 1.0f))));
        }
        add("POSITION", std::move(means), 3);
        add("KHR_gaussian_splatting:ROTATION", std::move(rotations), 4);
        add("KHR_gaussian_splatting:SCALE", std::move(scales), 3);
        add("KHR_gaussian_splatting:OPACITY", std::move(opacities), 1);
        std::size_t k = 0;
        for (int degree = 0; degree <= cloud.sh_degree; ++degree)
            for (int n = 0; n <= 2 * degree; ++n, ++k) {
                std::vector<float> values;
                for (std::size_t i = 0; i < N; ++i) {
                    const vec3<float>& c = cloud.sh[i * basis + k];
                    values.insert(values.end(), {c.x, c.y, c.z});
                }
                add(sh_name(degree, n), std::move(values), 3);
            }
        color_view_ = file_->add_view(colors_.data(), colors_.size(), vertex_target);
    }

    /// A primitive of `count` Gaussians, from `first` on.
    [[nodiscard]] nlohmann::ordered_json primitive(std::size_t first, std::size_t count) const {
        nlohmann::ordered_json attributes;
        for (const Attribute& a : attributes_) {
            const auto width = static_cast<std::size_t>(a.width);
            attributes[a.name] = file_->add_accessor(a.view, first * width * sizeof(float),
                                                     Span<const float>(a.numbers).subspan(first * width, count * width),
                                                     {.width = a.width, .bounds = a.name == "POSITION"});
        }
        attributes["COLOR_0"] =
            file_->add_accessor(color_view_, 4 * first, Span<const std::uint8_t>(colors_).subspan(4 * first, 4 * count),
                                {.width = 4, .normalized = true});
        return {{"mode", 0},
                {"attributes", std::move(attributes)},
                {"extensions",
                 {{"KHR_gaussian_splatting",
                   {{"kernel", "ellipse"},
                    {"colorSpace", "srgb_rec709_display"},
                    {"projection", "perspective"},
                    {"sortingMethod", "cameraDistance"}}}}}};
    }

    [[nodiscard]] static std::string sh_name(int degree, int n) {
        return "KHR_gaussian_splatting:SH_DEGREE_" + std::to_string(degree) + "_COEF_" + std::to_string(n);
    }

private:
    struct Attribute {
        std::string name;
        int view, width;
        std::vector<float> numbers;
    };
    static constexpr int vertex_target = 34962;

    GlbWriter* file_;
    std::vector<Attribute> attributes_;
    std::vector<std::uint8_t> colors_;
    int color_view_ = 0;

    void add(const std::string& name, std::vector<float> numbers, int width) {
        const int view = file_->add_view(numbers.data(), numbers.size() * sizeof(float), vertex_target);
        attributes_.push_back({name, view, width, std::move(numbers)});
    }
};

/// States in a document that it has Gaussians, and their filter.
inline void begin_gltf_splats(GlbWriter& file, const SplatNotes& notes) {
    if (notes.filter)
        file.json["asset"]["extras"] = {
            {"gsh.filter",
             {{"dilation", notes.filter->dilation}, {"compensate_opacity", notes.filter->compensate_opacity}}}};
    file.json["extensionsUsed"] = {"KHR_gaussian_splatting"};
}

namespace detail {

/// What a document states about its Gaussians.
[[nodiscard]] inline SplatNotes notes_of_gltf(const GltfFile& file) {
    SplatNotes notes{.up = UpAxis::y};
    const nlohmann::json filter = file.asset_extras().value("gsh.filter", nlohmann::json());
    if (!filter.is_object()) return notes;
    const nlohmann::json dilation = filter.value("dilation", nlohmann::json()),
                         compensate = filter.value("compensate_opacity", nlohmann::json());
    if (dilation.is_number() && compensate.is_boolean() && dilation >= 0 && dilation < 1e6)
        notes.filter = PixelFilter{dilation.get<double>(), compensate.get<bool>()};
    return notes;
}

/// Throws IoError unless a primitive's Gaussians are of the kind that is read: not compressed, ellipses, with colours
/// in sRGB. `where` begins messages.
inline void check_gltf_gaussians(const GltfFile& file, const tinygltf::Value& extension, const std::string& where) {
    if (extension.Has("extensions"))
        file.fail(where + " holds compressed Gaussians, which this version does not read");
    for (const auto& [key, expected] : {std::pair{"kernel", "ellipse"}, {"colorSpace", "srgb_rec709_display"}}) {
        if (!extension.Has(key)) continue;
        const tinygltf::Value& found = extension.Get(key);
        if (!found.IsString() || found.Get<std::string>() != expected)
            file.fail(where + ": " + key + " is " +
                      (found.IsString() ? "'" + shortened(found.Get<std::string>()) + "'" : "not a text") +
                      ", expected '" + expected + "'");
    }
}

/// The Gaussians of a primitive, in the frame of its node. `where` begins messages.
///
/// Errors  those of GltfNumbers; IoError for an attribute that is missing or of another length; ValueError for negative
///         scales, opacities beyond 0 to 1 and quaternions of length 0.
[[nodiscard]] inline GaussianCloud<float> gaussians_of_primitive(const GltfFile& file, GltfNumbers& numbers,
                                                                 const tinygltf::Primitive& primitive,
                                                                 const std::string& where) {
    std::size_t count = 0;
    const auto read = [&](const std::string& name, int width) {
        const auto found = primitive.attributes.find(name);
        if (found == primitive.attributes.end()) file.fail(where + " has no " + name);
        std::vector<float> values = numbers.read<float>(found->second, width, where + ": " + name);
        const std::size_t size = values.size() / static_cast<std::size_t>(width);
        if (count == 0) count = size; // that of POSITION
        if (size != count)
            file.fail(where + ": " + name + " has " + std::to_string(size) + " elements, but POSITION " +
                      std::to_string(count));
        return values;
    };
    int degree = 0;
    while (degree < 3 && primitive.attributes.contains(GltfSplatArrays::sh_name(degree + 1, 0))) ++degree;
    const auto means = read("POSITION", 3), rotations = read("KHR_gaussian_splatting:ROTATION", 4),
               scales = read("KHR_gaussian_splatting:SCALE", 3), opacities = read("KHR_gaussian_splatting:OPACITY", 1);
    GaussianCloud<float> cloud(count, degree);
    for (std::size_t i = 0; i < count; ++i) {
        const auto check = [&](bool good, const char* what) {
            if (!good)
                throw ValueError(file.name() + ": " + where + ": Gaussian " + std::to_string(i) + " has " + what);
        };
        cloud.means[i] = {means[3 * i], means[3 * i + 1], means[3 * i + 2]};
        cloud.quats[i] = {rotations[4 * i + 3], rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2]};
        check(dot(cloud.quats[i], cloud.quats[i]) > 0, "a rotation of length 0");
        for (std::size_t k = 0; k < 3; ++k) {
            check(scales[3 * i + k] >= 0, "a negative scale");
            cloud.log_scales[i][static_cast<int>(k)] = std::log(std::max(scales[3 * i + k], 1e-9f));
        }
        check(opacities[i] >= 0 && opacities[i] <= 1, "an opacity that is not within 0 to 1");
        cloud.opacity_logits[i] = logit(std::clamp(opacities[i], 1e-6f, 1 - 1e-6f));
    }
    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    std::size_t k = 0;
    for (int l = 0; l <= degree; ++l)
        for (int n = 0; n <= 2 * l; ++n, ++k) {
            const std::vector<float> values = read(GltfSplatArrays::sh_name(l, n), 3);
            for (std::size_t i = 0; i < count; ++i)
                cloud.sh[i * basis + k] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
        }
    return cloud;
}

} // namespace detail

} // namespace gsh
