// SPDX-License-Identifier: Apache-2.0
#include "support/renderer.hpp"

#include "support/rasterizer.hpp"

#include <gsh/core/error.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/shadow_map.hpp>

#include <utility>
#include <vector>

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
    poses_.resize(people.size());
    std::vector<std::pair<std::size_t, ShadowCaster<float>>> casters; // with the person
    for (std::size_t p = 0; p < people.size(); ++p) {
        const auto& [avatar, motion, frame] = people[p];
        avatar->rig().upload_pose(*motion, frame, poses_[p]);
        // Posing later computes the same vertices in the same memory, so that the caster stays valid.
        if (people.size() > 1 && avatar->is_lit())
            casters.emplace_back(p, avatar->caster(poses_[p], avatar_caches_[p]));
    }
    std::size_t first = 0;
    for (std::size_t p = 0; p < people.size(); ++p) {
        const Avatar<Backend>& avatar = *people[p].avatar;
        std::vector<ShadowCaster<float>> others;
        for (const auto& [person, caster] : casters)
            if (person != p) others.push_back(caster);
        avatar.pose(poses_[p], view.center(), splats_.view().subview(first, avatar.size()), avatar_caches_[p], others);
        first += avatar.size();
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
