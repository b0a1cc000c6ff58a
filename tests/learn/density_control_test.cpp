// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/learn/density_control.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

using namespace gsh;

namespace {

template <class B>
using Set = Gaussians<B, float>;

/// Gaussians that differ in every number, all small and half opaque.
GaussianCloud<float> numbered_cloud(std::size_t count, int degree = 1) {
    GaussianCloud<float> cloud(count, degree);
    test::Rng rng(5);
    const auto vec = [&](double low, double high) { return vec3<float>(rng.vec(low, high)); };
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec(-1, 1);
        const quat<double> q = rng.quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.log_scales[i] = vec(-6, -5.5);
        cloud.opacity_logits[i] = float(rng.uniform(-1, 1));
    }
    for (auto& value : cloud.sh) value = vec(-1, 1);
    return cloud;
}

/// The result of a backward pass: Gaussian i was visible and had this gradient, per pixel of a 200 x 100 image.
template <class B>
RasterCache<B, float> seen(const std::vector<float>& gradients, float screen_radius = 1) {
    RasterCache<B, float> cache;
    cache.width = 200, cache.height = 100;
    cache.visible.resize(gradients.size());
    cache.screen_gradient_norms.resize(gradients.size());
    cache.screen_radii.resize(gradients.size());
    for (std::size_t i = 0; i < gradients.size(); ++i) {
        cache.visible[i] = gradients[i] >= 0;
        cache.screen_gradient_norms[i] = std::max(0.0f, gradients[i]) / 100;
        cache.screen_radii[i] = screen_radius;
    }
    return cache;
}

/// A density control on some Gaussians. Their moments encode their index.
template <class B>
struct Fixture {
    B backend;
    DensityControl<B> control;
    Set<B> gaussians, m, v;
    GaussianCloud<float> before;

    explicit Fixture(const GaussianCloud<float>& cloud, const DensityParams& params = {}, B where = B())
        : backend(std::move(where)), control(backend, params, 1.0, 3), before(cloud) {
        upload(backend, cloud, gaussians);
        upload(backend, cloud, m);
        upload(backend, cloud, v);
        for (float& x : v.opacity_logits) x += 100;
        control.restart(cloud.size());
    }
    Fixture(const Fixture&) = delete;
    DensityChange adapt(bool prune_large = false) { return control.adapt(gaussians, m, v, 11, prune_large); }
};

/// Whether Gaussian i of one set is bit-identical to Gaussian j of another.
bool same(const GaussianCloud<float>& a, std::size_t i, const GaussianCloud<float>& b, std::size_t j) {
    const auto basis = static_cast<std::size_t>(sh_basis_count(a.sh_degree));
    const auto equal = [](const auto& x, const auto& y) { return std::memcmp(&x, &y, sizeof x) == 0; };
    return equal(a.means[i], b.means[j]) && equal(a.quats[i], b.quats[j]) && equal(a.log_scales[i], b.log_scales[j]) &&
           a.opacity_logits[i] == b.opacity_logits[j] &&
           std::memcmp(&a.sh[i * basis], &b.sh[j * basis], basis * sizeof(vec3<float>)) == 0;
}
bool is_zero(const GaussianCloud<float>& a, std::size_t i) {
    GaussianCloud<float> zero(1, a.sh_degree);
    zero.quats[0] = {0, 0, 0, 0};
    return same(a, i, zero, 0);
}

constexpr float busy = 3e-4f, quiet = 1e-4f;

} // namespace

TEST_CASE("each Gaussian meets the fate that its gradient, size and opacity call for") {
    GaussianCloud<float> cloud = numbered_cloud(8);
    cloud.log_scales[1].y = std::log(0.02f);               // large, with a large gradient: split
    cloud.log_scales[2].z = std::log(0.02f);               // large, with a small gradient: unchanged
    cloud.opacity_logits[3] = logit(0.004f);               // faint: pruned in spite of its large gradient
    cloud.opacity_logits[4] = logit(0.006f);               // just above the limit: unchanged
    cloud.log_scales[6].x = std::log(0.2f);                // far too large, small gradient: pruned if prune_large
    for (const bool prune_large : {false, true}) {
        CAPTURE(prune_large);
        Fixture<cpu::Serial> f(cloud);
        f.control.observe(seen<cpu::Serial>({busy, busy, quiet, busy, quiet, -1, quiet, busy}));
        const DensityChange change = f.adapt(prune_large);
        CHECK(change.cloned == 2);
        CHECK(change.split == 1);
        CHECK(change.pruned == (prune_large ? 2 : 1));
        const auto after = download(f.backend, f.gaussians);
        // 0 0' 1a 1b 2 4 5 (6) 7 7'
        REQUIRE(after.size() == (prune_large ? 9 : 10));
        CHECK(same(after, 0, f.before, 0));
        CHECK(same(after, 1, f.before, 0));
        for (const std::size_t part : {2, 3}) {
            CHECK(after.opacity_logits[part] == f.before.opacity_logits[1]);
            CHECK(after.quats[part].x == f.before.quats[1].x);
            CHECK(after.sh[4 * part + 3] == f.before.sh[4 * 1 + 3]);
            for (int k = 0; k < 3; ++k)
                CHECK(after.log_scales[part][k] == doctest::Approx(f.before.log_scales[1][k] - std::log(1.6)));
            CHECK(length(after.means[part] - f.before.means[1]) < 0.1f);
            CHECK(after.means[part] != f.before.means[1]);
        }
        CHECK(after.means[2] != after.means[3]);
        CHECK(same(after, 4, f.before, 2));
        CHECK(same(after, 5, f.before, 4));
        CHECK(same(after, 6, f.before, 5));
        CHECK(same(after, after.size() - 1, f.before, 7));

        // Gaussians that stay keep their moments. New ones start at zero.
        const auto m = download(f.backend, f.m), v = download(f.backend, f.v);
        REQUIRE(m.size() == after.size());
        for (const std::size_t row : {1, 2, 3}) CHECK((is_zero(m, row) && is_zero(v, row)));
        CHECK(same(m, 0, f.before, 0));
        CHECK(same(m, 4, f.before, 2));
        CHECK(same(m, 6, f.before, 5));
        CHECK(v.opacity_logits[4] == f.before.opacity_logits[2] + 100);
        CHECK(is_zero(m, m.size() - 1));
        CHECK(same(m, m.size() - 2, f.before, 7));

        // The statistics are reset.
        CHECK(!f.adapt().changed());
    }
}

TEST_CASE("gradients are averaged over the views that saw the Gaussian, in halves of the longer side") {
    Fixture<cpu::Serial> f(numbered_cloud(3), {.gradient_threshold = 2e-4});
    f.control.observe(seen<cpu::Serial>({5e-4f, 5e-4f, 1e-4f}));
    f.control.observe(seen<cpu::Serial>({-1, 0, 1e-4f}));
    f.control.observe(seen<cpu::Serial>({-1, 0, 1e-4f}));
    const DensityChange change = f.adapt(); // means 5e-4, 1.67e-4, 1e-4
    CHECK(change.cloned == 1);
    CHECK(same(download(f.backend, f.gaussians), 1, f.before, 0));
}

TEST_CASE("a Gaussian that is too large on the screen in any view goes, if there is such a limit") {
    for (const double limit : {0.0, 19.0, 21.0}) {
        CAPTURE(limit);
        Fixture<cpu::Serial> f(numbered_cloud(1), {.large_on_screen = limit});
        f.control.observe(seen<cpu::Serial>({quiet}, 20));
        f.control.observe(seen<cpu::Serial>({quiet}, 2));
        CHECK(f.adapt(true).pruned == (limit == 19.0 ? 1 : 0));
    }
}

TEST_CASE("the number never exceeds its limit, and the largest gradients are served first") {
    GaussianCloud<float> cloud = numbered_cloud(6);
    cloud.log_scales[4].x = std::log(0.05f);
    for (std::size_t most = 4; most <= 12; ++most) {
        CAPTURE(most);
        Fixture<cpu::Serial> f(cloud, {.max_gaussians = most});
        f.control.observe(seen<cpu::Serial>({3e-4f, 9e-4f, 5e-4f, 5e-4f, 7e-4f, quiet}));
        const DensityChange change = f.adapt();
        CHECK(f.gaussians.size() == std::max<std::size_t>(6, std::min<std::size_t>(most, 11)));
        CHECK(change.split == (most >= 8 ? 1 : 0)); // its gradient is the second largest
        CHECK(change.cloned + change.split == std::min<std::size_t>(5, most - std::min<std::size_t>(most, 6)));
        const auto after = download(f.backend, f.gaussians);
        if (most == 9) CHECK(same(after, 4, f.before, 2)); // a tie of 2 and 3 is won by the first
    }
    // A split into more parts needs more room. A Gaussian that needs less may still fit.
    Fixture<cpu::Serial> f(cloud, {.split_count = 4, .max_gaussians = 9});
    f.control.observe(seen<cpu::Serial>({3e-4f, 9e-4f, 5e-4f, 5e-4f, 7e-4f, quiet}));
    const DensityChange change = f.adapt();
    CHECK(change.cloned == 3);
    CHECK(change.split == 0);
    CHECK(f.gaussians.size() == 9);
}

TEST_CASE("parts are distributed as their parent is") {
    constexpr std::size_t count = 4000;
    GaussianCloud<float> cloud(count, 0);
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = {1, -2, 3};
        cloud.quats[i] = {2, 0, 0, 2}; // a quarter turn about z, not normalised
        cloud.log_scales[i] = {std::log(0.5f), std::log(0.1f), std::log(0.2f)};
    }
    Fixture<cpu::Serial> f(cloud);
    f.control.observe(seen<cpu::Serial>(std::vector<float>(count, busy)));
    CHECK(f.adapt().split == count);
    REQUIRE(f.gaussians.size() == 2 * count);
    vec3<double> mean(0.0), square(0.0);
    for (const auto& x : f.gaussians.means) {
        const vec3<double> d = vec3<double>(x) - vec3<double>(1, -2, 3);
        mean += d / (2.0 * count), square += d * d / (2.0 * count);
    }
    const vec3<double> sigma(0.1, 0.5, 0.2);
    for (int k = 0; k < 3; ++k) {
        CHECK(std::abs(mean[k]) < 0.05 * sigma[k]);
        CHECK(std::sqrt(square[k]) == doctest::Approx(sigma[k]).epsilon(0.04));
    }
}

TEST_CASE("cloning and splitting keep the picture close") {
    cpu::Serial backend;
    GaussianCloud<float> cloud(300, 0);
    test::Rng rng(8);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const auto number = [&](double low, double high) { return float(rng.uniform(low, high)); };
        cloud.means[i] = {number(-0.5, 0.5), number(-0.5, 0.5), number(-0.5, 0.5)};
        cloud.log_scales[i] = vec3<float>(rng.vec(std::log(0.02), std::log(0.06)));
        cloud.opacity_logits[i] = number(-1, 2);
        cloud.sh[i] = sh_of_color(cloud.means[i] + vec3<float>(0.5f)); // colours are smooth in space, as on a surface
    }
    const auto picture = [&](Set<cpu::Serial>& gaussians) {
        const auto camera = look_at<float>({0, 0, -2}, {0, 0, 0}, {0, 1, 0}, 0.7f, 64, 64);
        Splats<cpu::Serial> splats;
        splats.resize(gaussians.size());
        StaticSplats<cpu::Serial, 0>::Cache splats_cache;
        StaticSplats<cpu::Serial, 0>(backend).forward(std::as_const(gaussians).view(), camera.center(), splats.view(),
                                                      splats_cache);
        Image<float> image(3, 64, 64);
        Rasterizer<cpu::Serial>::Cache cache;
        Rasterizer<cpu::Serial>(backend).forward(camera, std::as_const(splats).view(), {}, {.color = image.view()},
                                                 cache);
        return image;
    };
    for (const double small : {0.01, 10.0}) { // all are split, all are cloned
        CAPTURE(small);
        Fixture<cpu::Serial> f(cloud, {.small = small});
        const Image<float> before = picture(f.gaussians);
        f.control.observe(seen<cpu::Serial>(std::vector<float>(cloud.size(), busy)));
        const DensityChange change = f.adapt();
        CHECK((small < 1 ? change.split : change.cloned) == cloud.size());
        const Image<float> after = picture(f.gaussians);
        const double decibels = psnr(after.view(), before.view());
        CHECK(decibels > 20);
    }
}

TEST_CASE("a reset leaves at most its opacity and forgets the moments of opacities alone") {
    GaussianCloud<float> cloud = numbered_cloud(3);
    cloud.opacity_logits[2] = logit(0.007f);
    Fixture<cpu::Serial> f(cloud);
    f.control.reset_opacity(f.gaussians, f.m, f.v);
    const auto after = download(f.backend, f.gaussians), m = download(f.backend, f.m), v = download(f.backend, f.v);
    CHECK(sigmoid(after.opacity_logits[0]) == doctest::Approx(0.01));
    CHECK(sigmoid(after.opacity_logits[1]) == doctest::Approx(0.01));
    CHECK(after.opacity_logits[2] == cloud.opacity_logits[2]);
    CHECK(after.means == cloud.means);
    CHECK(m.opacity_logits == std::vector<float>(3, 0.0f));
    CHECK(v.opacity_logits == std::vector<float>(3, 0.0f));
    CHECK(m.sh == cloud.sh);
    CHECK(f.gaussians.size() == 3);
}

TEST_CASE("the schedule of 3DGS") {
    const DensityParams params;
    std::vector<std::int64_t> changes, resets;
    for (std::int64_t step = 1; step <= 30000; ++step) {
        if (params.adapts_after(step)) changes.push_back(step);
        if (params.resets_after(step)) resets.push_back(step);
    }
    CHECK(changes.size() == 144);
    CHECK(changes.front() == 600);
    CHECK(changes.back() == 14900);
    CHECK(resets == std::vector<std::int64_t>{3000, 6000, 9000, 12000});
    CHECK(!params.prunes_large_after(3000));
    CHECK(params.prunes_large_after(3100));

    Fixture<cpu::Serial> f(numbered_cloud(2), {.start = 0, .stop = 10, .interval = 2, .reset_interval = 3});
    f.control.observe(seen<cpu::Serial>({busy, quiet}));
    CHECK(!f.control.after_step(1, f.gaussians, f.m, f.v).changed());
    CHECK(f.control.after_step(2, f.gaussians, f.m, f.v).cloned == 1);
    const DensityChange third = f.control.after_step(3, f.gaussians, f.m, f.v);
    CHECK(third.opacity_reset);
    CHECK(!third.changed());
}

TEST_CASE("the same seed gives the same Gaussians at any thread count") {
    GaussianCloud<float> cloud = numbered_cloud(5000, 2);
    std::vector<float> gradients(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        gradients[i] = static_cast<float>(random_uniform(4, i) * 4e-4 - 1e-5);
        if (i % 3 == 0) cloud.log_scales[i].x = -2;
        if (i % 7 == 0) cloud.opacity_logits[i] = -9;
    }
    Fixture<cpu::Serial> serial(cloud, {.max_gaussians = 5200});
    serial.control.observe(seen<cpu::Serial>(gradients));
    const DensityChange expected = serial.adapt(true);
    CHECK(expected.cloned > 100);
    CHECK(expected.split > 100);
    CHECK(serial.gaussians.size() == 5200);
    const auto truth = download(serial.backend, serial.gaussians), truth_m = download(serial.backend, serial.m);
    for (const std::size_t threads : {1, 2, 5}) {
        Fixture<cpu::Threads> f(cloud, {.max_gaussians = 5200}, cpu::Threads(threads));
        f.control.observe(seen<cpu::Threads>(gradients));
        CHECK(f.adapt(true).split == expected.split);
        const auto found = download(f.backend, f.gaussians), m = download(f.backend, f.m);
        REQUIRE(found.size() == truth.size());
        bool equal = true;
        for (std::size_t i = 0; i < truth.size(); ++i)
            equal = equal && same(found, i, truth, i) && same(m, i, truth_m, i);
        CHECK(equal);
    }
}

TEST_CASE("nothing and one") {
    for (const std::size_t count : {0, 1}) {
        Fixture<cpu::Serial> f(numbered_cloud(count));
        f.control.observe(seen<cpu::Serial>(std::vector<float>(count, busy)));
        CHECK(f.adapt(true).cloned == count);
        CHECK(f.gaussians.size() == 2 * count);
        f.control.reset_opacity(f.gaussians, f.m, f.v);
    }
    GaussianCloud<float> faint = numbered_cloud(2);
    for (float& x : faint.opacity_logits) x = -20;
    Fixture<cpu::Serial> f(faint);
    CHECK(f.adapt().pruned == 2);
    CHECK(f.gaussians.size() == 0);
}

TEST_CASE("settings and sizes that make no sense are refused") {
    cpu::Serial backend;
    const auto refuse = [&](const DensityParams& params, double extent, std::string_view word) {
        test::check_throws<ValueError>([&] { DensityControl<cpu::Serial>(backend, params, extent, 0); }, {word});
    };
    refuse({}, 0, "extent");
    refuse({}, std::nan(""), "extent");
    refuse({.gradient_threshold = 0}, 1, "gradient_threshold");
    refuse({.interval = 0}, 1, "interval");
    refuse({.small = 0}, 1, "small");
    refuse({.min_opacity = 0}, 1, "min_opacity");
    refuse({.reset_opacity = 0.004}, 1, "reset_opacity");
    refuse({.split_factor = 0.5}, 1, "split_factor");
    refuse({.split_count = 0}, 1, "split_count");
    refuse({.max_gaussians = std::size_t(1) << 33}, 1, "max_gaussians");

    Fixture<cpu::Serial> f(numbered_cloud(3));
    test::check_throws<ShapeError>([&] { f.control.observe(seen<cpu::Serial>({busy})); }, {"visible", "restart"});
    f.m.resize(2, 1);
    test::check_throws<ShapeError>([&] { f.adapt(); }, {"m.means"});
    f.m.resize(3, 0);
    test::check_throws<ShapeError>([&] { f.control.reset_opacity(f.gaussians, f.m, f.v); }, {"m.sh"});
    f.m.resize(3, 1);
    f.control.restart(4);
    test::check_throws<ShapeError>([&] { f.adapt(); }, {"gaussians", "restart"});
}
