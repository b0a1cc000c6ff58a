// SPDX-License-Identifier: Apache-2.0
/// @file  Bilateral normal integration: a depth map from a normal map, with discontinuities preserved.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/bilateral_solver.hpp>
#include <gsh/prior/orthographic_camera.hpp>
#include <gsh/prior/prior_view.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace gsh {

struct IntegratedDepth {
    PriorView view;         ///< depth where the normals are valid; camera and bones are those of the normals
    double energy = 0;      ///< weighted squared residuals, pixels
    int iterations = 0;     ///< solves
    bool converged = false; ///< whether the tolerance was reached
};

/// Computes the depth whose slopes fit a normal map.
///
/// Every pixel has a slope from its normal, which is compared with two one-sided differences of depth along each axis:
///     minimise  Σ w⁺ (n_z Δ⁺z + n_x)² + w⁻ (n_z Δ⁻z + n_x)²  (and likewise for y with n_y)  +  λ (z - z_prior)²,
///     w⁺ = sigmoid(k ((n_z Δ⁻z)² - (n_z Δ⁺z)²)),  w⁻ = 1 - w⁺.
/// The solver alternates between computing the weights from the last z and solving for z. At a depth discontinuity each
/// pixel is coupled to the neighbour on its own surface, and the jump adds nothing to the energy. z is in pixels. For a
/// pinhole camera z is the logarithm of depth times the focal length, and n_z becomes n·ray. A difference across the
/// mask's border counts as 0 in w and has no residual. A pyramid starts at 16 pixels and doubles the resolution. Coarse
/// levels find long steps in a few solves and reach a lower energy.
///
/// Normals alone leave one offset undetermined per connected component of the mask. Without a prior, each component has
/// mean depth 0 (orthographic) or mean log depth 0 (pinhole: one metre). A prior, such as the mesh's depth in the same
/// camera, determines the offset where its mask is set. It also relates components that only discontinuities connect.
///
/// Frame   normals as in PriorView; a map of the far side can be integrated as well.
/// Errors  ShapeError or ValueError for a map that does not contain normals, an empty mask, a prior of another camera,
///         or params out of range; Error if a solve fails.
/// Source  Cao et al., "Bilateral Normal Integration", 2022, equations 8 to 16; the prior's term as in Xiu et al.,
///         "ECON", 2023.
template <std::same_as<double> T = double> // a template for BilateralIntegrator's reason
[[nodiscard]] IntegratedDepth integrate_normals(const PriorView& normals, const PriorView* depth_prior = nullptr,
                                                const NormalIntegrationParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

[[nodiscard]] inline SlopeEquations slope_equations(const OrthographicCamera&, const vec2<double>&,
                                                    const vec3<double>& n) {
    return {{n.z, n.z}, {n.x, n.y}};
}
[[nodiscard]] inline SlopeEquations slope_equations(const Camera<double>& camera, const vec2<double>& pixel,
                                                    const vec3<double>& n) {
    const vec3<double> ray((pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy, 1);
    const double facing = dot(n, ray);
    return {{facing, facing * camera.fy / camera.fx}, {n.x, n.y}};
}

/// Limits the slopes at silhouettes. There, smooth normals turn away from the viewer and slopes grow without bound,
/// which distorts components that are connected only by such pixels. Equations of normals that face the other way than
/// the majority are dropped, and slopes are limited to 84 degrees.
inline void tame(std::vector<SlopeEquations>& equations) {
    constexpr double steepest = 10;
    double facing = 0;
    for (const auto& e : equations) facing += e.a[0];
    for (auto& e : equations)
        for (int axis = 0; axis < 2; ++axis) {
            if (!(e.a[axis] * facing > 0)) e.a[axis] = e.b[axis] = 0;
            const double most = steepest * std::abs(e.a[axis]);
            e.b[axis] = std::clamp(e.b[axis], -most, most);
        }
}

/// Conversion between depth in metres and z of the equations.
[[nodiscard]] inline double pixels_from_depth(const OrthographicCamera& c, double depth) { return depth * c.scale; }
[[nodiscard]] inline double depth_from_pixels(const OrthographicCamera& c, double z) { return z / c.scale; }
[[nodiscard]] inline double pixels_from_depth(const Camera<double>& c, double depth) { return std::log(depth) * c.fx; }
[[nodiscard]] inline double depth_from_pixels(const Camera<double>& c, double z) { return std::exp(z / c.fx); }

/// The input at one level of the pyramid.
template <class AnyCamera>
struct IntegrationLevel {
    AnyCamera camera;
    PriorMap normals, prior; ///< without a prior its mask is 0 everywhere
    double prior_weight;

    /// The level at half the resolution: means of the valid values in each 2 x 2 block. Means of differing normals are
    /// shorter than 1 and are not normalised, which reduces the weight of their equations.
    [[nodiscard]] IntegrationLevel halved() const {
        IntegrationLevel half{camera, halved(normals), halved(prior), 4 * prior_weight}; // z in pixels halves
        half.camera.cx /= 2, half.camera.cy /= 2;
        half.camera.width = half.normals.mask.width, half.camera.height = half.normals.mask.height;
        if constexpr (requires { camera.scale; }) half.camera.scale /= 2;
        else half.camera.fx /= 2, half.camera.fy /= 2;
        return half;
    }

private:
    [[nodiscard]] static PriorMap halved(const PriorMap& map) {
        const int height = (map.mask.height + 1) / 2, width = (map.mask.width + 1) / 2, channels = map.values.channels;
        PriorMap half{Image<double>(channels, height, width), Image<std::uint8_t>(1, height, width)};
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                int count = 0;
                for (int k = 0; k < 4; ++k) {
                    const int row = 2 * y + k / 2, column = 2 * x + k % 2;
                    if (row >= map.mask.height || column >= map.mask.width || !map.mask.at(0, row, column)) continue;
                    ++count;
                    for (int c = 0; c < channels; ++c) half.values.at(c, y, x) += map.values.at(c, row, column);
                }
                half.mask.at(0, y, x) = count > 0;
                for (int c = 0; c < channels && count > 0; ++c) half.values.at(c, y, x) /= count;
            }
        return half;
    }
};

/// z of the valid pixels. Coarse levels are solved first, so that discontinuities are found while they are few pixels
/// long.
template <class AnyCamera>
[[nodiscard]] Eigen::VectorXd integrate_level(const IntegrationLevel<AnyCamera>& level, const IntegrationGrid& grid,
                                              const NormalIntegrationParams& params, IntegrationReport& report) {
    const auto width = static_cast<std::size_t>(level.camera.width);
    Eigen::VectorXd z = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(grid.size())), prior = z, prior_weights = z;
    std::vector<SlopeEquations> equations(grid.size());
    for (std::size_t i = 0; i < grid.size(); ++i) {
        const std::size_t pixel = grid.pixels[i];
        vec3<double> normal;
        for (int k = 0; k < 3; ++k) normal[k] = level.normals.values.view().row(k, 0)[pixel];
        equations[i] = slope_equations(level.camera, pixel_center<double>(pixel, level.camera.width), normal);
        if (!level.prior.mask.data[pixel]) continue;
        const auto e = static_cast<Eigen::Index>(i);
        prior[e] = pixels_from_depth(level.camera, level.prior.values.data[pixel]);
        check_value(std::isfinite(prior[e]), "integrate_normals", "depth_prior has a depth that is not above 0");
        prior_weights[e] = level.prior_weight;
    }
    tame(equations);
    constexpr int coarsest = 16; // pixels
    if (std::min(level.camera.width, level.camera.height) >= 2 * coarsest) {
        const IntegrationLevel<AnyCamera> half = level.halved();
        const IntegrationGrid half_grid(half.normals.mask);
        const Eigen::VectorXd half_z = integrate_level(half, half_grid, params, report);
        std::vector<Eigen::Index> number(half.normals.mask.data.size());
        for (std::size_t i = 0; i < half_grid.size(); ++i) number[half_grid.pixels[i]] = static_cast<Eigen::Index>(i);
        for (std::size_t i = 0; i < grid.size(); ++i) {
            // From the block's centre each pixel follows its own slope, half a pixel along each axis.
            const std::size_t x = grid.pixels[i] % width, y = grid.pixels[i] / width;
            const auto& [a, b] = equations[i];
            double& own = z[static_cast<Eigen::Index>(i)];
            own = 2 * half_z[number[y / 2 * static_cast<std::size_t>(half.camera.width) + x / 2]];
            const auto slope = [](double facing, double along) {
                return facing != 0 ? std::clamp(-along / facing, -4.0, 4.0) : 0.0;
            };
            own += (x % 2 ? 0.5 : -0.5) * slope(a[0], b[0]) + (y % 2 ? 0.5 : -0.5) * slope(a[1], b[1]);
        }
    }
    BilateralIntegrator<> integrator(grid, equations, std::move(prior), std::move(prior_weights), params, std::move(z));
    report = integrator.run();
    return integrator.z();
}

inline void check_integration(const PriorView& normals, const PriorView* depth_prior,
                              const NormalIntegrationParams& params) {
    constexpr std::string_view where = "integrate_normals";
    check_prior_view(where, "normals", normals, 3);
    const auto positive = [&](const char* name, double value) {
        check_value(value > 0 && std::isfinite(value), where,
                    std::string("params.") + name + " is " + detail::number_text(value) +
                        ", expected a number above 0");
    };
    positive("max_iterations", params.max_iterations);
    positive("solver_tolerance", params.solver_tolerance);
    check_value(params.sharpness >= 0 && params.tolerance >= 0 && params.prior_weight >= 0, where,
                "sharpness, tolerance and prior_weight must not be negative");
    if (!depth_prior) return;
    check_prior_view(where, "depth_prior", *depth_prior, 1);
    const auto same = [](const auto& a, const auto& b) {
        if constexpr (std::is_same_v<decltype(a), decltype(b)>) {
            const vec3<double> shift = a.t - b.t;
            bool equal = a.cx == b.cx && a.cy == b.cy && length(shift) == 0 && a.R == b.R;
            if constexpr (requires { a.scale; }) return equal && a.scale == b.scale;
            else return equal && a.fx == b.fx && a.fy == b.fy;
        } else
            return false;
    };
    check_value(depth_prior->map.mask.height == normals.map.mask.height &&
                    depth_prior->map.mask.width == normals.map.mask.width &&
                    std::visit(same, normals.camera, depth_prior->camera),
                where, "depth_prior was seen by another camera than the normals; render it with theirs");
}

} // namespace detail

template <std::same_as<double> T>
IntegratedDepth integrate_normals(const PriorView& normals, const PriorView* depth_prior,
                                  const NormalIntegrationParams& params) {
    detail::check_integration(normals, depth_prior, params);
    const detail::IntegrationGrid grid(normals.map.mask);
    check_value(grid.size() > 0, "integrate_normals", "the mask is empty; no pixel has a normal");
    const int height = normals.map.mask.height, width = normals.map.mask.width;
    return std::visit(
        [&](const auto& camera) {
            const PriorMap no_prior{Image<double>(1, height, width), Image<std::uint8_t>(1, height, width)};
            const detail::IntegrationLevel<std::remove_cvref_t<decltype(camera)>> level{
                camera, normals.map, depth_prior ? depth_prior->map : no_prior, params.prior_weight};
            detail::IntegrationReport report;
            Eigen::VectorXd z = detail::integrate_level(level, grid, params, report);
            grid.for_each_piece([&](const std::vector<std::size_t>& piece) {
                double sum = 0;
                for (const std::size_t i : piece) {
                    if (params.prior_weight > 0 && level.prior.mask.data[grid.pixels[i]]) return;
                    sum += z[static_cast<Eigen::Index>(i)];
                }
                for (const std::size_t i : piece)
                    z[static_cast<Eigen::Index>(i)] -= sum / static_cast<double>(piece.size());
            });
            IntegratedDepth result{{normals.camera, no_prior, normals.bones}, report.energy, report.iterations,
                                   report.converged};
            for (std::size_t i = 0; i < grid.size(); ++i) {
                result.view.map.values.data[grid.pixels[i]] =
                    detail::depth_from_pixels(camera, z[static_cast<Eigen::Index>(i)]);
                result.view.map.mask.data[grid.pixels[i]] = 1;
            }
            return result;
        },
        normals.camera);
}

} // namespace gsh
