// SPDX-License-Identifier: Apache-2.0
#include <gsh/render/projection.hpp>
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"
#include "support/reference_rasterizer.hpp"

using namespace gsh;

namespace {

Camera<double> make_camera(test::Rng& rng) {
    Camera<double> camera;
    camera.R = rotation_matrix(normalize(quat<double>{1, 0.1 * rng.normal(), 0.1 * rng.normal(), 0.1 * rng.normal()}));
    camera.t = vec3<double>(0.1, -0.2, 3);
    camera.fx = 60, camera.fy = 65, camera.cx = 20.5, camera.cy = 11.25;
    camera.width = 48, camera.height = 32;
    return camera;
}

mat3<double> make_factor(test::Rng& rng, double size) {
    const auto columns = rng.vecs(3);
    return {columns[0] * size, columns[1] * size, columns[2] * size};
}
sym3<double> make_covariance(test::Rng& rng, double size) {
    return gram(make_factor(rng, size));
}

/// A random linear function of all results of project.
struct Weights {
    Projection<double> w;
    explicit Weights(test::Rng& rng)
        : w{{rng.uniform(-1, 1), rng.uniform(-1, 1)},
            rng.uniform(-1, 1),
            {rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)},
            rng.uniform(-1, 1),
            true,
            0} {}
    double operator()(const Projection<double>& p) const {
        return w.mean2d.x * p.mean2d.x + w.mean2d.y * p.mean2d.y + w.depth * p.depth +
               w.covariance.xx * p.covariance.xx + w.covariance.xy * p.covariance.xy +
               w.covariance.yy * p.covariance.yy + w.opacity_factor * p.opacity_factor;
    }
};

template <class Shape>
struct Inputs {
    Camera<double> camera;
    vec3<double> mean;
    Shape shape; ///< covariance, or a factor of it
};

template <class Shape>
void check_adjoint(Inputs<Shape> in, const ProjectionParams<double>& params, test::Rng& rng) {
    const Weights weights(rng);
    vec3<double> dL_dmean(0);
    Shape dL_dshape = in.shape;
    for (double& x : test::scalars(dL_dshape)) x = 0;
    CameraGradient<double> dL_dcamera;
    const auto loss = [&] { return weights(project(in.camera, in.mean, in.shape, params)); };
    project_backward(in.camera, in.mean, in.shape, params, weights.w, dL_dmean, dL_dshape, &dL_dcamera);
    test::check_gradient(loss, test::scalars(in.mean), test::scalars(dL_dmean));
    test::check_gradient(loss, test::scalars(in.shape), test::scalars(dL_dshape));
    test::check_gradient(loss, test::scalars(in.camera.R), test::scalars(dL_dcamera.dL_dR));
    test::check_gradient(loss, test::scalars(in.camera.t), test::scalars(dL_dcamera.dL_dt));
    test::check_gradient(loss, test::scalars(in.camera.fx), test::scalars(dL_dcamera.dL_dfx));
    test::check_gradient(loss, test::scalars(in.camera.fy), test::scalars(dL_dcamera.dL_dfy));
    test::check_gradient(loss, test::scalars(in.camera.cx), test::scalars(dL_dcamera.dL_dcx));
    test::check_gradient(loss, test::scalars(in.camera.cy), test::scalars(dL_dcamera.dL_dcy));

    Shape once = dL_dshape;
    const auto mean_once = dL_dmean;
    project_backward(in.camera, in.mean, in.shape, params, weights.w, dL_dmean, dL_dshape, &dL_dcamera);
    CHECK(test::scalars(dL_dshape)[2] == doctest::Approx(2 * test::scalars(once)[2]).epsilon(1e-14));
    CHECK(dL_dmean.z == doctest::Approx(2 * mean_once.z).epsilon(1e-14));
}

} // namespace

TEST_CASE("project_backward is the gradient of project") {
    test::Rng rng(1);
    const Camera<double> camera = make_camera(rng);
    ProjectionParams<double> params;
    const auto check_both = [&](const vec3<double>& mean) {
        for (const bool compensate : {false, true}) {
            params.compensate_opacity = compensate;
            check_adjoint<sym3<double>>({camera, mean, make_covariance(rng, 0.4)}, params, rng);
            check_adjoint<mat3<double>>({camera, mean, make_factor(rng, 0.4)}, params, rng);
        }
    };
    SUBCASE("inside the image") { check_both(rng.vec() * 0.3); }
    SUBCASE("right of the clamp") { check_both(vec3<double>(6, 0.1, 0)); }
    SUBCASE("beyond the upper left corner of the clamp") { check_both(vec3<double>(-5, -4, 0)); }
    SUBCASE("below the compensation's floor") {
        params.compensation_floor = 1;
        check_both(rng.vec() * 0.3);
    }
}

TEST_CASE("project agrees with the plain definition") {
    test::Rng rng(2);
    const Camera<double> camera = make_camera(rng);
    for (int i = 0; i < 200; ++i) {
        std::vector<vec3<double>> means{rng.vec(-4, 4)}, colors{rng.vec()};
        std::vector<sym3<double>> covariances{make_covariance(rng, 0.3)};
        std::vector<double> opacities{0.5};
        test::ReferenceOptions options;
        options.compensate_opacity = i % 2 == 1;
        test::ReferenceSplat reference;
        const SplatView<const double> view{means, covariances, opacities, colors};
        const bool visible = test::reference_project(camera, view, 0, options, reference);
        ProjectionParams<double> params;
        params.compensate_opacity = options.compensate_opacity;
        const Projection<double> p = project(camera, means[0], covariances[0], params);
        REQUIRE(p.in_front == visible);
        if (!visible) continue;
        CHECK(p.mean2d.x == doctest::Approx(reference.px).epsilon(1e-12));
        CHECK(p.mean2d.y == doctest::Approx(reference.py).epsilon(1e-12));
        CHECK(p.depth == doctest::Approx(reference.z).epsilon(1e-12));
        const double det = determinant(p.covariance);
        CHECK(p.covariance.yy / det == doctest::Approx(reference.conic_a).epsilon(1e-9));
        CHECK(p.covariance.xx / det == doctest::Approx(reference.conic_c).epsilon(1e-9));
        CHECK(0.5 * p.opacity_factor == doctest::Approx(reference.opacity).epsilon(1e-9));
    }
}

TEST_CASE("a register of Gaussians projects lane by lane as scalars do") {
    using P = Wide<double>;
    constexpr std::size_t width = LaneTraits<P>::width;
    test::Rng rng(3);
    const Camera<double> camera = make_camera(rng);
    Camera<P> wide;
    for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) wide.R[c][r] = P(camera.R[c][r]);
    for (int r = 0; r < 3; ++r) wide.t[r] = P(camera.t[r]);
    wide.fx = P(camera.fx), wide.fy = P(camera.fy), wide.cx = P(camera.cx), wide.cy = P(camera.cy);
    wide.width = camera.width, wide.height = camera.height;

    const auto means = rng.vecs(width, -5, 4); // some behind the camera, some beyond the clamp
    std::vector<sym3<double>> covariances;
    for (std::size_t i = 0; i < width; ++i) covariances.push_back(make_covariance(rng, 0.2));
    const auto pack = [&](const auto& member) {
        alignas(64) double lanes[width];
        for (std::size_t i = 0; i < width; ++i) lanes[i] = member(i);
        return P::load(lanes);
    };
    const vec3<P> mean(pack([&](auto i) { return means[i].x; }), pack([&](auto i) { return means[i].y; }),
                       pack([&](auto i) { return means[i].z; }));
    const sym3<P> covariance{
        pack([&](auto i) { return covariances[i].xx; }), pack([&](auto i) { return covariances[i].xy; }),
        pack([&](auto i) { return covariances[i].xz; }), pack([&](auto i) { return covariances[i].yy; }),
        pack([&](auto i) { return covariances[i].yz; }), pack([&](auto i) { return covariances[i].zz; })};
    ProjectionParams<double> params;
    params.compensate_opacity = true;
    const Projection<P> p = project(wide, mean, covariance, params);
    const Projection<P> dL{{P(1.0), P(2.0)}, P(3.0), {P(4.0), P(5.0), P(6.0)}, P(7.0), p.in_front, P(0.0)};
    vec3<P> dL_dmean(P(0.0));
    sym3<P> dL_dcovariance{P(0.0), P(0.0), P(0.0), P(0.0), P(0.0), P(0.0)};
    CameraGradient<P> dL_dcamera;
    project_backward(wide, mean, covariance, params, dL, dL_dmean, dL_dcovariance, &dL_dcamera);

    for (std::size_t i = 0; i < width; ++i) {
        INFO("lane " << i);
        const Projection<double> one = project(camera, means[i], covariances[i], params);
        CHECK(p.in_front[i] == one.in_front);
        CHECK(p.mean2d.x[i] == doctest::Approx(one.mean2d.x).epsilon(1e-12));
        CHECK(p.covariance.xy[i] == doctest::Approx(one.covariance.xy).epsilon(1e-12));
        CHECK(p.opacity_factor[i] == doctest::Approx(one.opacity_factor).epsilon(1e-12));
        vec3<double> one_mean(0);
        sym3<double> one_covariance{};
        CameraGradient<double> one_camera;
        project_backward(camera, means[i], covariances[i], params, {{1, 2}, 3, {4, 5, 6}, 7, true, 0}, one_mean,
                         one_covariance, &one_camera);
        CHECK(dL_dmean.z[i] == doctest::Approx(one_mean.z).epsilon(1e-10));
        CHECK(dL_dcovariance.yz[i] == doctest::Approx(one_covariance.yz).epsilon(1e-10));
        CHECK(dL_dcamera.dL_dfx[i] == doctest::Approx(one_camera.dL_dfx).epsilon(1e-10));
        CHECK(dL_dcamera.dL_dR[1].z[i] == doctest::Approx(one_camera.dL_dR[1].z).epsilon(1e-10));
    }
}

TEST_CASE("a factor and its covariance have the same projection") {
    test::Rng rng(5);
    const Camera<double> camera = make_camera(rng);
    for (int i = 0; i < 100; ++i) {
        const mat3<double> F = make_factor(rng, 0.3);
        const vec3<double> mean = rng.vec(-2, 2);
        ProjectionParams<double> params;
        params.compensate_opacity = i % 2 == 1;
        const Projection<double> a = project(camera, mean, F, params), b = project(camera, mean, gram(F), params);
        CHECK(a.covariance.xx == doctest::Approx(b.covariance.xx).epsilon(1e-12));
        CHECK(a.covariance.xy == doctest::Approx(b.covariance.xy).epsilon(1e-10));
        CHECK(a.covariance.yy == doctest::Approx(b.covariance.yy).epsilon(1e-12));
        CHECK(a.determinant == doctest::Approx(b.determinant).epsilon(1e-9));
        CHECK(a.determinant == doctest::Approx(determinant(b.covariance)).epsilon(1e-9));
        CHECK(a.opacity_factor == doctest::Approx(b.opacity_factor).epsilon(1e-9));
    }
}

TEST_CASE("the determinant by a factor keeps its digits where a needle is a million times longer than wide") {
    Camera<float> camera;
    camera.t = {0, 0, 8}, camera.fx = camera.fy = 120, camera.cx = camera.cy = 50, camera.width = camera.height = 100;
    const float h = std::sqrt(0.5f);
    const mat3<float> F(vec3<float>(h, h, 0) * 5e4f, vec3<float>(h, -h, 0) * 0.05f, vec3<float>(0, 0, 0.05f));
    const double scale = 15, dilation = 0.3, l2 = std::pow(scale * 5e4, 2), w2 = std::pow(scale * 0.05f, 2); // pixels
    const ProjectionParams<float> params{.compensate_opacity = true, .compensation_floor = 0};
    const Projection<float> p = project(camera, vec3<float>(0), F, params);
    CHECK(p.determinant == doctest::Approx((l2 + dilation) * (w2 + dilation)).epsilon(1e-6));
    CHECK(p.opacity_factor == doctest::Approx(std::sqrt(l2 * w2 / ((l2 + dilation) * (w2 + dilation)))).epsilon(1e-6));
}
