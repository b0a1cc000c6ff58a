// SPDX-License-Identifier: Apache-2.0
/// @file  Writes Gaussians as primitives of glTF (KHR_gaussian_splatting).
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/image/color.hpp>
#include <gsh/io/file/glb_writer.hpp>
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
/// they are. COLOR_0 is for viewers without the extension, which show points: the colour without its bands, in linear
/// light, and the opacity. It has 16 bits, because 8 would show steps in the dark.
///
/// Source  Khronos, KHR_gaussian_splatting, version of 15 April 2026; COLOR_0 from its section "Fallback Behavior".
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
                colors_.push_back(static_cast<std::uint16_t>(std::lround(
                    65535 * (c < 3 ? srgb_to_linear(std::clamp(color[c], 0.0f, 1.0f)) : opacities.back()))));
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
        color_view_ = file_->add_view(colors_.data(), colors_.size() * sizeof(std::uint16_t), vertex_target);
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
        attributes["COLOR_0"] = file_->add_accessor(color_view_, 8 * first,
                                                    Span<const std::uint16_t>(colors_).subspan(4 * first, 4 * count),
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
    std::vector<std::uint16_t> colors_;
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

} // namespace gsh
