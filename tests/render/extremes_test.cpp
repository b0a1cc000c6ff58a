// SPDX-License-Identifier: Apache-2.0
/// Numbers at the ends of their ranges, from Gaussians to pixels and back: an error that names its cause, or a finite
/// picture and finite gradients. GSH_ALL_FAILURES adds ten million Gaussians and pictures of 8192 x 8192 pixels.
#include <gsh/cpu.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/render/rasterizer.hpp>

#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr int extreme_degree = 1;

Camera<float> extreme_camera(int width, int height) {
    return look_at<double>({0, 0, -4}, {0, 0, 0}, {0, 1, 0}, 0.7, width, height).cast<float>();
}

/// A ball of Gaussians around the origin.
GaussianCloud<float> extreme_ball(std::size_t count) {
    GaussianCloud<float> cloud(count, extreme_degree);
    test::Rng rng(5);
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec3<float>(rng.vec(-0.7, 0.7));
        const quat<double> q = rng.quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.log_scales[i] = vec3<float>(rng.vec(-4, -2.5));
        cloud.opacity_logits[i] = float(rng.uniform(-2, 2));
    }
    for (auto& value : cloud.sh) value = vec3<float>(rng.vec(-0.3, 0.3));
    return cloud;
}

struct ExtremePicture {
    Image<float> color, alpha;
    std::vector<float> gradient;
    std::string error; ///< of a refusal

    [[nodiscard]] bool is_finite() const {
        const auto finite = [](float v) { return std::isfinite(v); };
        return std::ranges::all_of(color.data, finite) && std::ranges::all_of(gradient, finite) &&
               std::ranges::all_of(alpha.data, [](float v) { return v >= 0 && v <= 1; });
    }
};

template <class B>
ExtremePicture draw(B& backend, const GaussianCloud<float>& cloud, const Camera<float>& camera,
                    const vec3<float>& background = vec3<float>(0.5f), bool backward = true) {
    const StaticSplats<B, extreme_degree> to_splats(backend);
    const Rasterizer<B> rasterizer(backend);
    typename StaticSplats<B, extreme_degree>::Cache cache;
    typename Rasterizer<B>::Cache raster;
    Splats<B> splats, dL_dsplats;
    ExtremePicture picture{
        Image<float>(3, camera.height, camera.width), Image<float>(1, camera.height, camera.width), {}, {}};
    try {
        splats.resize(cloud.size());
        to_splats.forward(cloud.view(), camera.center(), splats.view(), cache);
        rasterizer.forward(camera, std::as_const(splats).view(), {.color = background},
                           {.color = picture.color.view(), .alpha = picture.alpha.view()}, raster);
        if (!backward) return picture;
        dL_dsplats.resize(cloud.size());
        fill_zero(backend, dL_dsplats.view());
        const Image<float> dL_dcolor(3, camera.height, camera.width, 1.0f);
        rasterizer.backward(camera, std::as_const(splats).view(), {.color = background}, {.color = dL_dcolor.view()},
                            raster, dL_dsplats.view());
        GaussianCloud<float> gradient(cloud.size(), extreme_degree);
        fill_zero(backend, gradient.view());
        to_splats.backward(cloud.view(), camera.center(), std::as_const(dL_dsplats).view(), cache, gradient.view());
        picture.gradient = gradient.opacity_logits;
        for (std::size_t i = 0; i < cloud.size(); ++i) {
            const auto &m = gradient.means[i], &s = gradient.log_scales[i];
            const auto& q = gradient.quats[i];
            picture.gradient.insert(picture.gradient.end(), {m.x, m.y, m.z, s.x, s.y, s.z, q.w, q.x, q.y, q.z});
        }
        for (const auto& v : gradient.sh) picture.gradient.insert(picture.gradient.end(), {v.x, v.y, v.z});
    } catch (const Error& error) {
        picture.error = error.what();
    }
    return picture;
}

/// Draws on both backends. Returns the error, or "" after a finite picture.
std::string check_extreme(const std::string& what, const GaussianCloud<float>& cloud, const Camera<float>& camera,
                          const vec3<float>& background = vec3<float>(0.5f)) {
    CAPTURE(what);
    cpu::Serial serial;
    cpu::Threads threads(3);
    const ExtremePicture one = draw(serial, cloud, camera, background),
                         other = draw(threads, cloud, camera, background);
    CHECK(one.error == other.error);
    if (!one.error.empty()) return one.error;
    CHECK(one.is_finite());
    CHECK(one.color.data == other.color.data);
    CHECK(one.gradient == other.gradient);
    return {};
}

} // namespace

TEST_CASE("no Gaussian, one, and pictures of one pixel and of one row") {
    for (const std::size_t count : {0, 1, 2, 100})
        for (const auto& [width, height] : {std::pair(1, 1), {1, 4096}, {4096, 1}, {16, 16}, {17, 15}}) {
            CAPTURE(count);
            CAPTURE(width);
            CHECK(check_extreme("sizes", extreme_ball(count), extreme_camera(width, height)) == "");
        }
}

TEST_CASE("a camera inside the body, on a Gaussian, and looking away") {
    const GaussianCloud<float> cloud = extreme_ball(300);
    for (const vec3<double>& place :
         {vec3<double>(0, 0, 0), {0.1, 0, 0.2}, {0, 0, 0.7}, vec3<double>(cloud.means[7])}) {
        const vec3<double> at = place + vec3<double>(0, 0, 1);
        CHECK(check_extreme("inside", cloud, look_at<double>(place, at, {0, 1, 0}, 1.2, 48, 32).cast<float>()) == "");
    }
}

TEST_CASE("scales, opacities and places at the ends of their ranges") {
    const Camera<float> camera = extreme_camera(40, 30);
    const auto changed = [&](const char* what, const auto& change) {
        GaussianCloud<float> cloud = extreme_ball(60);
        for (std::size_t i = 0; i < cloud.size(); ++i) change(cloud, i);
        return check_extreme(what, cloud, camera);
    };
    constexpr float tiny = std::numeric_limits<float>::denorm_min(), small = 1e-40f;
    CHECK(changed("scales 1e-30", [](auto& c, auto i) { c.log_scales[i] = vec3<float>(std::log(1e-30f)); }) == "");
    const std::string huge =
        changed("scales 1e30", [](auto& c, auto i) { c.log_scales[i] = vec3<float>(std::log(1e30f)); });
    if (!huge.empty()) CHECK(huge == test::contains("Gaussian 0"));
    CHECK(changed("scales 1e9", [](auto& c, auto i) { c.log_scales[i] = vec3<float>(std::log(1e9f)); }) == "");
    CHECK(changed("needles", [](auto& c, auto i) { c.log_scales[i] = vec3<float>(-60, 2, -60); }) == "");
    CHECK(changed("opacity 0", [](auto& c, auto i) { c.opacity_logits[i] = -1e4f; }) == "");
    CHECK(changed("opacity 1", [](auto& c, auto i) { c.opacity_logits[i] = 1e4f; }) == "");
    CHECK(changed("one place", [](auto& c, auto i) { c.means[i] = vec3<float>(0.1f, 0, 0); }) == "");
    CHECK(changed("one tile", [](auto& c, auto i) { c.means[i] = c.means[i] * 0.01f; }) == "");
    CHECK(changed("equal depth", [](auto& c, auto i) { c.means[i].z = 0; }) == "");
    CHECK(changed("denormal places", [](auto& c, auto i) { c.means[i] = vec3<float>(small, tiny, -tiny); }) == "");
    CHECK(changed("denormal colours", [](auto& c, auto i) { c.sh[4 * i] = vec3<float>(tiny, -tiny, small); }) == "");
    // A turn whose length is zero, or vanishes in its square, has no direction.
    CHECK(changed("denormal turns", [](auto& c, auto i) { c.quats[i] = {small, 0, tiny, 0}; }) ==
          test::contains("Gaussian 0 "));
    CHECK(changed("no turns", [](auto& c, auto i) { c.quats[i] = {0, 0, 0, 0}; }) == test::contains("Gaussian 0 "));
    CHECK(changed("far away", [](auto& c, auto i) { c.means[i] = c.means[i] * 1e18f; }) == "");
}

TEST_CASE("NaN and infinity in each input are named, or do not reach the picture") {
    const Camera<float> camera = extreme_camera(40, 30);
    constexpr float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
    for (const float bad : {nan, infinity, -infinity}) {
        CAPTURE(bad);
        const auto with = [&](const auto& change) {
            GaussianCloud<float> cloud = extreme_ball(60);
            change(cloud);
            return check_extreme("a bad number", cloud, camera);
        };
        for (const std::string& said :
             {with([&](auto& c) { c.means[7].y = bad; }), with([&](auto& c) { c.quats[7].x = bad; }),
              with([&](auto& c) { c.log_scales[7].z = bad; }), with([&](auto& c) { c.sh[4 * 7].x = bad; }),
              with([&](auto& c) { c.opacity_logits[7] = bad; })})
            if (!said.empty()) CHECK(said == test::contains("7"));
        if (std::isnan(bad)) {
            CHECK(with([&](auto& c) { c.means[7].y = bad; }) == test::contains("7"));
            CHECK(with([&](auto& c) { c.opacity_logits[7] = bad; }) == test::contains("7"));
        }
        for (float Camera<float>::* field :
             {&Camera<float>::fx, &Camera<float>::fy, &Camera<float>::cx, &Camera<float>::cy}) {
            Camera<float> spoilt = camera;
            spoilt.*field = bad;
            CHECK(check_extreme("a camera", extreme_ball(10), spoilt) == test::contains("camera"));
        }
        Camera<float> moved = camera, turned = camera;
        moved.t.z = bad;
        turned.R[1].x = bad;
        CHECK(check_extreme("a camera's place", extreme_ball(10), moved) != "");
        CHECK(check_extreme("a camera's turn", extreme_ball(10), turned) != "");
    }
}

TEST_CASE("many Gaussians and large pictures") {
    const bool all = std::getenv("GSH_ALL_FAILURES") != nullptr;
    cpu::Threads backend;
    const std::size_t count = all ? 10'000'000 : 100'000;
    CHECK(draw(backend, extreme_ball(count), extreme_camera(64, 64), vec3<float>(0.5f), !all).error == "");
    const int size = all ? 8192 : 2048;
    const ExtremePicture large = draw(backend, extreme_ball(1000), extreme_camera(size, size));
    CHECK(large.error == "");
    CHECK(large.is_finite());
}
