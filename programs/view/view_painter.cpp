// SPDX-License-Identifier: Apache-2.0
#include "view/view_painter.hpp"

#include "show/pose_avatars.hpp"
#include "view/ellipsoids.hpp"
#include "view/view_scene.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/avatar/view_detail.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/render/rasterizer.hpp>

#include <algorithm>
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
            count = add_level(fine_, scene.people->data);
            poses_.resize(fine_.avatars.size());
            if (scene.adapts_detail) add_coarse_level();
        } else {
            upload(backend, scene.cloud, cloud_);
        }
        splats_.resize(count, !scene.people); // scenes may have needles
    }

    const Image<float>& draw(const ViewRequest& request) {
        const Camera<float> view = request.camera.cast<float>();
        shown_ = splats_.view().size();
        if (scene_->people)
            pose_people(request, view.center());
        else
            color_cloud(view.center());
        const SplatView<const float> splats = std::as_const(splats_).view().subview(0, shown_);
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
    /// All people with a number of Gaussians.
    struct Level {
        std::deque<Avatar<B>> avatars;
        std::vector<typename Avatar<B>::Cache> caches; // one per person
        double turned = 0;                             // radians, of all lights
    };

    std::size_t add_level(Level& level, const std::vector<AvatarData>& people) {
        std::size_t count = 0;
        for (const AvatarData& data : people) count += level.avatars.emplace_back(*backend_, data).size();
        level.caches.resize(level.avatars.size());
        return count;
    }

    /// The people with as many Gaussians as a picture needs in which the scene fills the height.
    void add_coarse_level() {
        const double most = scene_->size / std::max(2 * scene_->box.half.y, 0.01); // pixels in a metre
        std::vector<AvatarData> people;
        bool coarser = false;
        for (const AvatarData& data : scene_->people->data) {
            areas_.push_back(surface_area(data.rig));
            people.push_back(coarser_avatar(*backend_, data, gaussians_for_view(areas_.back(), most)));
            coarser |= people.back().gaussians.size() < data.gaussians.size();
        }
        if (coarser) add_level(coarse_, people);
    }

    /// The coarse level if it has enough Gaussians for every person in the picture.
    [[nodiscard]] Level& level_for(const ViewRequest& request) {
        for (std::size_t p = 0; p < coarse_.avatars.size(); ++p) {
            const vec3<double> root = scene_->people->data[p].rig.joints[0] + request.people[p].transl[0];
            const std::size_t needed = gaussians_for_view(areas_[p], pixels_per_metre(request.camera, root));
            if (std::min(needed, fine_.avatars[p].size()) > coarse_.avatars[p].size()) return fine_;
        }
        return coarse_.avatars.empty() ? fine_ : coarse_;
    }

    void pose_people(const ViewRequest& request, const vec3<float>& center) {
        Level& level = level_for(request);
        std::deque<Avatar<B>>& avatars = level.avatars;
        turn_light(level, request.light_turn);
        std::vector<vec3<double>> roots;
        shown_ = 0;
        for (std::size_t p = 0; p < avatars.size(); ++p) {
            const auto& light = scene_->people->data[p].light;
            avatars[p].set_shadows(request.shadows && (!light || light->shadows));
            avatars[p].rig().upload_pose(request.people[p], 0, poses_[p]);
            roots.push_back(request.people[p].transl[0]);
            shown_ += avatars[p].size();
        }
        pose_avatars<B>(avatars, poses_, roots, center, splats_.view().subview(0, shown_), level.caches);
    }

    void turn_light(Level& level, double angle) {
        if (angle == level.turned) return;
        for (std::size_t p = 0; p < level.avatars.size(); ++p)
            if (level.avatars[p].is_lit())
                level.avatars[p].set_light(
                    turned_light(*scene_->people->data[p].light, angle, scene_->light_centre(p)));
        level.turned = angle;
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
    Level fine_, coarse_;                  // coarse_ may be empty
    std::vector<double> areas_;            // square metres, of each person, if the detail adapts
    std::vector<RigPose<B, float>> poses_; // one per person
    Gaussians<B, float> cloud_;
    StaticSplatsCache<B> cloud_cache_;
    Splats<B, float> splats_; // of all people, or of the scene
    std::size_t shown_ = 0;   // splats in the picture, the first ones
};

ViewPainter::ViewPainter(cpu::Threads& backend, const ViewScene& scene)
    : painted_(std::make_unique<Painted>(backend, scene)) {}
ViewPainter::~ViewPainter() = default;

const Image<float>& ViewPainter::draw(const ViewRequest& request) {
    return painted_->draw(request);
}

} // namespace gsh::programs
