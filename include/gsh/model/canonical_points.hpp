// SPDX-License-Identifier: Apache-2.0
/// @file  The canonical points of an avatar, as inputs of its fields: positions, unit cube, regions, prior features.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/thinned_samples.hpp>
#include <gsh/core/enum_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/setting.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/box.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <memory>
#include <optional>
#include <string_view>
#include <vector>

namespace gsh {

/// Inputs of fields at the canonical points, beside their positions. Any may be missing.
///
/// Shapes  region [N], τ of a RegionMask in [0, 1]; features [N, any number] row-major: depths and normals of prior
///         views.
struct CanonicalPriors {
    std::vector<double> region;
    std::vector<double> features;
    /// Contains the points of which these are a part, so that fields of both have the same domain. Missing: the points
    /// are all there are.
    std::optional<Box> whole = {};
};

/// The priors of every stride-th of `points`, which are all that these priors are of.
[[nodiscard]] inline CanonicalPriors thinned(const CanonicalPriors& priors, Span<const vec3<double>> points,
                                             std::size_t stride) {
    return {.region = thinned_rows(priors.region, 1, stride),
            .features = thinned_rows(priors.features, priors.features.size() / points.size(), stride),
            .whole = priors.whole ? priors.whole : box_of_points(points)};
}

/// Which inputs there are.
struct PriorInputs {
    std::size_t feature_count = 0; ///< prior features of a point
    bool has_region = false;
};

/// What is mapped to the unit cube, the domain of fields.
enum class FieldBounds {
    cube, ///< the points' bounding cube: cells of a hash level are cubes
    box   ///< the points' bounding box, stretched along each axis, as in Animatable 3D Gaussian
};
template <>
struct EnumNames<FieldBounds> {
    static constexpr std::array<std::string_view, 2> names{"cube", "box"};
};

/// How positions are mapped to the unit cube, and the scale of prior features.
struct CanonicalPointsParams {
    FieldBounds bounds = FieldBounds::cube;
    double bounds_margin = 1.05; ///< size of the cube or box, as a multiple of the points' own
    /// Factor on CanonicalPriors::features. Adam moves all weights equally fast, so the factor sets how fast a network
    /// learns to use the features. At 1 they dominate what the encoding learns point by point.
    double prior_scale = 0.1;

    template <class Self, class F>
    static void for_each_setting(Self& self, const F& f) {
        f("bounds", self.bounds, SettingRange());
        f("bounds_margin", self.bounds_margin, SettingRange::at_least(1));
        f("prior.scale", self.prior_scale, SettingRange::above(0));
    }
};

/// Canonical points in a backend's memory. They never change. All fields of an avatar share them.
///
/// Shapes  positions [N] metres; unit [N] in [0, 1]^3; region [N] or empty; features [N, feature_count()], scaled.
/// Errors  ShapeError, ValueError: no points, priors of other points, settings out of range.
template <Backend B, std::floating_point T = float>
class CanonicalPoints {
public:
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    CanonicalPoints(B& backend, Span<const vec3<double>> positions, const CanonicalPriors& priors = {},
                    const CanonicalPointsParams& params = {}) {
        constexpr const char* where = "CanonicalPoints";
        check_value(!positions.empty(), where, "there are no points, expected at least one");
        check_ranges(where, params);
        if (!priors.region.empty())
            check_size(where, "priors.region", priors.region.size(), positions.size(), "one τ per point, or none");
        check_value(priors.features.size() % positions.size() == 0, where,
                    "priors.features must hold the same number of features for every point");

        const auto [low, high] = priors.whole ? *priors.whole : box_of_points(positions);
        const vec3<double> center = (low + high) * 0.5, extent = high - low;
        constexpr double least = 1e-6; // metres, for points that all lie in a plane
        vec3<double> edges(std::max({extent.x, extent.y, extent.z, least}));
        if (params.bounds == FieldBounds::box)
            for (int axis = 0; axis < 3; ++axis) edges[axis] = std::max(extent[axis], least);
        edges *= params.bounds_margin;

        std::vector<vec3<T>> here, unit;
        for (const auto& p : positions) {
            here.push_back(vec3<T>(p));
            unit.push_back(vec3<T>((p - center) / edges + vec3<double>(0.5)));
        }
        const std::vector<T> region(priors.region.begin(), priors.region.end());
        std::vector<T> features;
        for (const double feature : priors.features) features.push_back(static_cast<T>(params.prior_scale * feature));
        assign(backend, here, positions_);
        assign(backend, unit, unit_);
        assign(backend, region, region_);
        assign(backend, features, features_);
    }

    [[nodiscard]] std::size_t size() const { return positions_.size(); }
    [[nodiscard]] std::size_t feature_count() const { return features_.size() / size(); }
    [[nodiscard]] PriorInputs inputs() const { return {feature_count(), !region_.empty()}; }
    [[nodiscard]] Span<const vec3<T>> positions() const { return positions_; }
    [[nodiscard]] Span<const vec3<T>> unit() const { return unit_; }
    [[nodiscard]] Span<const T> region() const { return region_; }
    [[nodiscard]] Span<const T> features() const { return features_; }

private:
    Buffer<vec3<T>> positions_, unit_;
    Buffer<T> region_, features_;
};

/// Points owned jointly by the parts of one avatar.
template <Backend B, std::floating_point T = float>
using SharedPoints = std::shared_ptr<const CanonicalPoints<B, T>>;

} // namespace gsh
