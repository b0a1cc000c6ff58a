// SPDX-License-Identifier: Apache-2.0
#include "support/gradient.hpp"
#include "support/skinned_scene.hpp"

#include <gsh/avatar/cpu/skinned_splats.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/math/linalg.hpp>
#include <gsh/math/rotation.hpp>

#include <Eigen/Eigenvalues>

#include <cmath>
#include <cstring>
#include <numbers>

namespace gsh {
namespace {

constexpr Deformation deformations[] = {Deformation::linear, Deformation::polar, Deformation::dual_quaternion};
constexpr double pi = std::numbers::pi;
using test::SplatArrays;

template <class T, class B = cpu::Serial>
using SkinnedDegree2 = SkinnedSplats<B, 2, T>;

/// A scene on a real skeleton, with bones from the kinematics of a pose.
struct Puppet {
    static constexpr std::size_t J = test::SkinnedScene<double>::joint_count;
    std::vector<int> parents = {-1, 0, 1, 1, 3};
    std::vector<vec3<double>> pose, joints, transl;
    test::SkinnedScene<double> scene;

    explicit Puppet(std::size_t count, std::uint64_t seed = 21, double turn = 1.2) : scene(count, 9, 9, seed) {
        test::Rng rng(seed + 1);
        pose = rng.vecs(J, -turn, turn), joints = rng.vecs(J), transl = rng.vecs(1);
        move();
    }
    [[nodiscard]] std::vector<mat3<double>> rotations() const {
        std::vector<mat3<double>> result;
        for (const auto& v : pose) result.push_back(rotation_from_axis_angle(v));
        return result;
    }
    void move() { bone_transforms<double>(parents, rotations(), joints, transl[0], scene.bones); }
};

bool bits_differ(const void* a, const void* b, std::size_t bytes) { return bytes && std::memcmp(a, b, bytes) != 0; }

/// Half-axes of an ellipsoid, smallest first.
vec3<double> half_axes(const sym3<double>& c) {
    Eigen::Matrix3d m;
    m << c.xx, c.xy, c.xz, c.xy, c.yy, c.yz, c.xz, c.yz, c.zz;
    const Eigen::Vector3d squared = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues();
    return {std::sqrt(squared(0)), std::sqrt(squared(1)), std::sqrt(squared(2))};
}

/// One ball on two bones, the second of which turns against the first.
struct Ball {
    std::vector<vec3<double>> means = {vec3<double>(0.1, 0, 0)}, log_scales = {vec3<double>(std::log(0.01))};
    std::vector<vec3<double>> sh = std::vector<vec3<double>>(9, vec3<double>(0));
    std::vector<quat<double>> quats = {{0.3, -0.5, 0.2, 0.7}};
    std::vector<double> logits = {0}, weights;
    std::vector<std::uint16_t> joints = {0, 1};

    SplatArrays<double> splats{1};
    SplatArrays<double>& pose(const Affine<double>& first, const Affine<double>& second, double share,
                              Deformation deformation) {
        weights = {1 - share, share};
        const std::vector<Affine<double>> bones = {first, second};
        cpu::Serial backend;
        SkinnedDegree2<double>::Cache cache;
        SkinnedDegree2<double>(backend, {.deformation = deformation})
            .forward({means, quats, log_scales, logits, sh, {}, {joints, weights, 2}}, bones, vec3<double>(0, 0, -3),
                     splats.view(), cache);
        return splats;
    }
};

TEST_CASE("every deformation's adjoint is the gradient with respect to pose, joints, translation and all attributes") {
    for (const Deformation deformation : deformations) {
        INFO("deformation " << static_cast<int>(deformation));
        constexpr std::size_t count = 7;
        Puppet puppet(count);
        auto& scene = puppet.scene;
        test::SkinnedScene<double> gradient = scene;
        gradient.clear();
        cpu::Serial backend;
        SplatArrays<double> splats(count);
        const SplatArrays<double> dL_dsplats(count, 22);
        const SkinnedDegree2<double> skin(backend, {.deformation = deformation});
        SkinnedDegree2<double>::Cache cache;
        const auto loss = [&] {
            puppet.move();
            skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
            return inner(splats, dL_dsplats);
        };
        std::vector<vec3<double>> dL_dpose(Puppet::J, vec3<double>(0)), dL_djoints = dL_dpose,
                                  dL_dtransl(1, vec3<double>(0));
        std::vector<mat3<double>> dL_drotations(Puppet::J, mat3<double>(0.0));
        std::vector<Affine<double>> scratch(Puppet::J);
        const auto backward = [&] {
            skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                          gradient.bones, gradient.center);
        };
        loss();
        backward();
        bone_transforms_backward<double>(puppet.parents, puppet.rotations(), puppet.joints, scene.bones, gradient.bones,
                                         dL_drotations, dL_djoints, dL_dtransl[0], scratch);
        for (std::size_t j = 0; j < Puppet::J; ++j)
            rotation_from_axis_angle_backward(puppet.pose[j], dL_drotations[j], dL_dpose[j]);

        test::check_gradient(loss, test::scalars(puppet.pose), test::scalars(dL_dpose), {.tolerance = 4e-6});
        test::check_gradient(loss, test::scalars(puppet.joints), test::scalars(dL_djoints), {.tolerance = 4e-6});
        test::check_gradient(loss, test::scalars(puppet.transl), test::scalars(dL_dtransl));
        test::check_attribute_gradients(loss, scene, gradient);
        test::check_gradient(loss, test::scalars(scene.center), test::scalars(gradient.center));

        const auto once = gradient;
        backward();
        for (std::size_t i = 0; i < count; ++i) {
            CHECK(gradient.means[i] == once.means[i] * 2.0);
            CHECK(gradient.quats[i].x == once.quats[i].x * 2.0);
            CHECK(gradient.ao[i] == once.ao[i] * 2.0);
        }
        for (std::size_t j = 0; j < Puppet::J; ++j) {
            CHECK(length(gradient.bones[j].translation - once.bones[j].translation * 2.0) < 1e-12);
            for (int c = 0; c < 3; ++c)
                CHECK(length(gradient.bones[j].linear[c] - once.bones[j].linear[c] * 2.0) < 1e-12);
        }
    }
}

TEST_CASE("linear and polar take bones that are no rotations, and are gradients in all their numbers") {
    for (const Deformation deformation : {Deformation::linear, Deformation::polar}) {
        test::SkinnedScene<double> scene(6, 9, 9, 23), gradient = scene;
        gradient.clear();
        cpu::Serial backend;
        SplatArrays<double> splats(6);
        const SplatArrays<double> dL_dsplats(6, 24);
        const SkinnedDegree2<double> skin(backend, {.deformation = deformation});
        SkinnedDegree2<double>::Cache cache;
        const auto loss = [&] {
            skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
            return inner(splats, dL_dsplats);
        };
        skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                      gradient.bones, gradient.center);
        test::check_gradient(loss, test::scalars(scene.bones), test::scalars(gradient.bones), {.tolerance = 4e-6});
    }
}

TEST_CASE("with dual quaternions a bone's nine numbers receive the gradient along turns, and nothing else") {
    Puppet puppet(6);
    auto& scene = puppet.scene;
    auto gradient = scene;
    gradient.clear();
    cpu::Serial backend;
    const SplatArrays<double> dL_dsplats(6, 25);
    const SkinnedDegree2<double> skin(backend, {.deformation = Deformation::dual_quaternion});
    SkinnedDegree2<double>::Cache cache;
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                  gradient.bones, gradient.center);
    double size = 0;
    for (std::size_t j = 0; j < Puppet::J; ++j) {
        const mat3<double> inside = transpose(scene.bones[j].linear) * gradient.bones[j].linear; // must be skew
        for (int c = 0; c < 3; ++c) {
            size += length(inside[c]);
            for (int r = 0; r < 3; ++r) CHECK(std::abs(inside[c][r] + inside[r][c]) < 1e-13);
        }
    }
    CHECK(size > 0.1);
}

TEST_CASE("Threads equals Serial bit for bit in every deformation, sizes from none to beyond a chunk") {
    for (const Deformation deformation : deformations)
        for (const std::size_t count : {0, 1, 17, 2049, 5003}) {
            const Puppet puppet(count, 26);
            test::SkinnedScene<float> scene(count, 9, 9, 26);
            for (std::size_t j = 0; j < Puppet::J; ++j)
                scene.bones[j] = {mat3<float>(puppet.scene.bones[j].linear),
                                  vec3<float>(puppet.scene.bones[j].translation)};
            const SplatArrays<float> dL_dsplats(count, 27);
            const auto run = [&](auto&& backend) {
                using B = std::remove_reference_t<decltype(backend)>;
                SplatArrays<float> splats(count);
                auto gradient = scene;
                gradient.clear();
                const SkinnedDegree2<float, B> skin(backend, {.deformation = deformation});
                typename SkinnedDegree2<float, B>::Cache cache;
                skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
                skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                              gradient.bones, gradient.center);
                return std::pair(splats, gradient);
            };
            const auto same = [](const auto& a, const auto& b) {
                return a.size() == b.size() && !bits_differ(a.data(), b.data(), a.size() * sizeof(a[0]));
            };
            const auto [splats, gradient] = run(cpu::Serial());
            for (const std::size_t threads : {1, 3}) {
                const auto [other_splats, other] = run(cpu::Threads(threads));
                CHECK(same(splats.means, other_splats.means));
                CHECK(same(splats.covariances, other_splats.covariances));
                CHECK(same(splats.colors, other_splats.colors));
                CHECK(same(gradient.means, other.means));
                CHECK(same(gradient.quats, other.quats));
                CHECK(same(gradient.sh, other.sh));
                CHECK(same(gradient.ao, other.ao));
                CHECK(same(gradient.bones, other.bones));
                CHECK(same(gradient.center, other.center));
            }
        }
}

/// The plain function objects, as a backend without an overload of its own runs them.
TEST_CASE_TEMPLATE("registers of Gaussians compute what one Gaussian at a time does", D, LinearBlend, PolarBlend,
                   DualQuaternionBlend) {
    constexpr std::size_t count = 45;
    const Puppet puppet(count, 28);
    const auto& scene = puppet.scene;
    const SplatArrays<double> dL_dsplats(count, 29);
    cpu::Serial backend;
    SplatArrays<double> wide(count), plain(count);
    auto wide_gradient = scene, plain_gradient = scene;
    wide_gradient.clear(), plain_gradient.clear();
    const SkinnedDegree2<double> skin(backend, {.deformation = D::value});
    SkinnedDegree2<double>::Cache cache;
    skin.forward(scene.input(), scene.bones, scene.center[0], wide.view(), cache);
    skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, wide_gradient.view(),
                  wide_gradient.bones, wide_gradient.center);

    using Bone = typename D::template Bone<double>;
    const Span<const Affine<double>> affine(scene.bones);
    const auto bones = detail::bones_of<D>(backend, affine, cache);
    const detail::SkinnedInput<2, double, D> input{scene.input(), bones, scene.center[0], 9};
    std::vector<Bone> dL_dbones(Puppet::J, Bone::zero());
    const detail::SkinnedSplatForward<2, double, D> forward{input, ColorClamp::both, plain.view()};
    const detail::SkinnedSplatBackward<2, double, D> backward{input, ColorClamp::both, dL_dsplats.view(),
                                                              plain_gradient.view(), 9};
    for (std::size_t i = 0; i < count; ++i) forward(i), backward(i, dL_dbones, plain_gradient.center[0]);
    if constexpr (D::value == Deformation::dual_quaternion)
        for (std::size_t j = 0; j < Puppet::J; ++j)
            detail::BonesAsDualQuatsBackward<double>{affine, bones, dL_dbones, plain_gradient.bones}(j);
    else
        plain_gradient.bones = dL_dbones;

    const auto close = [](auto& a, auto& b) {
        const auto left = test::scalars(a), right = test::scalars(b);
        double largest = 0;
        for (std::size_t k = 0; k < left.size(); ++k)
            largest = std::max(largest, std::abs(left[k] - right[k]) / (1 + std::abs(left[k])));
        return largest < 1e-12;
    };
    CHECK(close(wide.means, plain.means));
    CHECK(close(wide.covariances, plain.covariances));
    CHECK(close(wide.opacities, plain.opacities));
    CHECK(close(wide.colors, plain.colors));
    CHECK(close(wide_gradient.means, plain_gradient.means));
    CHECK(close(wide_gradient.quats, plain_gradient.quats));
    CHECK(close(wide_gradient.log_scales, plain_gradient.log_scales));
    CHECK(close(wide_gradient.logits, plain_gradient.logits));
    CHECK(close(wide_gradient.sh, plain_gradient.sh));
    CHECK(close(wide_gradient.ao, plain_gradient.ao));
    CHECK(close(wide_gradient.bones, plain_gradient.bones));
    CHECK(close(wide_gradient.center, plain_gradient.center));
}

TEST_CASE("where all bones move alike, all deformations agree") {
    Puppet puppet(20, 30);
    for (auto& bone : puppet.scene.bones) bone = puppet.scene.bones[3];
    cpu::Serial backend;
    const auto pose = [&](Deformation deformation) {
        const SkinnedDegree2<double> skin(backend, {.deformation = deformation});
        SkinnedDegree2<double>::Cache cache;
        SplatArrays<double> splats(20);
        skin.forward(puppet.scene.input(), puppet.scene.bones, puppet.scene.center[0], splats.view(), cache);
        return splats;
    };
    const auto linear = pose(Deformation::linear);
    for (const Deformation deformation : {Deformation::polar, Deformation::dual_quaternion}) {
        const auto other = pose(deformation);
        for (std::size_t i = 0; i < 20; ++i) {
            CHECK(length(linear.means[i] - other.means[i]) < 1e-13);
            CHECK(length(linear.colors[i] - other.colors[i]) < 1e-13);
            CHECK(std::abs(linear.covariances[i].xy - other.covariances[i].xy) < 1e-12);
            CHECK(std::abs(linear.covariances[i].zz - other.covariances[i].zz) < 1e-12);
        }
    }
}

TEST_CASE("a twist flattens linear blends by the cosine of half of it, and no other") {
    const Affine<double> still;
    for (const double degrees : {60.0, 150.0, 179.0}) {
        const double angle = degrees * pi / 180;
        const Affine<double> twisted{rotation_from_axis_angle(vec3<double>(0, angle, 0)), vec3<double>(0)};
        Ball ball;
        const auto linear = ball.pose(still, twisted, 0.5, Deformation::linear);
        const auto polar = ball.pose(still, twisted, 0.5, Deformation::polar);
        const auto dual = ball.pose(still, twisted, 0.5, Deformation::dual_quaternion);
        const double shrunk = std::cos(angle / 2);
        CHECK(half_axes(linear.covariances[0]).x == doctest::Approx(0.01 * shrunk));
        CHECK(half_axes(linear.covariances[0]).z == doctest::Approx(0.01));
        CHECK(length(linear.means[0]) == doctest::Approx(0.1 * shrunk)); // the candy-wrapper artefact
        CHECK(half_axes(polar.covariances[0]).x == doctest::Approx(0.01));
        CHECK(length(polar.means[0] - linear.means[0]) < 1e-15);
        CHECK(half_axes(dual.covariances[0]).x == doctest::Approx(0.01));
        CHECK(length(dual.means[0]) == doctest::Approx(0.1));
        CHECK(length(polar.colors[0] - dual.colors[0]) < 0.05);
    }
}

TEST_CASE("a blend of dual quaternions takes the shorter way round, whatever signs the bones come with") {
    // Opposite turns of 170 degrees have quaternions with opposite real parts. Their blend is half a turn.
    const double angle = 170 * pi / 180;
    const Affine<double> left{rotation_from_axis_angle(vec3<double>(0, angle, 0)), vec3<double>(0)};
    const Affine<double> right{rotation_from_axis_angle(vec3<double>(0, -angle, 0)), vec3<double>(0)};
    Ball ball;
    CHECK(ball.pose(left, right, 0.5, Deformation::dual_quaternion).means[0].x == doctest::Approx(-0.1));
    CHECK(ball.pose(right, left, 0.4, Deformation::dual_quaternion).means[0].x < -0.09);
}

TEST_CASE_TEMPLATE("opposed bones and a camera at the Gaussian give finite numbers", T, float, double) {
    for (const Deformation deformation : deformations) {
        test::SkinnedScene<T> scene(9, 9, 9, 31), gradient = scene;
        const auto turn = [](double angle) { return mat3<T>(rotation_from_axis_angle(vec3<double>(0, angle, 0))); };
        for (std::size_t j = 0; j < scene.bones.size(); ++j)
            scene.bones[j] = {j % 2 ? turn(0) : turn(pi), vec3<T>(T(j), 0, 0)};
        for (auto& weight : scene.weights) weight = weight > 0 ? T(0.5) : T(0);
        cpu::Serial backend;
        SplatArrays<T> splats(9);
        const SplatArrays<T> dL_dsplats(9, 32);
        const SkinnedDegree2<T> skin(backend, {.deformation = deformation});
        typename SkinnedDegree2<T>::Cache cache;
        skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
        scene.center[0] = splats.means[1];
        gradient.clear();
        skin.forward(scene.input(), scene.bones, scene.center[0], splats.view(), cache);
        skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, gradient.view(),
                      gradient.bones, gradient.center);
        const auto finite = [](const auto& values) {
            using Number = std::remove_cvref_t<decltype(values[0])>;
            for (const auto& value : values)
                for (std::size_t k = 0; k < sizeof(Number) / sizeof(T); ++k)
                    if (!std::isfinite(reinterpret_cast<const T*>(&value)[k])) return false;
            return true;
        };
        CHECK(finite(splats.means));
        CHECK(finite(splats.covariances));
        CHECK(finite(splats.colors));
        CHECK(finite(gradient.means));
        CHECK(finite(gradient.quats));
        CHECK(finite(gradient.bones));
        CHECK(finite(gradient.center));
    }
}

TEST_CASE("a bone gradient that nobody asks for is not computed, the others stay") {
    const Puppet puppet(11, 33);
    const auto& scene = puppet.scene;
    cpu::Serial backend;
    const SplatArrays<double> dL_dsplats(11, 34);
    for (const Deformation deformation : deformations) {
        const SkinnedDegree2<double> skin(backend, {.deformation = deformation});
        SkinnedDegree2<double>::Cache cache;
        auto all = scene, some = scene;
        all.clear(), some.clear();
        skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache, all.view(), all.bones,
                      all.center);
        skin.backward(scene.input(), scene.bones, scene.center[0], dL_dsplats.view(), cache,
                      SkinnedView<double>{.means = some.means});
        CHECK(some.means == all.means);
    }
}

} // namespace
} // namespace gsh
