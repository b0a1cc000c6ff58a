// SPDX-License-Identifier: Apache-2.0
/// @file  Scenes and avatars to pictures in host memory.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cstddef>
#include <utility>

namespace gsh::examples {

/// Keeps its buffers from picture to picture.
class Renderer {
public:
    using Backend = cpu::Threads;

    /// The filter is the scene's: an avatar's file says it, a plain PLY was made for the usual one.
    explicit Renderer(Backend& backend, const PixelFilter& filter = {})
        : backend_(&backend), rasterizer_(backend, raster_params<float>(filter)) {}

    /// An avatar in a frame of a motion.
    Image<float> render(const Avatar<Backend>& avatar, const Motion& motion, std::size_t frame, const Camera<double>& camera,
                        const vec3<float>& background) {
        const Camera<float> view = camera.cast<float>();
        avatar.rig().upload_pose(motion, frame, pose_);
        splats_.resize(avatar.size());
        avatar.pose(pose_, view.center(), splats_.view(), avatar_cache_);
        return draw(view, background);
    }

    /// A static 3DGS scene.
    Image<float> render(const GaussianCloud<float>& scene, const Camera<double>& camera, const vec3<float>& background) {
        const Camera<float> view = camera.cast<float>();
        Gaussians<Backend, float> gaussians;
        upload(*backend_, scene, gaussians);
        splats_.resize(scene.size());
        with_sh_degree(scene.sh_degree, [&](auto degree) {
            static_splats_forward<decltype(degree)::value>(*backend_, std::as_const(gaussians).view(), view.center(), splats_.view());
        });
        return draw(view, background);
    }

private:
    Image<float> draw(const Camera<float>& camera, const vec3<float>& background) {
        Image<float> picture(3, camera.height, camera.width);
        Backend::Buffer<float> pixels(picture.data.size());
        rasterizer_.forward(camera, std::as_const(splats_).view(), {.color = background},
                            {.color = ImageView<float>{pixels, 3, camera.height, camera.width}}, raster_cache_);
        backend_->download(Span<const float>(pixels), Span<float>(picture.data));
        return picture;
    }

    Backend* backend_;
    Rasterizer<Backend> rasterizer_;
    RigPose<Backend, float> pose_;
    Splats<Backend, float> splats_;
    Avatar<Backend>::Cache avatar_cache_;
    Rasterizer<Backend>::Cache raster_cache_;
};

} // namespace gsh::examples
