// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/still_frames.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/static_gaussian.hpp>

#include "support/bodies.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Gaussians on a tube of four joints, and two frames of a bend.
struct StillScene {
    cpu::Threads backend{2};
    AvatarData avatar;
    Motion motion;

    explicit StillScene(int degree, Deformation deformation = Deformation::linear, double bend = 0.6) {
        const BodyModel body = test::tube(4, 6, 6);
        const auto samples =
            sample_surface(body, shaped_vertices(body, {}), std::vector<double>(body.vertex_count(), 3.0), 3);
        avatar.rig = make_rig(body, {}, samples);
        avatar.gaussians.resize(samples.size(), degree);
        avatar.deformation = deformation;
        const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
        test::Rng rng(6);
        for (std::size_t i = 0; i < samples.size(); ++i) {
            avatar.gaussians.means[i] = vec3<float>(samples.positions[i]);
            avatar.gaussians.log_scales[i] = vec3<float>(rng.vec(-6, -3));
            const quat<double> q = rng.quat();
            avatar.gaussians.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
            avatar.gaussians.opacity_logits[i] = static_cast<float>(rng.normal());
            for (std::size_t k = 0; k < basis; ++k)
                avatar.gaussians.sh[i * basis + k] =
                    k ? vec3<float>(rng.vec(-0.05, 0.05)) : sh_of_color(vec3<float>(rng.vec(0.3, 0.7)));
        }
        motion = rest_motion(avatar.rig);
        motion.pose = rng.vecs(8, -bend, bend);
        motion.transl = {{0.1, 0.2, 0.3}, {0, 0, 0}};
        motion.timestamps = {0, 1};
    }

    void add_light() {
        avatar.light = even_light(1, 6, {0.5, 1, 1}, 2);
        avatar.light->gloss = {std::log(0.05), std::log(12.0)};
    }
    [[nodiscard]] Splats<cpu::Threads> posed(const vec3<float>& center, std::size_t frame = 0) {
        const Avatar<cpu::Threads> shown(backend, avatar);
        RigPose<cpu::Threads> pose;
        Avatar<cpu::Threads>::Cache cache;
        Splats<cpu::Threads> splats;
        splats.resize(shown.size());
        shown.rig().upload_pose(motion, frame, pose);
        shown.pose(pose, center, splats.view(), cache);
        return splats;
    }
    [[nodiscard]] Splats<cpu::Threads> as_scene(const GaussianCloud<float>& cloud, const vec3<float>& center) {
        Gaussians<cpu::Threads> gaussians;
        upload(backend, cloud, gaussians);
        Splats<cpu::Threads> splats;
        splats.resize(cloud.size());
        StaticSplatsCache<cpu::Threads> cache;
        with_sh_degree(cloud.sh_degree, [&](auto degree) {
            StaticSplats<cpu::Threads, decltype(degree)::value>(backend).forward(std::as_const(gaussians).view(),
                                                                                 center, splats.view(), cache);
        });
        return splats;
    }
    [[nodiscard]] GaussianCloud<float> still(std::size_t frame = 0, const StillFrameParams& params = {}) {
        return StillFrames<cpu::Threads>(backend, avatar, params).frame(motion, frame);
    }
};

/// Root mean square of the differences of two sets of colours, over the Gaussians that `counts` accepts.
template <class Counts>
double color_error(const Splats<cpu::Threads>& a, const Splats<cpu::Threads>& b, const Counts& counts) {
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < a.colors.size(); ++i) {
        if (!counts(i)) continue;
        const vec3<double> d = vec3<double>(a.colors[i]) - vec3<double>(b.colors[i]);
        sum += dot(d, d), ++count;
    }
    REQUIRE(count > 50);
    return std::sqrt(sum / (3 * count));
}
double color_error(const Splats<cpu::Threads>& a, const Splats<cpu::Threads>& b) {
    return color_error(a, b, [](std::size_t) { return true; });
}

constexpr Deformation still_deformations[] = {Deformation::linear, Deformation::polar, Deformation::dual_quaternion};
const vec3<float> still_eye(1, 1.5f, 3);

} // namespace

TEST_CASE("a still frame has the means, covariances and opacities of the posed avatar, under every deformation") {
    for (const Deformation deformation : still_deformations)
        for (std::size_t frame = 0; frame < 2; ++frame) {
            StillScene s(1, deformation);
            const auto posed = s.posed(still_eye, frame), still = s.as_scene(s.still(frame), still_eye);
            for (std::size_t i = 0; i < posed.means.size(); ++i) {
                CHECK(still.means[i] == posed.means[i]);
                CHECK(still.opacities[i] == doctest::Approx(posed.opacities[i]));
                const sym3<float>&a = posed.covariances[i], &b = still.covariances[i];
                const float size = std::max({a.xx, a.yy, a.zz});
                for (const auto& [p, q] : {std::pair(a.xx, b.xx), std::pair(a.xy, b.xy), std::pair(a.xz, b.xz),
                                           std::pair(a.yy, b.yy), std::pair(a.yz, b.yz), std::pair(a.zz, b.zz)})
                    CHECK(std::abs(p - q) < 2e-6f * size);
            }
        }
}

TEST_CASE("colours turn with the bones, exactly where the deformation is rigid") {
    for (const Deformation deformation : still_deformations) {
        StillScene s(3, deformation);
        const double error = color_error(s.posed(still_eye), s.as_scene(s.still(), still_eye));
        CHECK(error < (deformation == Deformation::linear ? 5e-3 : 1e-6));
        // Without the rotation of the coefficients the colours would be others.
        auto unturned = s.still();
        unturned.sh = s.avatar.gaussians.sh;
        CHECK(color_error(s.posed(still_eye), s.as_scene(unturned, still_eye)) > 2e-2);
    }
}

TEST_CASE("ambient occlusion is merged into the colours of a frame") {
    StillScene s(2, Deformation::polar);
    test::Rng rng(1);
    for (std::size_t i = 0; i < s.avatar.gaussians.size(); ++i)
        s.avatar.ao.push_back(static_cast<float>(rng.uniform(0, 1)));
    CHECK(color_error(s.posed(still_eye), s.as_scene(s.still(), still_eye)) < 1e-6);
}

TEST_CASE("light is merged into the colours of each frame, with its shadows and its gloss") {
    StillScene s(2);
    s.add_light();
    // Gaussians that the camera cannot see, because they are on the other side, do not count.
    const auto visible_error = [&](const GaussianCloud<float>& cloud, std::size_t frame, const vec3<float>& center) {
        const auto vertices = test::posed_vertices(s.avatar.rig.body, s.motion, frame);
        return color_error(s.posed(center, frame), s.as_scene(cloud, center), [&](std::size_t i) {
            const auto corner = [&](std::size_t k) {
                return vertices[static_cast<std::size_t>(s.avatar.rig.triangles[i][k])];
            };
            const vec3<double> normal = cross(corner(1) - corner(0), corner(2) - corner(0));
            return dot(normal, vec3<double>(center) - corner(0)) > 0;
        });
    };
    const auto first = s.still(0), second = s.still(1);
    for (const vec3<float>& center : {still_eye, vec3<float>(-2, 0, -2)}) {
        CHECK(visible_error(first, 0, center) < 0.01);
        CHECK(visible_error(second, 1, center) < 0.01);
    }
    // Where views from behind the surface count as much as others, colours fit those that are seen worse.
    CHECK(visible_error(first, 0, still_eye) < 0.9 * visible_error(s.still(0, {.hidden_weight = 1}), 0, still_eye));
    auto other_light = second; // the light of another frame is seen to be wrong
    other_light.sh = first.sh;
    CHECK(visible_error(other_light, 1, still_eye) > 0.02);
    CHECK(visible_error(s.still(0, {.sh_degree = 0}), 0, still_eye) < 0.05);
}

TEST_CASE("a lower degree drops bands, and the results do not depend on the number of threads") {
    StillScene s(3);
    s.add_light();
    const auto cloud = s.still(0, {.sh_degree = 1});
    CHECK(cloud.sh_degree == 1);
    CHECK(cloud.sh.size() == 4 * cloud.size());
    cpu::Threads one(1);
    CHECK(StillFrames<cpu::Threads>(one, s.avatar, {.sh_degree = 1}).frame(s.motion, 0).sh == cloud.sh);
    CHECK_THROWS_AS((void)s.still(2), ValueError);
    CHECK_THROWS_AS((void)s.still(0, {.sh_degree = 5}), ValueError);
    CHECK_THROWS_AS((void)s.still(0, {.views = 0}), ValueError);
}
