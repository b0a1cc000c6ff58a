// SPDX-License-Identifier: Apache-2.0
/// @file  One posed Gaussian: its equations, its adjoint in every deformation, lanes, and views of arrays.
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/wide.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"
#include "support/guarded.hpp"
#include "support/skinned_scene.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t element_basis = 9; // of degree 2

/// One Gaussian's numbers, whose colours lie within (0, 1), away from the clamp's kinks.
template <class D>
struct ElementCase {
    using Skinned = SkinnedGaussian<2, D>;
    using Input = typename Skinned::template Input<double>;
    using Gradient = typename Skinned::template Gradient<double>;

    std::vector<vec3<double>> sh;
    Input in;
    Splat<double> dL_dout;

    explicit ElementCase(std::uint64_t seed) {
        test::Rng rng(seed);
        sh = rng.vecs(element_basis, -0.05, 0.05);
        in = {rng.vec(), rng.quat(), rng.vec(), rng.uniform(-2, 2), sh.data(), rng.uniform(0.5, 1), {}, rng.vec(4, 6)};
        for (double& x : test::scalars(in.blend)) x = rng.uniform(-0.4, 0.4);
        if constexpr (std::is_same_v<D, DualQuaternionBlend>)
            in.blend.real.w += 1.5; // not of unit length, as sums of dual quaternions are
        else
            in.blend.linear += mat3<double>(1.0);
        const vec3<double> a = rng.vec(), b = rng.vec();
        dL_dout = {rng.vec(), {a.x, a.y, a.z, b.x, b.y, b.z}, rng.normal(), rng.vec()};
    }
    [[nodiscard]] double loss() const {
        const Splat<double> out = Skinned::forward(in, ColorClamp::both);
        const sym3<double>&c = out.covariance, &d = dL_dout.covariance;
        return dot(out.mean, dL_dout.mean) + dot(out.color, dL_dout.color) + out.opacity * dL_dout.opacity +
               c.xx * d.xx + c.xy * d.xy + c.xz * d.xz + c.yy * d.yy + c.yz * d.yz + c.zz * d.zz;
    }
};

mat3<double> full_covariance(const sym3<double>& s) {
    return {{s.xx, s.xy, s.xz}, {s.xy, s.yy, s.yz}, {s.xz, s.yz, s.zz}};
}

} // namespace

TEST_CASE("mean, covariance, opacity and colour are those of the blend's map and of its true inverse") {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
        const ElementCase<LinearBlend> c(seed);
        const Affine<double>& M = c.in.blend; // with shear
        const Splat<double> out = SkinnedGaussian<2>::forward(c.in, ColorClamp::both);
        CHECK(length(out.mean - (M.linear * c.in.mean + M.translation)) < 1e-14);
        CHECK(out.opacity == doctest::Approx(1 / (1 + std::exp(-c.in.opacity_logit))));
        const mat3<double> R = rotation_from_quat(c.in.q);
        mat3<double> S(1.0);
        for (int k = 0; k < 3; ++k) S[k][k] = std::exp(c.in.log_scale[k]);
        const mat3<double> factor = M.linear * R * S,
                           difference = full_covariance(out.covariance) - factor * transpose(factor);
        for (int k = 0; k < 3; ++k) CHECK(length(difference[k]) < 1e-12);
        const vec3<double> dir = normalize(inverse(M.linear) * (out.mean - c.in.center));
        const vec3<double> color = (SHEval<2>::forward(c.sh.data(), dir) + vec3<double>(0.5)) * c.in.ao;
        CHECK(length(out.color - color) < 1e-12);
    }
}

TEST_CASE("a rigid transform moves the Gaussian and leaves its colour to a camera that moves along") {
    test::Rng rng(3);
    using S = SkinnedGaussian<2>;
    const auto sh = rng.vecs(9, -0.2, 0.2);
    const Affine<double> rigid{rotation_from_axis_angle(rng.vec()), rng.vec()};
    S::Input<double> in{rng.vec(), rng.quat(), rng.vec(), 0.4, sh.data(), 0.8, {}, rng.vec(3, 4)};
    const auto rest = S::forward(in, ColorClamp::both);
    in.blend = rigid, in.center = rigid(in.center);
    const auto posed = S::forward(in, ColorClamp::both);
    CHECK(length(posed.mean - rigid(rest.mean)) < 1e-14);
    CHECK(length(posed.color - rest.color) < 1e-14);
    CHECK(posed.opacity == rest.opacity);
    CHECK(posed.opacity == doctest::Approx(1 / (1 + std::exp(-0.4))));
    const auto expected = congruence(rigid.linear, rest.covariance);
    CHECK(posed.covariance.xy == doctest::Approx(expected.xy));
    CHECK(posed.covariance.zz == doctest::Approx(expected.zz));
}

TEST_CASE("a singular blend gives a flat Gaussian with a colour") {
    ElementCase<LinearBlend> c(3);
    c.in.blend.linear[2] = c.in.blend.linear[0] * 0.5 + c.in.blend.linear[1];
    for (const bool zero : {false, true}) {
        if (zero) c.in.blend = Affine<double>::zero();
        const Splat<double> out = SkinnedGaussian<2>::forward(c.in, ColorClamp::both);
        CHECK(std::abs(determinant(full_covariance(out.covariance))) < 1e-12);
        for (int k = 0; k < 3; ++k) CHECK((out.color[k] > 0 && out.color[k] < 1));
        ElementCase<LinearBlend>::Gradient gradient;
        std::vector<vec3<double>> dL_dsh(element_basis, vec3<double>(0));
        gradient.sh = dL_dsh.data();
        SkinnedGaussian<2>::backward(c.in, ColorClamp::both, c.dL_dout, gradient);
        for (const double x : test::scalars(gradient.blend)) CHECK(std::isfinite(x));
        for (const double x : test::scalars(gradient.center)) CHECK(std::isfinite(x));
    }
}

TEST_CASE_TEMPLATE("the adjoint of one Gaussian is the gradient in every number of its input, and adds", D, LinearBlend,
                   PolarBlend, DualQuaternionBlend) {
    for (const std::uint64_t seed : {11, 12, 13}) {
        ElementCase<D> c(seed);
        typename ElementCase<D>::Gradient gradient;
        std::vector<vec3<double>> dL_dsh(element_basis, vec3<double>(0));
        gradient.sh = dL_dsh.data();
        const auto backward = [&] { ElementCase<D>::Skinned::backward(c.in, ColorClamp::both, c.dL_dout, gradient); };
        const auto loss = [&] { return c.loss(); };
        backward();
        // The members of an Input and of its Gradient, but for the coefficients, which are pointers.
        const auto for_each_member = [&](const auto& check) {
            check(test::scalars(c.in.mean), test::scalars(gradient.mean));
            check(test::scalars(c.in.q), test::scalars(gradient.q));
            check(test::scalars(c.in.log_scale), test::scalars(gradient.log_scale));
            check(test::scalars(c.in.opacity_logit), test::scalars(gradient.opacity_logit));
            check(test::scalars(c.sh), test::scalars(dL_dsh));
            check(test::scalars(c.in.ao), test::scalars(gradient.ao));
            check(test::scalars(c.in.blend), test::scalars(gradient.blend));
            check(test::scalars(c.in.center), test::scalars(gradient.center));
        };
        std::vector<double> once;
        for_each_member([&](Span<double> x, Span<double> dL_dx) {
            test::check_gradient(loss, x, dL_dx, {.tolerance = 4e-6});
            once.insert(once.end(), dL_dx.begin(), dL_dx.end());
        });
        backward();
        std::size_t k = 0;
        for_each_member([&](Span<double>, Span<double> dL_dx) {
            for (const double twice : dL_dx) CHECK(twice == doctest::Approx(2 * once[k++]).epsilon(1e-12));
        });
    }
}

TEST_CASE("a register of Gaussians equals its lanes, forward and backward") {
    using P = Wide<double>;
    using S = SkinnedGaussian<2>;
    constexpr std::size_t width = LaneTraits<P>::width;
    const test::SkinnedScene<double> scene(width, 9, 9, 11);
    const test::SplatArrays<double> dL_dsplats(width, 12);
    std::vector<S::Input<double>> in(width);
    std::vector<S::Output<double>> dL_dout(width), out(width);
    std::vector<S::Gradient<double>> gradient(width);
    std::vector<vec3<double>> dL_dsh(width * 9, vec3<double>(0));
    for (std::size_t i = 0; i < width; ++i) {
        in[i] = {scene.means[i],
                 scene.quats[i],
                 scene.log_scales[i],
                 scene.logits[i],
                 scene.sh.data() + 9 * i,
                 scene.ao[i],
                 scene.bones[i % scene.joint_count],
                 scene.center[0]};
        dL_dout[i] = {dL_dsplats.means[i], dL_dsplats.covariances[i], dL_dsplats.opacities[i], dL_dsplats.colors[i]};
        gradient[i].sh = dL_dsh.data() + 9 * i;
        out[i] = S::forward(in[i], ColorClamp::both);
        S::backward(in[i], ColorClamp::both, dL_dout[i], gradient[i]);
    }
    const auto pack = [&](auto number) {
        double lanes[width];
        for (std::size_t i = 0; i < width; ++i) lanes[i] = number(i);
        return P::load(lanes);
    };
    const auto pack3 = [&](auto vector) {
        return vec3<P>(pack([&](std::size_t i) { return vector(i).x; }),
                       pack([&](std::size_t i) { return vector(i).y; }),
                       pack([&](std::size_t i) { return vector(i).z; }));
    };
    vec3<P> sh[9], dL_dsh_packed[9];
    for (std::size_t k = 0; k < 9; ++k)
        sh[k] = pack3([&](std::size_t i) { return in[i].sh[k]; }), dL_dsh_packed[k] = vec3<P>(P(0.0));
    S::Input<P> packed;
    packed.mean = pack3([&](std::size_t i) { return in[i].mean; });
    packed.q = {pack([&](std::size_t i) { return in[i].q.w; }), pack([&](std::size_t i) { return in[i].q.x; }),
                pack([&](std::size_t i) { return in[i].q.y; }), pack([&](std::size_t i) { return in[i].q.z; })};
    packed.log_scale = pack3([&](std::size_t i) { return in[i].log_scale; });
    packed.opacity_logit = pack([&](std::size_t i) { return in[i].opacity_logit; });
    packed.sh = sh;
    packed.ao = pack([&](std::size_t i) { return in[i].ao; });
    for (int c = 0; c < 3; ++c) packed.blend.linear[c] = pack3([&](std::size_t i) { return in[i].blend.linear[c]; });
    packed.blend.translation = pack3([&](std::size_t i) { return in[i].blend.translation; });
    packed.center = pack3([&](std::size_t i) { return in[i].center; });
    const auto found = S::forward(packed, ColorClamp::both);

    S::Output<P> dL_dpacked;
    dL_dpacked.mean = pack3([&](std::size_t i) { return dL_dout[i].mean; });
    dL_dpacked.color = pack3([&](std::size_t i) { return dL_dout[i].color; });
    dL_dpacked.opacity = pack([&](std::size_t i) { return dL_dout[i].opacity; });
    dL_dpacked.covariance = {pack([&](std::size_t i) { return dL_dout[i].covariance.xx; }),
                             pack([&](std::size_t i) { return dL_dout[i].covariance.xy; }),
                             pack([&](std::size_t i) { return dL_dout[i].covariance.xz; }),
                             pack([&](std::size_t i) { return dL_dout[i].covariance.yy; }),
                             pack([&](std::size_t i) { return dL_dout[i].covariance.yz; }),
                             pack([&](std::size_t i) { return dL_dout[i].covariance.zz; })};
    S::Gradient<P> packed_gradient;
    packed_gradient.sh = dL_dsh_packed;
    S::backward(packed, ColorClamp::both, dL_dpacked, packed_gradient);

    for (std::size_t i = 0; i < width; ++i) {
        for (int k = 0; k < 3; ++k) {
            CHECK(found.mean[k][i] == doctest::Approx(out[i].mean[k]));
            CHECK(found.color[k][i] == doctest::Approx(out[i].color[k]));
            CHECK(packed_gradient.mean[k][i] == doctest::Approx(gradient[i].mean[k]));
            CHECK(packed_gradient.log_scale[k][i] == doctest::Approx(gradient[i].log_scale[k]));
            CHECK(packed_gradient.blend.translation[k][i] == doctest::Approx(gradient[i].blend.translation[k]));
            CHECK(packed_gradient.center[k][i] == doctest::Approx(gradient[i].center[k]));
            for (int r = 0; r < 3; ++r)
                CHECK(packed_gradient.blend.linear[k][r][i] == doctest::Approx(gradient[i].blend.linear[k][r]));
            for (std::size_t b = 0; b < 9; ++b) CHECK(dL_dsh_packed[b][k][i] == doctest::Approx(dL_dsh[9 * i + b][k]));
        }
        CHECK(found.covariance.xz[i] == doctest::Approx(out[i].covariance.xz));
        CHECK(found.opacity[i] == doctest::Approx(out[i].opacity));
        CHECK(packed_gradient.q.y[i] == doctest::Approx(gradient[i].q.y));
        CHECK(packed_gradient.ao[i] == doctest::Approx(gradient[i].ao));
        CHECK(packed_gradient.opacity_logit[i] == doctest::Approx(gradient[i].opacity_logit));
    }
}

TEST_CASE(
    "an input has the numbers of its Gaussian: a stride of coefficients, no ao is 1, the centre may be computed") {
    const test::SkinnedScene<double> scene(3, 4, 6, 5); // degree 1, with two more vectors a Gaussian
    const std::vector<vec3<double>> computed{{7, 8, 9}};
    detail::SkinnedInput<1, double> input{scene.input(), scene.bones, scene.center[0], scene.sh_stride};
    for (std::size_t i = 0; i < 3; ++i) {
        const auto in = input[i];
        CHECK(in.mean == scene.means[i]);
        CHECK((in.q.w == scene.quats[i].w && in.q.z == scene.quats[i].z));
        CHECK(in.log_scale == scene.log_scales[i]);
        CHECK(in.opacity_logit == scene.logits[i]);
        CHECK(in.sh == scene.sh.data() + 6 * i);
        CHECK(in.ao == scene.ao[i]);
        const Affine<double> blended = blend(scene.input().weights, i, Span<const Affine<double>>(scene.bones));
        CHECK(in.blend.translation == blended.translation);
        CHECK(in.center == scene.center[0]);
    }
    input.gaussians.ao = {};
    input.center = {scene.center[0], Span<const vec3<double>>(computed)};
    CHECK(input[1].ao == 1);
    CHECK(input[1].center == computed[0]);
    CHECK(input.with_sh(1, scene.sh.data()).sh == scene.sh.data());
}

TEST_CASE("a Gaussian of arrays is posed into its own splat, and its adjoint adds to its own rows, bones and centre") {
    constexpr std::size_t count = 3;
    test::SkinnedScene<double> scene(count, 4, 6, 7), gradient = scene;
    gradient.clear();
    test::SplatArrays<double> splats(count);
    test::SplatArrays<double> dL_dsplats(count, 8);
    const auto input = [&] {
        return detail::SkinnedInput<1, double>{scene.input(), scene.bones, scene.center[0], scene.sh_stride};
    };
    const auto loss = [&] {
        const detail::SkinnedSplatForward<1, double> forward{input(), ColorClamp::both, splats.view()};
        for (std::size_t i = 0; i < count; ++i) forward(i);
        return inner(splats, dL_dsplats);
    };
    const auto backward = [&](std::size_t i, const SkinnedView<double>& to, Span<Affine<double>> dL_dbones) {
        const detail::SkinnedSplatBackward<1, double> element{input(), ColorClamp::both, dL_dsplats.view(), to, 6};
        element(i, dL_dbones, gradient.center[0]);
    };
    for (std::size_t i = 0; i < count; ++i) backward(i, gradient.view(), gradient.bones);
    test::check_attribute_gradients(loss, scene, gradient);
    test::check_gradient(loss, test::scalars(scene.bones), test::scalars(gradient.bones));
    test::check_gradient(loss, test::scalars(scene.center), test::scalars(gradient.center));

    // What is not asked for is left out, and the rest is the same.
    test::SkinnedScene<double> some = scene;
    some.clear();
    gradient.center[0] = vec3<double>(0);
    backward(1, {.log_scales = some.log_scales}, {});
    CHECK(some.log_scales[1] == gradient.log_scales[1]);
    CHECK(some.log_scales[0] == vec3<double>(0)); // another Gaussian's
    CHECK(gradient.center[0] != vec3<double>(0));

    // A Gaussian that the loss does not see adds nothing, whatever it is.
    dL_dsplats.means[1] = dL_dsplats.colors[1] = vec3<double>(0), dL_dsplats.covariances[1] = {};
    dL_dsplats.opacities[1] = 0;
    scene.means[1] = vec3<double>(std::nan(""));
    const auto before = gradient;
    backward(1, gradient.view(), gradient.bones);
    CHECK(gradient.means[1] == before.means[1]);
    CHECK(gradient.bones[1].translation == before.bones[1].translation);
    CHECK(gradient.center == before.center);
}

TEST_CASE("an attribute in memory that the backend does not reach is named") {
    test::Guarded backend;
    const test::SkinnedScene<double> scene(2, 9, 9, 9);
    const SkinnedView<const double> host = scene.input();
    const auto refuse = [&](auto choose, std::string_view name) { // a view that has one attribute only
        SkinnedView<const double> view;
        choose(view);
        test::check_throws<MemoryError>([&] { check_memory(backend, "pose", "gaussians", view); },
                                        {"pose", "gaussians", name});
    };
    CHECK_NOTHROW(check_memory(backend, "pose", "gaussians", SkinnedView<const double>{}));
    refuse([&](auto& view) { view.means = host.means; }, "means");
    refuse([&](auto& view) { view.quats = host.quats; }, "quats");
    refuse([&](auto& view) { view.log_scales = host.log_scales; }, "log_scales");
    refuse([&](auto& view) { view.opacity_logits = host.opacity_logits; }, "opacity_logits");
    refuse([&](auto& view) { view.sh = host.sh; }, "sh");
    refuse([&](auto& view) { view.ao = host.ao; }, "ao");
    refuse([&](auto& view) { view.weights.joints = host.weights.joints; }, "weights.joints");
    refuse([&](auto& view) { view.weights.weights = host.weights.weights; }, "weights.weights");
    test::Guarded::Buffer<double> logits(2);
    CHECK_NOTHROW(check_memory(backend, "pose", "gaussians", SkinnedView<double>{.opacity_logits = logits}));
}
