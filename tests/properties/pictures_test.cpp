// SPDX-License-Identifier: Apache-2.0
/// What must hold for the picture of any splats, whatever their places, sizes and opacities.
#include "properties/wild_scenes.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::test;

namespace {

template <class T>
void require_equal(const std::vector<T>& found, const std::vector<T>& expected, const char* what) {
    require(same_bits(found, expected), [&] { return std::string(what) + ": " + difference(found, expected, 0); });
}

/// Bytes of the gradient of each attribute of a splat.
void require_equal_gradient(const WildScene<float>& found, std::size_t f, const WildScene<float>& expected,
                            std::size_t e) {
    const auto same = [&](const auto& a, const auto& b) {
        return a.empty() || std::memcmp(&a[f], &b[e], sizeof a[f]) == 0;
    };
    require(same(found.means, expected.means) && same(found.colors, expected.colors) &&
                same(found.covariances, expected.covariances) && same(found.factors, expected.factors) &&
                same(found.opacities, expected.opacities),
            [&] { return "the gradient of splat " + std::to_string(e) + " differs"; });
}

} // namespace

TEST_CASE("a splat without opacity changes neither the picture nor the gradients of others") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        WildScene<float> more = scene;
        WildSplat added = wild_splat(Wildness::everything);
        added.opacity = 0;
        const bool factored = !scene.factors.empty();
        const WildScene<float> one = in_float(scene_of(scene.camera.cast<double>(), {added}, factored));
        const std::size_t at = below(scene.size() + 1);
        more.insert(at, one, 0);
        const WildPicture<float> weights = wild_weights(scene.camera);
        const auto check = [&](auto& backend) {
            WildGradient<float> g, other;
            const auto before = draw_wild(backend, scene, weights, g);
            const auto after = draw_wild(backend, more, weights, other);
            require_equal(after.numbers(), before.numbers(), "the picture");
            for (std::size_t i = 0; i < scene.size(); ++i)
                require_equal_gradient(other.splats, i + (i >= at), g.splats, i);
            require_equal_gradient(other.splats, at, one.zeros(), 0);
        };
        check(one_thread()), check(three_threads());
    });
}

TEST_CASE("the order of splats changes nothing, as long as those of equal depth keep theirs") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        const std::size_t n = scene.size();
        std::vector<std::size_t> order(n);
        std::iota(order.begin(), order.end(), std::size_t(0));
        for (std::size_t i = n; i-- > 1;) std::swap(order[i], order[below(i + 1)]);
        // Splats whose depths are equal as floats, or so near that roundings may make them so, are drawn in the order
        // of their indices. The permutation leaves the order of each such run alone.
        std::vector<std::size_t> by_depth(n), run(n);
        std::iota(by_depth.begin(), by_depth.end(), std::size_t(0));
        std::ranges::stable_sort(by_depth, {}, [&](std::size_t i) { return scene.depth(i); });
        for (std::size_t k = 1; k < n; ++k) {
            const double z0 = scene.depth(by_depth[k - 1]), z1 = scene.depth(by_depth[k]);
            run[by_depth[k]] = run[by_depth[k - 1]] + (z1 - z0 > 1e-6 * std::abs(z1));
        }
        for (std::size_t r = 0; r < n; ++r) {
            std::vector<std::size_t> places, members;
            for (std::size_t k = 0; k < n; ++k)
                if (run[order[k]] == r) places.push_back(k), members.push_back(order[k]);
            std::ranges::sort(members);
            for (std::size_t k = 0; k < places.size(); ++k) order[places[k]] = members[k];
        }
        WildScene<float> other = scene;
        other.means.clear(), other.colors.clear(), other.covariances.clear(), other.factors.clear();
        other.opacities.clear();
        for (std::size_t k = 0; k < n; ++k) other.insert(k, scene, order[k]);
        const WildPicture<float> weights = wild_weights(scene.camera);
        const auto check = [&](auto& backend) {
            WildGradient<float> g, permuted;
            const auto before = draw_wild(backend, scene, weights, g);
            const auto after = draw_wild(backend, other, weights, permuted);
            require_equal(after.numbers(), before.numbers(), "the picture");
            for (std::size_t k = 0; k < n; ++k) require_equal_gradient(permuted.splats, k, g.splats, order[k]);
        };
        check(one_thread()), check(three_threads());
    });
}

TEST_CASE("pictures and gradients are finite, alpha lies in [0, 1], and threads do not change a bit") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        const WildPicture<float> weights = wild_weights(scene.camera);
        WildGradient<float> g, threaded;
        const auto picture = draw_wild(one_thread(), scene, weights, g);
        const auto other = draw_wild(three_threads(), scene, weights, threaded);
        require_equal(other.numbers(), picture.numbers(), "the picture of three threads");
        for (std::size_t i = 0; i < scene.size(); ++i) require_equal_gradient(threaded.splats, i, g.splats, i);
        require(std::memcmp(&g.camera, &threaded.camera, sizeof g.camera) == 0 && g.background == threaded.background,
                [] { return "three threads have another gradient of the camera or of the background"; });
        for (const float v : picture.numbers()) require(std::isfinite(v), [] { return "the picture is not finite"; });
        for (const float a : picture.alpha.data) require(a >= 0 && a <= 1, [&] { return "alpha is " + digits(a); });
        for (std::size_t i = 0; i < scene.size(); ++i) {
            const vec3<float>&m = g.splats.means[i], &c = g.splats.colors[i];
            require(std::isfinite(m.x + m.y + m.z) && std::isfinite(c.x + c.y + c.z) &&
                        std::isfinite(g.splats.opacities[i]),
                    [&] { return "the gradient of splat " + std::to_string(i) + " is not finite"; });
        }
    });
}

TEST_CASE("a picture over a background is the one over black, plus what shines through") {
    check_property([] {
        WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        const auto picture = draw_wild(one_thread(), scene);
        const vec3<float> behind = scene.background;
        scene.background = vec3<float>(0);
        const auto black = draw_wild(one_thread(), scene);
        require_equal(picture.alpha.data, black.alpha.data, "alpha");
        const std::size_t plane = picture.alpha.data.size();
        for (std::size_t p = 0; p < 3 * plane; ++p) {
            const double light = 1 - double(black.alpha.data[p % plane]), b = behind[int(p / plane)];
            const double expected = black.color.data[p] + light * b, found = picture.color.data[p];
            // alpha is rounded to a float, and so is the sum.
            require(std::abs(found - expected) <= 1.2e-7 * (std::abs(b) + std::abs(expected)), [&] {
                return "pixel " + std::to_string(p) + " is " + digits(found) + ", expected " + digits(expected);
            });
        }
    });
}

TEST_CASE("an image of one colour as background is this colour") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        const auto picture = draw_wild(one_thread(), scene);
        Image<float> image(3, scene.camera.height, scene.camera.width), color = image;
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < image.height; ++y)
                for (int x = 0; x < image.width; ++x) image.at(c, y, x) = scene.background[c];
        const Rasterizer<cpu::Serial> rasterizer(one_thread(), scene.params);
        Rasterizer<cpu::Serial>::Cache cache;
        rasterizer.forward(scene.camera, scene.view(), {.color = vec3<float>(9), .image = std::as_const(image).view()},
                           {color.view()}, cache);
        require_equal(color.data, picture.color.data, "the picture");
    });
}

TEST_CASE("the gradient of a scaled loss is scaled") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        const WildPicture<float> weights = wild_weights(scene.camera);
        WildPicture<float> scaled = weights;
        const float factor = float(one_of({2.0, 0.5, -1.0, -64.0})); // exact in every product and sum
        for (auto* image : {&scaled.color, &scaled.alpha, &scaled.expected_depth, &scaled.median_depth})
            for (float& w : image->data) w *= factor;
        WildGradient<float> g, other;
        (void)draw_wild(one_thread(), scene, weights, g);
        (void)draw_wild(one_thread(), scene, scaled, other);
        const auto check = [&](float found, float one, const char* what, std::size_t i) {
            const float expected = factor * one;
            // Below the smallest normal number, digits are lost.
            require(found == expected || std::abs(found - expected) <= 1e-36f, [&] {
                return std::string(what) + " of splat " + std::to_string(i) + " is " + digits(found) + ", expected " +
                       digits(expected);
            });
        };
        for (std::size_t i = 0; i < scene.size(); ++i) {
            for (int k = 0; k < 3; ++k) check(other.splats.means[i][k], g.splats.means[i][k], "mean", i);
            for (int k = 0; k < 3; ++k) check(other.splats.colors[i][k], g.splats.colors[i][k], "color", i);
            check(other.splats.opacities[i], g.splats.opacities[i], "opacity", i);
            if (!scene.covariances.empty()) {
                check(other.splats.covariances[i].xx, g.splats.covariances[i].xx, "xx", i);
                check(other.splats.covariances[i].yz, g.splats.covariances[i].yz, "yz", i);
            } else
                for (int k = 0; k < 9; ++k)
                    check(other.splats.factors[i][k / 3][k % 3], g.splats.factors[i][k / 3][k % 3], "factor", i);
        }
        for (int k = 0; k < 3; ++k) check(other.background[k], g.background[k], "background", 0);
        check(other.camera.dL_dfx, g.camera.dL_dfx, "fx", 0);
    });
}

TEST_CASE("the gradient of the background is the light that shines through") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        WildPicture<float> weights(scene.camera);
        std::ranges::fill(weights.color.data, 1.0f);
        WildGradient<float> g;
        const auto picture = draw_wild(three_threads(), scene, weights, g);
        double through = 0;
        for (const float a : picture.alpha.data) through += 1 - double(a);
        for (int c = 0; c < 3; ++c)
            require(std::abs(g.background[c] - through) <= 1e-6 * double(picture.alpha.data.size()),
                    [&] { return digits(g.background[c]) + ", expected " + digits(through); });
    });
}

TEST_CASE("a world of another unit of length has the same picture, to the bit for powers of two") {
    check_property([] {
        const WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        WildScene<float> scaled = scene;
        const float s = float(one_of({2.0, 0.5, 64.0, 1.0 / 1024}));
        for (auto& m : scaled.means) m = m * s;
        for (auto& F : scaled.factors) F = F * s;
        for (auto& c : scaled.covariances)
            for (float* v : {&c.xx, &c.xy, &c.xz, &c.yy, &c.yz, &c.zz}) *v *= s * s;
        scaled.camera.t = scaled.camera.t * s;
        scaled.params.near_plane *= s;
        const auto picture = draw_wild(one_thread(), scene), other = draw_wild(one_thread(), scaled);
        require_equal(other.color.data, picture.color.data, "the picture");
        require_equal(other.alpha.data, picture.alpha.data, "alpha");
        for (std::size_t p = 0; p < picture.median_depth.data.size(); ++p)
            require(other.median_depth.data[p] == s * picture.median_depth.data[p], [] { return "median depth"; });
    });
}

TEST_CASE("camera and scene moved together have the same picture") {
    check_property([] {
        const WildScene<double> scene = wild_scene(Wildness::no_jumps);
        WildScene<double> moved = scene;
        const mat3<double> R = any_rotation();
        const vec3<double> t = around(vec3<double>(0), 10);
        for (auto& m : moved.means) m = R * m + t;
        for (auto& F : moved.factors) F = R * F;
        moved.camera.R = scene.camera.R * transpose(R);
        moved.camera.t = scene.camera.t - moved.camera.R * t;
        const auto picture = draw_wild(one_thread(), scene), other = draw_wild(one_thread(), moved);
        const std::string text = difference(other.numbers(), picture.numbers(), 1e-5);
        require(text.empty(), [&] { return text; });
    });
}

TEST_CASE("a mirrored scene has the mirrored picture, and exchanged axes exchange rows and columns") {
    check_property([] {
        WildScene<double> scene = wild_scene(Wildness::no_jumps);
        const bool mirror = rarely(2);
        WildScene<double> other = scene;
        // Maps camera axes. The camera of the other scene stands in the origin and looks along z.
        const mat3<double> A = mirror
                                   ? mat3<double>(vec3<double>(-1, 0, 0), vec3<double>(0, 1, 0), vec3<double>(0, 0, 1))
                                   : mat3<double>(vec3<double>(0, 1, 0), vec3<double>(1, 0, 0), vec3<double>(0, 0, 1));
        Camera<double>& camera = other.camera;
        for (auto& m : other.means) m = A * to_camera(scene.camera, m);
        for (auto& F : other.factors) F = A * (scene.camera.R * F);
        camera.R = mat3<double>(1.0), camera.t = vec3<double>(0);
        if (mirror)
            camera.cx = camera.width - camera.cx;
        else
            std::swap(camera.fx, camera.fy), std::swap(camera.cx, camera.cy), std::swap(camera.width, camera.height);
        const auto picture = draw_wild(one_thread(), scene), changed = draw_wild(one_thread(), other);
        const auto [color, back] = std::pair(&picture.color, &changed.color);
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < color->height; ++y)
                for (int x = 0; x < color->width; ++x) {
                    const double expected = color->at(c, y, x);
                    const double found = mirror ? back->at(c, y, color->width - 1 - x) : back->at(c, x, y);
                    require(std::abs(found - expected) <= 1e-5 * std::max(1.0, std::abs(expected)), [&] {
                        return "pixel (" + std::to_string(x) + ", " + std::to_string(y) + ") is " + digits(found) +
                               ", expected " + digits(expected);
                    });
                }
    });
}

TEST_CASE("a part of a picture is the picture of the part") {
    check_property([] {
        WildScene<double> scene = wild_scene(Wildness::no_jumps);
        scene.params.jacobian_margin = 1e12; // no clamp of the Jacobian, which would depend on the picture's size
        WildScene<double> part = scene;
        Camera<double>& c = part.camera;
        const int x0 = int(below(std::size_t(c.width))), y0 = int(below(std::size_t(c.height)));
        c.width = 1 + int(below(std::size_t(c.width - x0))), c.height = 1 + int(below(std::size_t(c.height - y0)));
        c.cx -= x0, c.cy -= y0;
        const auto picture = draw_wild(one_thread(), scene), other = draw_wild(one_thread(), part);
        for (int k = 0; k < 3; ++k)
            for (int y = 0; y < c.height; ++y)
                for (int x = 0; x < c.width; ++x) {
                    const double found = other.color.at(k, y, x), expected = picture.color.at(k, y + y0, x + x0);
                    require(std::abs(found - expected) <= 1e-5 * std::max(1.0, std::abs(expected)), [&] {
                        return "pixel (" + std::to_string(x) + ", " + std::to_string(y) + ") is " + digits(found) +
                               ", expected " + digits(expected) + "\n" + text_of(scene);
                    });
                }
    });
}

TEST_CASE("one more splat lets no more light through, where no pixel stops early") {
    check_property([] {
        WildScene<float> scene = in_float(wild_scene(Wildness::everything));
        scene.params.transmittance_min = 0;
        WildScene<float> more = scene;
        const WildScene<float> one =
            in_float(scene_of(scene.camera.cast<double>(), {wild_splat(Wildness::everything)}, !scene.factors.empty()));
        more.insert(below(scene.size() + 1), one, 0);
        const auto before = draw_wild(one_thread(), scene), after = draw_wild(one_thread(), more);
        for (std::size_t p = 0; p < before.alpha.data.size(); ++p)
            // The product of the transparencies is rounded in another order.
            require(after.alpha.data[p] >= before.alpha.data[p] - 4e-6f, [&] {
                return "alpha falls from " + digits(before.alpha.data[p]) + " to " + digits(after.alpha.data[p]);
            });
    });
}
