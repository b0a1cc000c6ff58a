// SPDX-License-Identifier: Apache-2.0
/// @file  Parts of the body that a mask lacks are named, and outlines that differ by a few pixels are not.
#include <doctest/doctest.h>

#include <gsh/body/posed_body.hpp>
#include <gsh/check/lost_parts.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_turn.hpp>

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

using namespace gsh;

namespace {

struct StandingActor {
    BodyModel body = make_actor({.edge_scale = 1.5});
    Motion motion = actor_turn(4);
    std::vector<int> parts = body_parts(body);
    Camera<double> camera = look_at<double>({0, 0.3, 3}, {0, -0.1, 0}, {0, 1, 0}, 0.75, 240, 320);
    std::vector<vec3<double>> vertices = pose_body(body, motion.pose_at(0), motion.transl[0], motion.betas).vertices;
    Silhouette mask = mesh_silhouette(vertices, body.faces, camera);

    /// The names of the parts that are lost.
    [[nodiscard]] std::vector<std::string> lost(int margin = 3) const {
        std::vector<std::string> names;
        const auto sights = parts_in_mask(body, parts, vertices, camera, mask, margin);
        for (std::size_t k = 0; k < sights.size(); ++k)
            if (sights[k].is_lost()) names.emplace_back(body_part_names[k]);
        return names;
    }
    /// Removes what the mask holds within `metres` of a joint.
    void cut(int joint, double metres) {
        const auto place =
            pose_body(body, motion.pose_at(0), motion.transl[0], motion.betas).joints[static_cast<std::size_t>(joint)];
        const vec2<double> at = to_pixel(camera, to_camera(camera, place));
        const double radius = metres * camera.fx / to_camera(camera, place).z;
        for (int y = 0; y < mask.height; ++y)
            for (int x = 0; x < mask.width; ++x)
                if (length(vec2<double>(x + 0.5, y + 0.5) - at) < radius)
                    mask.inside[static_cast<std::size_t>(y * mask.width + x)] = 0;
    }
};

} // namespace

TEST_CASE("each part is seen where it is") {
    const StandingActor actor;
    const auto sights = parts_in_mask(actor.body, actor.parts, actor.vertices, actor.camera, actor.mask, 0);
    double visible = 0;
    for (std::size_t k = 0; k < sights.size(); ++k) {
        CAPTURE(body_part_names[k]);
        CHECK(sights[k].visible > 30);
        CHECK(sights[k].lost == 0);
        visible += sights[k].visible;
    }
    CHECK(visible == static_cast<double>(actor.mask.area()));
    CHECK(sights[1].visible > sights[0].visible);                                // the trunk is larger than the head
    CHECK(sights[8].visible == doctest::Approx(sights[9].visible).epsilon(0.1)); // both thighs
}

TEST_CASE("a foot, a hand or a head that a mask lacks is named") {
    StandingActor actor;
    CHECK(actor.lost().empty());
    SUBCASE("left foot") {
        actor.cut(smplx::left_foot, 0.16);
        CHECK(actor.lost() == std::vector<std::string>{"left foot"});
    }
    SUBCASE("right hand") {
        actor.cut(smplx::left_wrist + 1, 0.19);
        const auto lost = actor.lost();
        CHECK(std::find(lost.begin(), lost.end(), "right hand") != lost.end());
        CHECK(std::find(lost.begin(), lost.end(), "left hand") == lost.end());
    }
    SUBCASE("head") {
        actor.cut(smplx::head, 0.2);
        CHECK(actor.lost() == std::vector<std::string>{"head"});
    }
    SUBCASE("everything") {
        actor.mask.inside.assign(actor.mask.inside.size(), 0);
        CHECK(actor.lost().size() == body_part_names.size());
    }
}

TEST_CASE("a mask that is shifted by less than the margin loses nothing") {
    StandingActor actor;
    Silhouette shifted = actor.mask;
    for (int y = 0; y < shifted.height; ++y)
        for (int x = 0; x < shifted.width; ++x)
            shifted.inside[static_cast<std::size_t>(y * shifted.width + x)] = x >= 3 && actor.mask.row(y)[x - 3];
    actor.mask = shifted;
    CHECK(actor.lost(3).empty());
    CHECK(!actor.lost(0).empty()); // hands are 7 pixels wide
}

TEST_CASE("other bodies and sizes are refused") {
    StandingActor actor;
    BodyModel smpl = actor.body;
    smpl.parents.resize(24);
    CHECK_THROWS_AS((void)body_parts(smpl), ShapeError);
    actor.mask.inside.pop_back();
    CHECK_THROWS_AS((void)actor.lost(), ShapeError);
    actor.mask.inside.push_back(0);
    actor.parts.pop_back();
    CHECK_THROWS_AS((void)actor.lost(), ShapeError);
}
