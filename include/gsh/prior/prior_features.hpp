// SPDX-License-Identifier: Apache-2.0
/// @file  The paper's depth and normal features: prior views sampled at canonical points.
#pragma once

#include <gsh/body/skinning.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/orthographic_camera.hpp>
#include <gsh/prior/prior_view.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>
#include <vector>

namespace gsh {

/// The definition of the depth feature.
enum class DepthFeature {
    difference, ///< the map's depth minus the point's: how far the point lies in front of the visible surface
    raw,        ///< the map's depth, as in the paper
};
template <>
struct EnumNames<DepthFeature> {
    static constexpr std::array<std::string_view, 2> names{"difference", "raw"};
};

struct PriorFeatureParams {
    DepthFeature depth = DepthFeature::difference;
    double depth_unit = 0.1; ///< metres per unit of the feature; a limb's thickness, so that inputs are of order 1

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("prior.depth_feature", self.depth, SettingRange());
        f("prior.depth_unit", self.depth_unit, SettingRange::above(0));
    }
};

/// φ_d: for each point and view, the feature from the view's depth map at the point's projection.
///
/// A point is posed with the view's bones and projected, and the map is sampled bilinearly. Pixels outside the mask are
/// ignored, and the weights of the others are scaled to a sum of 1. If none of the four pixels is valid, the feature is
/// 0.
///
/// Shapes  points [N]; skin [N], used only for views with bones; result [N, views] row-major.
/// Frame   points in the canonical frame.
/// Units   params.depth_unit metres correspond to 1; the sign is positive if the point lies in front of the surface.
/// Errors  ShapeError or ValueError for views that are not depth, weights of the wrong size, or a unit that is not
///         positive.
/// Source  paper §3.4, equation 13: d_v = D_v(π_v(x₀)), which is DepthFeature::raw with a unit of 1.
[[nodiscard]] inline std::vector<double> depth_features(Span<const vec3<double>> points, Span<const PriorView> views,
                                                        const SkinWeights<double>& skin = {},
                                                        const PriorFeatureParams& params = {});

/// φ_n: for each point and view, the unit normal of the view's map at the point's projection, in the canonical frame.
/// It is sampled as the depth is, and is 0 where no pixel is valid.
///
/// Normals transform from the canonical pose to the view's by M⁻ᵀ, where M is the point's blended transform. A map's
/// normal n therefore transforms back to Mᵀ n, which is then normalised.
///
/// Shapes  points [N]; skin [N], used only for views with bones; result [N, 3 views] row-major.
/// Frame   points and result in the canonical frame.
/// Errors  ShapeError or ValueError for views that are not normals, or weights of the wrong size.
/// Source  paper §3.4, equation 14. The transform by Mᵀ is ours; the paper's views are canonical.
[[nodiscard]] inline std::vector<double> normal_features(Span<const vec3<double>> points, Span<const PriorView> views,
                                                         const SkinWeights<double>& skin = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The bilinear mean of the valid pixels, per channel; no value if there are none. Points at or behind a pinhole
/// camera's plane have no sample.
template <int Channels, class AnyCamera>
[[nodiscard]] std::optional<vec3<double>> sample_prior(const PriorMap& map, const AnyCamera& camera,
                                                       const vec3<double>& p) {
    if (std::is_same_v<AnyCamera, Camera<double>> && !(p.z > 0)) return {};
    const BilinearTaps<double> taps(to_pixel(camera, p), camera.height, camera.width);
    vec3<double> sum(0);
    double weight = 0;
    for (int k = 0; k < 4; ++k) {
        if (!map.mask.data[taps.index[k]] || !(taps.weight[k] > 0)) continue;
        weight += taps.weight[k];
        for (int c = 0; c < Channels; ++c) sum[c] += taps.weight[k] * map.values.view().row(c, 0)[taps.index[k]];
    }
    if (!(weight > 0)) return {};
    return sum * (1 / weight);
}

/// Calls body(i, view index, camera, blended transform, point in camera coordinates, sample) for every point and view
/// with a valid sample.
///
/// Errors  ShapeError or ValueError for views without `Channels` channels, or weights of the wrong size.
template <int Channels, class Body>
void visit_prior_views(std::string_view where, Span<const vec3<double>> points, Span<const PriorView> views,
                       const SkinWeights<double>& skin, const Body& body) {
    for (std::size_t v = 0; v < views.size(); ++v) {
        const PriorView& view = views[v];
        const std::string name = "views[" + std::to_string(v) + "]";
        check_prior_view(where, name, view, Channels);
        if (!view.bones.empty()) {
            check_size(where, "skin.weights", skin.size(), points.size(),
                       name + " has a pose: give each point's weights");
            check_skin(where, skin, points.size());
            for (std::size_t k = 0; k < skin.joints.size(); ++k)
                if (skin.joints[k] >= view.bones.size())
                    check_size(where, name + ".bones", view.bones.size(), std::size_t(skin.joints[k]) + 1,
                               "store one per joint of the skin weights");
        }
        std::visit(
            [&](const auto& camera) {
                for (std::size_t i = 0; i < points.size(); ++i) {
                    const Affine<double> M = view.bones.empty() ? Affine<double>() : blend<double>(skin, i, view.bones);
                    const vec3<double> p = to_camera(camera, M(points[i]));
                    if (const auto sample = sample_prior<Channels>(view.map, camera, p))
                        body(i, v, camera, M, p, *sample);
                }
            },
            view.camera);
    }
}

} // namespace detail

inline std::vector<double> depth_features(Span<const vec3<double>> points, Span<const PriorView> views,
                                          const SkinWeights<double>& skin, const PriorFeatureParams& params) {
    check_value(params.depth_unit > 0, "depth_features",
                "depth_unit is " + detail::number_text(params.depth_unit) + ", expected metres above 0");
    std::vector<double> features(points.size() * views.size(), 0);
    detail::visit_prior_views<1>(
        "depth_features", points, views, skin,
        [&](std::size_t i, std::size_t v, const auto&, const Affine<double>&, const vec3<double>& p,
            const vec3<double>& sample) {
            const double own = params.depth == DepthFeature::difference ? p.z : 0;
            features[i * views.size() + v] = (sample.x - own) / params.depth_unit;
        });
    return features;
}

inline std::vector<double> normal_features(Span<const vec3<double>> points, Span<const PriorView> views,
                                           const SkinWeights<double>& skin) {
    std::vector<double> features(points.size() * 3 * views.size(), 0);
    detail::visit_prior_views<3>(
        "normal_features", points, views, skin,
        [&](std::size_t i, std::size_t v, const auto& camera, const Affine<double>& M, const vec3<double>&,
            const vec3<double>& sample) {
            const vec3<double> normal = transposed_times(M.linear, transposed_times(camera.R, sample));
            const double size = length(normal);
            if (!(size > 0)) return; // opposite normals, or a singular transform
            for (int k = 0; k < 3; ++k)
                features[(i * views.size() + v) * 3 + static_cast<std::size_t>(k)] = normal[k] / size;
        });
    return features;
}

} // namespace gsh
