// SPDX-License-Identifier: Apache-2.0
/// @file  Renders scenes and avatars into pictures in host memory.
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

/// A person in a picture: an avatar and a frame of a motion. The caller owns both.
struct Pose {
    const Avatar<cpu::Threads>* avatar = nullptr;
    const Motion* motion = nullptr;
    std::size_t frame = 0;
};

/// The pixel filter that all avatars were trained with.
/// Errors  ValueError if they were trained with different filters.
PixelFilter common_filter(const std::vector<AvatarData>& avatars);

/// Renders pictures; the buffers are kept from one picture to the next.
class Renderer {
public:
    using Backend = cpu::Threads;

    /// `filter` must be the one of the scene: an avatar's file contains it; a plain PLY has the default one.
    explicit Renderer(Backend& backend, const PixelFilter& filter = {});
    ~Renderer();

    /// Renders avatars in one scene; a person in front hides the others. Lit avatars cast shadows on each other.
    Image<float> render(const std::vector<Pose>& people, const Camera<double>& camera, const vec3<float>& background);

    /// Renders a static 3DGS scene.
    Image<float> render(const GaussianCloud<float>& scene, const Camera<double>& camera, const vec3<float>& background);

private:
    Image<float> draw(const Camera<float>& camera, const vec3<float>& background);

    Backend* backend_;
    Rasterizer<Backend> rasterizer_;
    std::vector<RigPose<Backend, float>> poses_;        // one per person
    Splats<Backend, float> splats_;
    std::vector<Avatar<Backend>::Cache> avatar_caches_; // one per person
    Rasterizer<Backend>::Cache raster_cache_;
};

} // namespace gsh::examples
