// SPDX-License-Identifier: Apache-2.0
/// @file  Gaussians that no photograph saw: found by their weight in all photographs, and filled from those that were
///        seen.
#pragma once

#include <gsh/avatar/facing_weights.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/surface_fill.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/ordered_indices.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/sym.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/model/filled_points.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/reduced_photos.hpp>
#include <gsh/render/rasterizer.hpp>
#include <gsh/setup/avatar_export.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

/// How many photographs show a Gaussian, see photographs_showing.
struct Showing {
    double all = 0;   ///< from behind, too
    double front = 0; ///< not from behind
};

/// Which Gaussians are unseen: those that hardly any photograph shows, and of those that photographs show only from
/// behind, through others, as many as hardly change the photographs.
struct UnseenParams {
    double least_photographs = 0.1; ///< a tenth of one is an edge-on glimpse
    double most_behind = 0.002;     ///< what is unseen may make up this share of what the photographs show
    /// Cosine of the angle between the surface's normal and the direction to the camera below which a photograph shows
    /// the surface from behind.
    double behind = 0;
    /// A Gaussian below this opacity is one that photographs have made transparent, and stays as it is.
    double least_opacity = 0.05;
    int pixels = 270; ///< about the longer side of the pictures in which they are searched
    std::size_t most_photographs = 2000; ///< of more, so many that chance chooses stand for all
    SurfaceFillParams fill = {};
};

namespace detail {

/// All of `count` photographs in order, or as many of them as may be, by chance.
[[nodiscard]] inline std::vector<std::uint32_t> chosen_photographs(std::size_t count, std::size_t most) {
    std::vector<std::uint32_t> order = shuffled_indices(static_cast<std::uint32_t>(count), 0);
    order.resize(std::min(count, most));
    std::sort(order.begin(), order.end());
    return order;
}

} // namespace detail

/// How many of the photographs show each Gaussian of a scene. A photograph counts 1 if the Gaussian is seen from the
/// front with nothing before it, and less if it is seen from the side or partly hidden:
///
///     n_i = sum over photographs and pixels  T G  /  (2π s s' f²/z²)
///
/// T is the transmittance in front of the Gaussian, G its unit-height footprint, s and s' its larger two standard
/// deviations, f²/z² the mean over the photographs, at the first person's root. T G is the derivative of a picture with
/// respect to the colour, divided by the opacity; one pass there and back for each photograph gives it for all
/// Gaussians, without any code in the renderer. `samples` of each person are those of its model. Pixels of photographs
/// are not read.
///
/// Shapes  the result is [N]; all Gaussians of the scene.
/// Errors  ValueError without photographs; ShapeError for samples of another model; those of Rasterizer.
template <Backend B, class Scene>
[[nodiscard]] std::vector<Showing> photographs_showing(B& backend, Scene& scene,
                                                       const std::vector<const SurfaceSamples*>& samples,
                                                       const std::vector<Photo>& photos,
                                                       const PixelFilter& filter, const UnseenParams& params = {}) {
    using T = typename Scene::Scalar;
    constexpr const char* where = "photographs_showing";
    check_value(!photos.empty(), where, "there are no photographs");
    check_size(where, "samples", samples.size(), scene.person_count(), "those of each person");
    const int factor = reduction_factor(Span<const Photo>(photos), params.pixels);
    std::vector<std::uint32_t> order =
        detail::chosen_photographs(photos.size(), std::max<std::size_t>(params.most_photographs, 1));
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return photos[a].frame < photos[b].frame; });

    const std::size_t N = scene.size();
    std::vector<vec3<T>> canonical_normals;
    for (std::size_t p = 0; p < samples.size(); ++p) {
        check_size(where, "samples of a person", samples[p]->size(), scene.model(p).size(), "those of the model");
        for (const vec3<double>& normal : samples[p]->normals) canonical_normals.push_back(vec3<T>(normal));
    }
    typename B::template Buffer<vec3<T>> normals(N);
    backend.upload(Span<const vec3<T>>(canonical_normals), normals);

    Rasterizer<B, T> rasterizer(backend, raster_params<T>(filter));
    RasterCache<B, T> cache;
    Splats<B, T> splats;
    splats.resize(N);
    typename B::template Buffer<vec3<T>> dL_dcolors(N), joints;
    typename B::template Buffer<T> picture, ones, all(N), front(N);
    for (auto* sums : {&all, &front}) backend.fill(Span<T>(*sums), T(0));
    std::vector<typename Rig<B, T>::Cache> rigs(samples.size());
    double squared_focal = 0; // of (f / z), a mean over photographs
    for (std::size_t k = 0; k < order.size(); ++k) {
        const Photo& photo = photos[order[k]];
        const Camera<double> reduced = reduced_camera(photo.camera, factor);
        const Camera<T> camera = reduced.cast<T>();
        if (k == 0 || photos[order[k - 1]].frame != photo.frame) {
            scene.prepare(photo.frame);
            for (std::size_t p = 0; p < samples.size(); ++p) {
                const Rig<B, T>& rig = scene.model(p).rig();
                joints.resize(rig.joint_count());
                backend.fill(Span<vec3<T>>(joints), vec3<T>(T(0))); // normals do not depend on them
                rig.forward(scene.pose(photo.frame, p), joints, rigs[p]);
            }
        }
        scene.forward(photo.frame, camera.center(), splats.view());
        const std::size_t size = 3 * static_cast<std::size_t>(camera.height) * static_cast<std::size_t>(camera.width);
        picture.resize(size), ones.resize(size);
        backend.fill(Span<T>(ones), T(1));
        backend.fill(Span<vec3<T>>(dL_dcolors), vec3<T>(T(0)));
        const auto image = [&](auto& buffer) {
            return ImageView<T>{Span<T>(buffer), 3, camera.height, camera.width};
        };
        const SplatView<const T> shown = std::as_const(splats).view();
        const Deferred<Camera<T>> input = camera;
        rasterizer.forward(input, shown, {}, {.color = image(picture)}, cache);
        rasterizer.backward(input, shown, {}, {.color = image(ones)}, cache,
                            SplatView<T>{.means = {}, .covariances = {}, .opacities = {}, .colors = dL_dcolors});
        for (std::size_t p = 0, first = 0; p < samples.size(); first += samples[p++]->size()) {
            const auto own = [&](auto span) { return span.subspan(first, samples[p]->size()); };
            backend.for_each(samples[p]->size(),
                             detail::AddFacingWeights<T>{scene.model(p).rig().skin(), rigs[p].bones,
                                                  own(Span<const vec3<T>>(normals)), own(shown.means),
                                                  own(Span<const vec3<T>>(dL_dcolors)), camera.center(),
                                                  T(params.behind), own(Span<T>(all)),
                                                  own(Span<T>(front))});
        }
        const double z = (reduced.R * scene.motion(0).transl[photo.frame] + reduced.t).z;
        squared_focal += reduced.fx * reduced.fy / (z * z) / static_cast<double>(order.size());
    }
    std::vector<T> all_weights(N), front_weights(N);
    backend.download(Span<const T>(all), Span<T>(all_weights));
    backend.download(Span<const T>(front), Span<T>(front_weights));
    std::vector<T> opacities(N);
    backend.download(Span<const T>(splats.opacities), Span<T>(opacities));
    std::vector<sym3<T>> covariances(N);
    backend.download(Span<const sym3<T>>(splats.covariances), Span<sym3<T>>(covariances));
    const double stands_for = static_cast<double>(photos.size()) / static_cast<double>(order.size());
    std::vector<Showing> result(N);
    for (std::size_t i = 0; i < N; ++i) {
        // The product of the larger two variances is about the sum of the principal minors of the covariance.
        const auto& c = covariances[i];
        const double minors = double(c.xx) * c.yy - double(c.xy) * c.xy + double(c.xx) * c.zz - double(c.xz) * c.xz +
                              double(c.yy) * c.zz - double(c.yz) * c.yz;
        const double area = 2 * 3.14159265358979 * std::sqrt(std::max(minors, 1e-16)) * squared_focal;
        const double one = std::max(static_cast<double>(opacities[i]), 1e-6) * area / stands_for;
        result[i] = {static_cast<double>(all_weights[i]) / one, static_cast<double>(front_weights[i]) / one};
    }
    return result;
}

/// Whether each Gaussian is unseen [N]. Of those that are only shown from behind, the ones that are shown least come
/// first.
[[nodiscard]] inline std::vector<std::uint8_t> unseen_points(Span<const Showing> showing,
                                                             const UnseenParams& params = {}) {
    std::vector<std::uint8_t> unseen(showing.size(), 0);
    double total = 0, made_up = 0;
    for (const Showing& one : showing) total += one.all;
    for (const std::uint32_t i : ordered_indices(showing.size(), [&](std::uint32_t a, std::uint32_t b) {
             return showing[a].all < showing[b].all;
         })) {
        if (showing[i].front >= params.least_photographs) continue;
        made_up += showing[i].all;
        unseen[i] = showing[i].all < params.least_photographs || made_up <= params.most_behind * total;
    }
    return unseen;
}

/// The fill of a person's Gaussians that no photograph saw. `showing` [N] are the person's numbers of
/// photographs_showing, `samples` those of the model. Colours, displacements and opacities come from Gaussians that
/// were seen, nearby and on the body's other side (SurfaceFill). Colours of several moments are means over `frames`.
/// Opacities only grow: what hides behind others has learned none.
///
/// Empty if all were seen, or none.
/// Errors  ShapeError for numbers or samples of another model.
template <class Scene>
[[nodiscard]] PointFill<typename Scene::Scalar> fill_of_unseen(Scene& scene, const SurfaceSamples& samples,
                                                               Span<const Showing> showing,
                                                               const std::vector<std::size_t>& frames,
                                                               std::size_t person = 0,
                                                               const UnseenParams& params = {}) {
    using T = typename Scene::Scalar;
    constexpr const char* where = "fill_of_unseen";
    const std::size_t N = scene.model(person).size();
    check_size(where, "samples", samples.size(), N, "those of the model");
    check_size(where, "showing", showing.size(), N, "those of the person's Gaussians");
    const GaussianCloud<T> cloud = mean_gaussians(scene, frames, person);
    const auto basis = cloud.sh.size() / std::max<std::size_t>(N, 1);
    const double least_logit = std::log(params.least_opacity / (1 - params.least_opacity));
    // Transparent ones are neither filled nor fill others.
    std::vector<vec3<double>> positions, normals;
    std::vector<std::size_t> opaque;
    for (std::size_t i = 0; i < N; ++i)
        if (static_cast<double>(cloud.opacity_logits[i]) > least_logit) {
            opaque.push_back(i);
            positions.push_back(samples.positions[i]), normals.push_back(samples.normals[i]);
        }
    const std::vector<std::uint8_t> unseen = unseen_points(showing, params);
    std::vector<std::uint8_t> known(opaque.size());
    for (std::size_t k = 0; k < opaque.size(); ++k) known[k] = !unseen[opaque[k]];
    const SurfaceFill surface(positions, normals, known, params.fill);

    PointFill<T> fill;
    for (const std::size_t k : surface.filled()) fill.points.push_back(static_cast<std::uint32_t>(opaque[k]));
    if (fill.points.empty()) return fill;
    const auto filled = [&](const auto& value, double mirrored = 1) {
        std::vector<double> values(opaque.size());
        for (std::size_t k = 0; k < values.size(); ++k) values[k] = static_cast<double>(value(opaque[k]));
        return surface.fill(values, mirrored);
    };
    fill.colors.resize(fill.points.size()), fill.displacements.resize(fill.points.size());
    for (int axis = 0; axis < 3; ++axis) {
        const auto colors = filled([&](std::size_t i) { return cloud.sh[i * basis][axis]; });
        const auto moved = filled(
            [&](std::size_t i) { return static_cast<double>(cloud.means[i][axis]) - samples.positions[i][axis]; },
            axis == 0 ? -1 : 1);
        for (std::size_t k = 0; k < fill.points.size(); ++k)
            fill.colors[k][axis] = static_cast<T>(colors[k]), fill.displacements[k][axis] = static_cast<T>(moved[k]);
    }
    const auto logits = filled([&](std::size_t i) { return cloud.opacity_logits[i]; });
    for (std::size_t k = 0; k < fill.points.size(); ++k)
        fill.opacity_logits.push_back(std::max(static_cast<T>(logits[k]), cloud.opacity_logits[fill.points[k]]));
    return fill;
}

} // namespace gsh
