// SPDX-License-Identifier: Apache-2.0
/// @file  Both passes from the parameters of a static scene to a picture, on any backend, from and to host memory.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/device_arrays.hpp"
#include "support/needles.hpp"

#include <utility>

namespace gsh::test {

/// By factors or by covariances. With `weights`, also the gradient of the sum of weights * picture.
template <Backend B, class T>
struct NeedlePasses {
    Image<T> picture;
    GaussianCloud<T> gradient;

    NeedlePasses(B& backend, const GaussianCloud<T>& cloud, const Camera<T>& camera, bool factored,
                 const RasterParams<T>& params, const Image<T>* weights = nullptr)
        : picture(3, camera.height, camera.width) {
        Gaussians<B, T> gaussians, dL_dgaussians;
        upload(backend, cloud, gaussians);
        Splats<B, T> splats, dL_dsplats;
        splats.resize(cloud.size(), factored);
        const StaticSplats<B, 0, T> to_splats(backend);
        typename StaticSplats<B, 0, T>::Cache cache;
        to_splats.forward(std::as_const(gaussians).view(), camera.center(), splats.view(), cache);
        const Rasterizer<B, T> rasterizer(backend, params);
        typename Rasterizer<B, T>::Cache raster_cache;
        auto image = uploaded(backend, picture.data);
        const auto view = [&](auto& buffer) { return ImageView<T>{buffer, 3, camera.height, camera.width}; };
        const Background<T> background{.color = vec3<T>(needle_background)};
        const SplatView<const T> shown = std::as_const(splats).view();
        rasterizer.forward(camera, shown, background, {.color = view(image)}, raster_cache);
        picture.data = fetched(backend, image);
        if (!weights) return;
        auto dL_dimage = uploaded(backend, weights->data);
        dL_dsplats.resize(cloud.size(), factored);
        fill_zero(backend, dL_dsplats.view());
        rasterizer.backward(camera, shown, background, {.color = view(dL_dimage)}, raster_cache, dL_dsplats.view());
        dL_dgaussians.resize(cloud.size(), 0);
        fill_zero(backend, dL_dgaussians.view());
        to_splats.backward(std::as_const(gaussians).view(), camera.center(), std::as_const(dL_dsplats).view(), cache,
                           dL_dgaussians.view());
        gradient = download(backend, std::as_const(dL_dgaussians));
    }
};

/// Needles in single precision beside the dense renderer.
class NeedleComparison {
public:
    NeedleComparison(float log_length, bool compensate)
        : cloud_(needles(log_length, 60)), expected_(dense_picture(cloud_, needle_camera(), compensate)) {
        params_.compensate_opacity = compensate;
    }
    /// The largest difference of the pictures, by factors or by covariances.
    template <Backend B>
    [[nodiscard]] double error(B& backend, bool factored) const {
        const NeedlePasses<B, float> found(backend, cloud_, needle_camera().cast<float>(), factored, params_);
        return largest_error(found.picture, expected_);
    }

private:
    GaussianCloud<float> cloud_;
    DenseImage expected_;
    RasterParams<float> params_;
};

/// The largest difference of the log-scales' gradients, relative to the largest of them.
template <class T, class U>
[[nodiscard]] double relative_error(const GaussianCloud<T>& found, const GaussianCloud<U>& exact) {
    double largest = 0, error = 0;
    for (std::size_t i = 0; i < exact.size(); ++i)
        for (int k = 0; k < 3; ++k) {
            const double x = exact.log_scales[i][k], d = std::abs(static_cast<double>(found.log_scales[i][k]) - x);
            largest = std::max(largest, std::abs(x)), error = d <= error ? error : d; // a NaN stays
        }
    return error / largest;
}

/// Without a cut and without a stop, so that the picture is smooth.
template <class T>
[[nodiscard]] RasterParams<T> smooth_params(bool compensate) {
    RasterParams<T> params;
    params.alpha_min = T(1e-13), params.transmittance_min = 0;
    params.compensate_opacity = compensate, params.compensation_floor = T(1e-12);
    return params;
}

} // namespace gsh::test
