// SPDX-License-Identifier: Apache-2.0
/// @file  The renderer of the programs on a backend. A file that includes it also includes the backend's overloads.
#pragma once

#include "show/pose_avatars.hpp"
#include "show/renderer.hpp"
#include "show/shown_people.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cstddef>
#include <deque>
#include <utility>
#include <vector>

namespace gsh::programs {

/// Draws splats into a picture in host memory. Buffers are kept from one picture to the next.
template <Backend B>
class SplatPainter {
public:
    SplatPainter(B& backend, const PixelFilter& filter)
        : backend_(&backend), rasterizer_(backend, raster_params<float>(filter)) {}

    Image<float> draw(const Camera<float>& camera, const SplatView<const float>& splats,
                      const vec3<float>& background) {
        Image<float> picture(3, camera.height, camera.width);
        pixels_.resize(picture.data.size());
        rasterizer_.forward(camera, splats, {.color = background},
                            {.color = ImageView<float>{pixels_, 3, camera.height, camera.width}}, cache_);
        backend_->download(Span<const float>(pixels_), Span<float>(picture.data));
        return picture;
    }

private:
    B* backend_;
    Rasterizer<B> rasterizer_;
    typename Rasterizer<B>::Cache cache_;
    typename B::template Buffer<float> pixels_;
};

template <Backend B>
class PeopleRenderer final : public Renderer {
public:
    PeopleRenderer(B& backend, const ShownPeople& people)
        : people_(&people), painter_(backend, people.filter()), poses_(people.data.size()),
          caches_(people.data.size()) {
        std::size_t count = 0;
        for (const AvatarData& data : people.data) count += avatars_.emplace_back(backend, data).size();
        splats_.resize(count);
    }

    Image<float> render(std::size_t frame, const Camera<double>& camera, const vec3<float>& background) override {
        const Camera<float> view = camera.cast<float>();
        std::vector<vec3<double>> roots;
        for (std::size_t p = 0; p < avatars_.size(); ++p) {
            avatars_[p].rig().upload_pose(people_->motions[p], frame, poses_[p]);
            roots.push_back(people_->motions[p].transl[frame]);
        }
        pose_avatars<B>(avatars_, poses_, roots, view.center(), splats_.view(), caches_);
        return painter_.draw(view, std::as_const(splats_).view(), background);
    }

private:
    const ShownPeople* people_;
    SplatPainter<B> painter_;
    std::deque<Avatar<B>> avatars_;
    std::vector<RigPose<B, float>> poses_;          // one per person
    std::vector<typename Avatar<B>::Cache> caches_; // likewise
    Splats<B, float> splats_;                       // of all people
};

template <Backend B>
class CloudRenderer final : public Renderer {
public:
    CloudRenderer(B& backend, const GaussianCloud<float>& scene, const PixelFilter& filter = {})
        : backend_(&backend), painter_(backend, filter) {
        upload(backend, scene, gaussians_);
        splats_.resize(scene.size(), true); // scenes may have needles
    }

    Image<float> render(std::size_t /*frame*/, const Camera<double>& camera, const vec3<float>& background) override {
        const Camera<float> view = camera.cast<float>();
        with_sh_degree(gaussians_.sh_degree, [&](auto degree) {
            StaticSplats<B, decltype(degree)::value>(*backend_).forward(std::as_const(gaussians_).view(), view.center(),
                                                                        splats_.view(), cache_);
        });
        return painter_.draw(view, std::as_const(splats_).view(), background);
    }

private:
    B* backend_;
    SplatPainter<B> painter_;
    Gaussians<B, float> gaussians_;
    Splats<B, float> splats_;
    StaticSplatsCache<B> cache_;
};

} // namespace gsh::programs
