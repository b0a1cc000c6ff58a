// SPDX-License-Identifier: Apache-2.0
#include "support/renderer.hpp"

#include "support/rasterizer.hpp"

#include <gsh/core/error.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include <utility>

namespace gsh::examples {

PixelFilter common_filter(const std::vector<AvatarData>& avatars) {
    for (const AvatarData& avatar : avatars)
        check_value(
            avatar.filter.dilation == avatars[0].filter.dilation &&
                avatar.filter.compensate_opacity == avatars[0].filter.compensate_opacity,
            "avatars",
            "were trained with different pixel filters (filter.dilation, filter.compensate), so that one picture "
            "cannot be correct for all of them; train them with the same filter");
    return avatars[0].filter;
}

Renderer::Renderer(Backend& backend, const PixelFilter& filter)
    : backend_(&backend), rasterizer_(backend, raster_params<float>(filter)) {}
Renderer::~Renderer() = default;

Image<float> Renderer::render(const std::vector<Pose>& people, const Camera<double>& camera,
                              const vec3<float>& background) {
    const Camera<float> view = camera.cast<float>();
    std::size_t count = 0;
    for (const Pose& person : people) count += person.avatar->size();
    splats_.resize(count);
    avatar_caches_.resize(people.size());
    std::size_t first = 0;
    for (std::size_t p = 0; p < people.size(); ++p) {
        const auto& [avatar, motion, frame] = people[p];
        avatar->rig().upload_pose(*motion, frame, pose_);
        avatar->pose(pose_, view.center(), splats_.view().subview(first, avatar->size()), avatar_caches_[p]);
        first += avatar->size();
    }
    return draw(view, background);
}

Image<float> Renderer::render(const GaussianCloud<float>& scene, const Camera<double>& camera,
                              const vec3<float>& background) {
    const Camera<float> view = camera.cast<float>();
    Gaussians<Backend, float> gaussians;
    upload(*backend_, scene, gaussians);
    splats_.resize(scene.size());
    StaticSplatsCache<Backend> cache;
    with_sh_degree(scene.sh_degree, [&](auto degree) {
        StaticSplats<Backend, decltype(degree)::value>(*backend_).forward(std::as_const(gaussians).view(),
                                                                          view.center(), splats_.view(), cache);
    });
    return draw(view, background);
}

Image<float> Renderer::draw(const Camera<float>& camera, const vec3<float>& background) {
    Image<float> picture(3, camera.height, camera.width);
    Backend::Buffer<float> pixels(picture.data.size());
    rasterizer_.forward(camera, std::as_const(splats_).view(), {.color = background},
                        {.color = ImageView<float>{pixels, 3, camera.height, camera.width}}, raster_cache_);
    backend_->download(Span<const float>(pixels), Span<float>(picture.data));
    return picture;
}

} // namespace gsh::examples
