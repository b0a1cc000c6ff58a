// SPDX-License-Identifier: Apache-2.0
#include "view/view_painter.hpp"

#include "show/pose_avatars.hpp"
#include "view/ellipsoids.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cmath>
#include <cstddef>
#include <deque>
#include <utility>
#include <vector>

namespace gsh::programs {

LightData turned_light(LightData light, double angle, const vec3<double>& centre) {
    const double c = std::cos(angle), s = std::sin(angle);
    const auto turn = [&](const vec3<double>& v) { return vec3<double>(c * v.x + s * v.z, v.y, c * v.z - s * v.x); };
    for (vec3<double>& point : light.points) point = centre + turn(point - centre);
    for (vec3<double>& direction : light.directions) direction = turn(direction);
    return light;
}

class ViewPainter::Painted {
public:
    using B = cpu::Threads;

    Painted(B& backend, const ViewScene& scene)
        : backend_(&backend), scene_(&scene), rasterizer_(backend, raster_params<float>(scene.filter)) {
        std::size_t count = scene.cloud.size();
        if (scene.people) {
            for (const AvatarData& data : scene.people->data) count += avatars_.emplace_back(backend, data).size();
            poses_.resize(avatars_.size()), caches_.resize(avatars_.size());
        } else {
            upload(backend, scene.cloud, cloud_);
        }
        splats_.resize(count, !scene.people); // scenes may have needles
    }

    const Image<float>& draw(const ViewRequest& request) {
        const Camera<float> view = request.camera.cast<float>();
        if (scene_->people)
            pose_people(request, view.center());
        else
            color_cloud(view.center());
        const SplatView<const float> splats = std::as_const(splats_).view();
        if (request.show == ViewRequest::Show::ellipsoids) {
            picture_ = draw_ellipsoids(*backend_, view, splats, request.background);
        } else {
            if (picture_.width != view.width || picture_.height != view.height)
                picture_ = Image<float>(3, view.height, view.width);
            rasterizer_.forward(view, splats, {.color = request.background}, {.color = picture_.view()}, raster_cache_);
        }
        return picture_;
    }

private:
    void pose_people(const ViewRequest& request, const vec3<float>& center) {
        turn_light(request.light_turn);
        std::vector<vec3<double>> roots;
        for (std::size_t p = 0; p < avatars_.size(); ++p) {
            const auto& light = scene_->people->data[p].light;
            avatars_[p].set_shadows(request.shadows && (!light || light->shadows));
            avatars_[p].rig().upload_pose(request.people[p], 0, poses_[p]);
            roots.push_back(request.people[p].transl[0]);
        }
        pose_avatars<B>(avatars_, poses_, roots, center, splats_.view(), caches_);
    }

    void turn_light(double angle) {
        if (angle == turned_) return;
        for (std::size_t p = 0; p < avatars_.size(); ++p)
            if (avatars_[p].is_lit())
                avatars_[p].set_light(turned_light(*scene_->people->data[p].light, angle, scene_->light_centre(p)));
        turned_ = angle;
    }

    void color_cloud(const vec3<float>& center) {
        with_sh_degree(cloud_.sh_degree, [&](auto degree) {
            StaticSplats<B, decltype(degree)::value>(*backend_).forward(std::as_const(cloud_).view(), center,
                                                                        splats_.view(), cloud_cache_);
        });
    }

    B* backend_;
    const ViewScene* scene_;
    Rasterizer<B> rasterizer_;
    Rasterizer<B>::Cache raster_cache_;
    Image<float> picture_;
    std::deque<Avatar<B>> avatars_;
    std::vector<RigPose<B, float>> poses_;          // one per person
    std::vector<typename Avatar<B>::Cache> caches_; // likewise
    Gaussians<B, float> cloud_;
    StaticSplatsCache<B> cloud_cache_;
    Splats<B, float> splats_; // of all people, or of the scene
    double turned_ = 0;       // radians, of all lights
};

ViewPainter::ViewPainter(cpu::Threads& backend, const ViewScene& scene)
    : painted_(std::make_unique<Painted>(backend, scene)) {}
ViewPainter::~ViewPainter() = default;

const Image<float>& ViewPainter::draw(const ViewRequest& request) {
    return painted_->draw(request);
}

} // namespace gsh::programs
