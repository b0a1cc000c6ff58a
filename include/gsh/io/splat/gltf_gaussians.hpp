// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the Gaussians of one primitive of glTF (KHR_gaussian_splatting), and what the file states about them.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/gltf_file.hpp>
#include <gsh/io/file/gltf_numbers.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/gltf_primitive.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/activation.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh::detail {

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

/// What a primitive's extension states. Extensions inside it, such as notes of a program, are allowed to be unknown:
/// those that change the meaning of the attributes must be in extensionsRequired, where GltfFile refuses them.
struct GltfSplatTraits {
    bool linear_colors = false;        ///< the SH sum to linear light instead of sRGB
    std::vector<std::string> inside;   ///< names of extensions inside
    std::vector<std::string> warnings; ///< without the file's name

    /// `where` begins messages.
    /// Errors  IoError for a colour space that is not known, or a property that is not a text.
    GltfSplatTraits(const GltfFile& file, const tinygltf::Value& extension, const std::string& where) {
        const auto text = [&](const char* key, const char* otherwise) {
            if (!extension.Has(key)) return std::string(otherwise);
            if (!extension.Get(key).IsString()) file.fail(where + ": " + key + " is not a text");
            return extension.Get(key).Get<std::string>();
        };
        const std::string space = text("colorSpace", "srgb_rec709_display");
        linear_colors = space == "lin_rec709_display";
        if (!linear_colors && space != "srgb_rec709_display")
            file.fail(where + ": colorSpace is '" + shortened(space) +
                      "', expected 'srgb_rec709_display' or 'lin_rec709_display'");
        // A renderer may ignore values that it does not know.
        if (const std::string kernel = text("kernel", "ellipse"); kernel != "ellipse")
            warnings.push_back(where + ": kernel is '" + shortened(kernel) +
                               "', which is not known; the Gaussians are read as ellipses");
        if (const std::string projection = text("projection", "perspective"); projection != "perspective")
            warnings.push_back(where + ": projection is '" + shortened(projection) +
                               "', which is not known; the Gaussians are drawn in perspective");
        if (extension.Has("extensions")) inside = extension.Get("extensions").Keys();
    }
};

/// The Gaussians that a primitive draws, in the frame of its node: with indices, those that they list, in their order.
/// `log_scales` holds the numbers of the file; finish_gltf_scales makes logarithms of them. `where` begins messages.
///
/// Errors  those of GltfNumbers; IoError for another mode than points, an attribute that is missing or of another
///         length; ValueError for opacities beyond 0 to 1 and quaternions of length 0.
[[nodiscard]] inline GaussianCloud<float> gaussians_of_primitive(const GltfFile& file, GltfNumbers& numbers,
                                                                 const tinygltf::Primitive& primitive,
                                                                 const GltfSplatTraits& traits,
                                                                 const std::string& where) {
    if (primitive.mode != TINYGLTF_MODE_POINTS)
        file.fail(where + ": mode is " + std::to_string(primitive.mode) + ", expected 0: Gaussians are points");
    std::size_t count = 0;
    const auto read = [&](const std::string& name, int width) {
        const auto found = primitive.attributes.find(name);
        if (found == primitive.attributes.end())
            file.fail(where + " has no " + name +
                      (traits.inside.empty() ? ""
                                             : "; what is in the extension " + shortened(traits.inside[0]) +
                                                   " is not read; export the file without it"));
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
        const auto rotation =
            rotation_of_file({rotations[4 * i + 3], rotations[4 * i], rotations[4 * i + 1], rotations[4 * i + 2]});
        check(rotation.has_value(), "a rotation of length 0");
        cloud.quats[i] = *rotation;
        cloud.log_scales[i] = {scales[3 * i], scales[3 * i + 1], scales[3 * i + 2]};
        check(opacities[i] >= 0 && opacities[i] <= 1, "an opacity that is not within 0 to 1");
        cloud.opacity_logits[i] = std::clamp(float(logit(double(opacities[i]))), -certain_logit, certain_logit);
    }
    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    std::size_t k = 0;
    for (int l = 0; l <= degree; ++l)
        for (int n = 0; n <= 2 * l; ++n, ++k) {
            const std::vector<float> values = read(GltfSplatArrays::sh_name(l, n), 3);
            for (std::size_t i = 0; i < count; ++i)
                cloud.sh[i * basis + k] = {values[3 * i], values[3 * i + 1], values[3 * i + 2]};
        }
    if (primitive.indices == -1) return cloud;
    const std::vector<std::uint32_t> drawn = numbers.read_indices(primitive.indices, count, where + ": indices");
    numbers.count_copies(drawn.size() * (11 + 3 * basis), where);
    return reordered(cloud, Span<const std::uint32_t>(drawn));
}

} // namespace gsh::detail
