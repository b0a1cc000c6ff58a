// SPDX-License-Identifier: Apache-2.0
/// @file  Scenes and avatars to pictures in host memory.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cstddef>
#include <vector>

namespace gsh::examples {

/// Somebody in a picture: an avatar in a frame of a motion. The caller owns both.
struct Pose {
    const Avatar<cpu::Threads>* avatar = nullptr;
    const Motion* motion = nullptr;
    std::size_t frame = 0;
};

/// The filter that avatars are drawn with together: all of them must have learned with the same.
/// Errors  ValueError if they did not.
PixelFilter common_filter(const std::vector<AvatarData>& avatars);

/// Keeps its buffers from picture to picture.
class Renderer {
public:
    using Backend = cpu::Threads;

    /// The filter is the scene's: an avatar's file says it, a plain PLY was made for the usual one.
    explicit Renderer(Backend& backend, const PixelFilter& filter = {});
    ~Renderer();

    /// Avatars in one scene: whoever stands in front hides the others.
    Image<float> render(const std::vector<Pose>& people, const Camera<double>& camera, const vec3<float>& background);

    /// A static 3DGS scene.
    Image<float> render(const GaussianCloud<float>& scene, const Camera<double>& camera, const vec3<float>& background);

private:
    Image<float> draw(const Camera<float>& camera, const vec3<float>& background);

    Backend* backend_;
    Rasterizer<Backend> rasterizer_;
    RigPose<Backend, float> pose_;
    Splats<Backend, float> splats_;
    std::vector<Avatar<Backend>::Cache> avatar_caches_; // one per person
    Rasterizer<Backend>::Cache raster_cache_;
};

} // namespace gsh::examples
