// SPDX-License-Identifier: Apache-2.0
/// @file  Posing on a GPU agrees with the reference backend, forward and backward.
#include <gsh/avatar/cuda/skinned_splats.cuh>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/math/rotation.hpp>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/plain_backend.hpp"
#include "support/skinned_scene.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

namespace gsh::skinned_splats_on_device {
namespace {

using cuda::Device;

/// What is not the same in every test.
struct Case {
    std::size_t count = 7, joints = 5, influences = 3, extra_stride = 0;
    Deformation deformation = Deformation::linear;
    bool ao = true, sh = true, bones = true, center = true;
    int passes = 1; ///< backward is called so often
};

template <class T>
struct Scene : test::SkinnedScene<T> {
    std::size_t joint_count, slots;
    test::SplatArrays<T> dL_dsplats;

    Scene(const Case& c, std::size_t basis)
        : test::SkinnedScene<T>(c.count, basis, basis + c.extra_stride, 5), joint_count(c.joints), slots(c.influences),
          dL_dsplats(c.count, 6) {
        test::Rng rng(3);
        this->joints.clear(), this->weights.clear(), this->bones.clear();
        for (std::size_t i = 0; i < c.count; ++i) {
            const std::size_t used = 1 + i % slots;
            T sum = 0;
            for (std::size_t k = 0; k < slots; ++k) {
                // Neighbours follow nearly the same bones, as on a body.
                this->joints.push_back(static_cast<std::uint16_t>((i / 40 + k * (1 + i % 2)) % joint_count));
                this->weights.push_back(k < used ? T(rng.uniform(0.2, 1)) : T(0));
                sum += this->weights.back();
            }
            const auto row = this->weights.end() - static_cast<std::ptrdiff_t>(slots);
            std::sort(row, this->weights.end(), std::greater<T>());
            for (auto w = row; w != this->weights.end(); ++w) *w /= sum;
            if (i % 5 == 3 || (i >= 64 && i < 128)) { // a few, and two whole warps, that no pixel sees
                dL_dsplats.means[i] = dL_dsplats.colors[i] = vec3<T>(T(0));
                dL_dsplats.covariances[i] = {}, dL_dsplats.opacities[i] = T(0);
            }
        }
        for (std::size_t j = 0; j < joint_count; ++j) {
            Affine<T> bone{mat3<T>(rotation_from_axis_angle(rng.vec(-0.8, 0.8))), vec3<T>(rng.vec())};
            if (c.deformation != Deformation::dual_quaternion)
                for (int k = 0; k < 3; ++k) bone.linear[k] += vec3<T>(rng.vec(-0.2, 0.2));
            this->bones.push_back(bone);
        }
        if (!c.ao) this->ao.clear();
    }
};

/// Numbers of the splats, then of all gradients.
template <class T>
struct Result {
    std::vector<T> splats, gaussians, sh, bones, center;
};

template <int Degree, class T, class B>
Result<T> run(B& backend, const Scene<T>& scene, const Case& c) {
    const auto bring = [&](const auto& host) { return uploaded(backend, host); };
    const auto means = bring(scene.means), log_scales = bring(scene.log_scales), sh = bring(scene.sh);
    const auto quats = bring(scene.quats);
    const auto logits = bring(scene.logits), ao = bring(scene.ao), weights = bring(scene.weights);
    const auto joints = bring(scene.joints);
    const auto bones = bring(scene.bones);
    const SkinnedView<const T> input{means,          quats, log_scales, logits, sh, ao, {joints, weights, scene.slots},
                                     scene.sh_stride};
    const SkinnedSplats<B, Degree, T> skin(backend, {.deformation = c.deformation});
    typename SkinnedSplats<B, Degree, T>::Cache cache;
    Splats<B, T> splats;
    splats.resize(c.count);
    skin.forward(input, bones, scene.center[0], splats.view(), cache);

    auto zero = scene;
    zero.clear();
    auto d_means = bring(zero.means), d_log_scales = bring(zero.log_scales), d_sh = bring(zero.sh);
    auto d_quats = bring(zero.quats);
    auto d_logits = bring(zero.logits), d_ao = bring(zero.ao);
    auto d_bones = bring(zero.bones);
    auto d_center = bring(zero.center);
    const auto g_means = bring(scene.dL_dsplats.means), g_colors = bring(scene.dL_dsplats.colors);
    const auto g_covariances = bring(scene.dL_dsplats.covariances);
    const auto g_opacities = bring(scene.dL_dsplats.opacities);
    for (int pass = 0; pass < c.passes; ++pass)
        skin.backward(input, bones, scene.center[0], {g_means, g_covariances, g_opacities, g_colors}, cache,
                      {d_means,
                       d_quats,
                       d_log_scales,
                       d_logits,
                       c.sh ? Span<vec3<T>>(d_sh) : Span<vec3<T>>(),
                       d_ao,
                       {},
                       scene.sh_stride},
                      c.bones ? Span<Affine<T>>(d_bones) : Span<Affine<T>>(),
                      c.center ? Span<vec3<T>>(d_center) : Span<vec3<T>>());

    Result<T> result;
    const auto append = [&](std::vector<T>& to, const auto& buffer) {
        const auto values = test::fetched(backend, buffer);
        const T* const first = reinterpret_cast<const T*>(values.data());
        to.insert(to.end(), first, first + values.size() * sizeof(values[0]) / sizeof(T));
    };
    append(result.splats, splats.means), append(result.splats, splats.covariances);
    append(result.splats, splats.opacities), append(result.splats, splats.colors);
    append(result.gaussians, d_means), append(result.gaussians, d_quats), append(result.gaussians, d_log_scales);
    append(result.gaussians, d_logits), append(result.gaussians, d_ao);
    append(result.sh, d_sh), append(result.bones, d_bones), append(result.center, d_center);
    return result;
}

template <class T, class U>
void check_near(const Result<T>& found, const Result<U>& expected, double tolerance) {
    const auto distance = [](const auto& a, const auto& b) {
        return test::relative_distance({a.begin(), a.end()}, {b.begin(), b.end()});
    };
    const std::size_t n = expected.splats.size() / 13; // means, covariances, opacities and colours
    CHECK(test::largest_distance(found.splats, expected.splats, {3 * n, 6 * n, n, 3 * n}) < tolerance);
    const std::size_t ao = expected.gaussians.size() - 11 * n; // n or none
    CHECK(test::largest_distance(found.gaussians, expected.gaussians, {3 * n, 4 * n, 3 * n, n, ao}) < tolerance);
    CHECK(distance(found.sh, expected.sh) < tolerance);
    CHECK(distance(found.bones, expected.bones) < tolerance);
    CHECK(distance(found.center, expected.center) < tolerance);
}

/// The GPU's numbers beside those of the host.
template <int Degree, class T>
void compare(const Case& c) {
    CAPTURE(c.count);
    CAPTURE(c.joints);
    const Scene<T> scene(c, sh_basis_count(Degree));
    Device device;
    const Result<T> found = run<Degree, T>(device, scene, c);
    test::with_references(
        [&](auto& backend) { check_near(found, run<Degree, T>(backend, scene, c), sizeof(T) == 8 ? 1e-10 : 1e-4); });
}

constexpr Deformation deformations[] = {Deformation::linear, Deformation::polar, Deformation::dual_quaternion};

TEST_CASE("posing agrees with the reference for every number of Gaussians and every deformation") {
    if (test::skip_without_device()) return;
    for (const std::size_t count : {0u, 1u, 31u, 32u, 33u, 128u, 129u, 300u})
        for (const Deformation deformation : deformations) {
            compare<2, double>({.count = count, .deformation = deformation});
            compare<2, float>({.count = count, .deformation = deformation});
        }
}

TEST_CASE("posing agrees for every degree, with coefficients in longer rows, and without ambient occlusion") {
    if (test::skip_without_device()) return;
    for (const std::size_t extra : {0u, 1u}) {
        const Case c{.count = 150, .extra_stride = extra, .ao = extra == 0};
        compare<0, double>(c);
        compare<3, double>(c);
        compare<3, float>(c);
        compare<4, double>(c);
    }
}

TEST_CASE("gradients of bones agree for one bone, for more than a word has bits, and for many influences") {
    if (test::skip_without_device()) return;
    for (const std::size_t joints : {1u, 63u, 64u, 65u, 130u})
        for (const std::size_t influences : {1u, 4u, 11u})
            compare<0, double>({.count = 290, .joints = joints, .influences = influences});
    compare<0, double>({.count = 290, .joints = 130, .influences = 11, .deformation = Deformation::dual_quaternion});
}

TEST_CASE("backward is the gradient of posing, for every deformation") {
    if (test::skip_without_device()) return;
    Device device;
    for (const Deformation deformation : deformations) {
        const Case c{.count = 34, .deformation = deformation};
        Case forward = c;
        forward.passes = 0;
        Scene<double> scene(c, 9);
        const Result<double> gradient = run<2, double>(device, scene, c);
        const auto& g = scene.dL_dsplats;
        std::vector<double> dL_dsplats;
        for (const auto& values : {test::numbers<double>(g.means), test::numbers<double>(g.covariances), g.opacities,
                                   test::numbers<double>(g.colors)})
            dL_dsplats.insert(dL_dsplats.end(), values.begin(), values.end());
        const auto loss = [&] { return test::inner(run<2, double>(device, scene, forward).splats, dL_dsplats); };
        std::size_t first = 0;
        const auto check_next = [&](Span<double> values) {
            const Span<const double> all(gradient.gaussians);
            test::check_gradient(loss, values, all.subspan(first, values.size()), {.stride = 5});
            first += values.size();
        };
        check_next(test::scalars(scene.means)), check_next(test::scalars(scene.quats));
        check_next(test::scalars(scene.log_scales)), check_next(scene.logits), check_next(scene.ao);
        CHECK(first == gradient.gaussians.size());
        test::check_gradient(loss, test::scalars(scene.sh), gradient.sh, {.stride = 13});
        if (deformation != Deformation::dual_quaternion) {
            test::check_gradient(loss, test::scalars(scene.bones), gradient.bones);
        } else { // a bone can only turn: linear part R becomes rotation(turn) R
            std::vector<vec3<double>> turns(c.joints, vec3<double>(0)), dL_dturns = turns;
            const auto kept = scene.bones;
            std::vector<std::size_t> translations;
            for (std::size_t j = 0; j < c.joints; ++j) {
                Affine<double> dL_dbone;
                std::copy_n(gradient.bones.begin() + static_cast<std::ptrdiff_t>(12 * j), 12,
                            test::scalars(dL_dbone).begin());
                rotation_from_axis_angle_backward(turns[j], dL_dbone.linear * transpose(kept[j].linear), dL_dturns[j]);
                for (std::size_t k = 9; k < 12; ++k) translations.push_back(12 * j + k);
            }
            const auto loss_of_turns = [&] {
                for (std::size_t j = 0; j < c.joints; ++j)
                    scene.bones[j].linear = rotation_from_axis_angle(turns[j]) * kept[j].linear;
                return loss();
            };
            test::check_gradient(loss_of_turns, test::scalars(turns), test::scalars(dL_dturns));
            scene.bones = kept;
            test::check_gradient(loss, test::scalars(scene.bones), gradient.bones, {.elements = translations});
        }
        test::check_gradient(loss, test::scalars(scene.center), gradient.center);
    }
}

TEST_CASE("backward adds, and leaves alone what nobody asks for") {
    if (test::skip_without_device()) return;
    const Case once{.count = 140}, twice{.count = 140, .passes = 2};
    const Scene<double> scene(once, 9);
    Device device;
    const auto one = run<2, double>(device, scene, once), two = run<2, double>(device, scene, twice);
    const auto doubled = [](std::vector<double> a) {
        for (double& x : a) x *= 2;
        return a;
    };
    CHECK(test::relative_distance(two.gaussians, doubled(one.gaussians)) < 1e-15);
    CHECK(test::relative_distance(two.sh, doubled(one.sh)) < 1e-15);
    CHECK(two.bones == doubled(one.bones));
    CHECK(two.center == doubled(one.center));
    const auto some = run<2, double>(device, scene, {.count = 140, .sh = false, .bones = false, .center = false});
    CHECK(some.gaussians == one.gaussians);
    for (const auto* values : {&some.sh, &some.bones, &some.center})
        CHECK(std::all_of(values->begin(), values->end(), [](double x) { return x == 0; }));
    const auto bones = run<2, double>(device, scene, {.count = 140, .sh = false, .center = false});
    CHECK(bones.bones == one.bones);
}

TEST_CASE("sums of bones are those of every block that has some, for more blocks than threads join them") {
    if (test::skip_without_device()) return;
    using Join = cuda::detail::JoinBones<double, Affine<double>>;
    const std::size_t blocks = 2 * Join::block_size + 77, J = 66, numbers = Join::numbers;
    test::Rng rng(9);
    std::vector<double> bones(blocks * J * numbers, std::nan("")); // what has no bit is never read
    std::vector<std::uint64_t> follow(2 * blocks, 0);
    std::vector<double> expected(J * numbers, 0);
    for (std::size_t b = 0; b < blocks; ++b)
        for (const std::size_t j : {std::size_t(0), b % 5, std::size_t(63), 64 + b % 2}) {
            if (follow[j / 64 * blocks + b] >> j % 64 & 1u) continue;
            follow[j / 64 * blocks + b] |= std::uint64_t(1) << j % 64;
            for (std::size_t n = 0; n < numbers; ++n)
                expected[j * numbers + n] += bones[(b * J + j) * numbers + n] = rng.uniform(-1, 1);
        }
    const auto center = rng.numbers(3 * blocks);
    Device device;
    const auto from = uploaded(device, bones), from_center = uploaded(device, center);
    const auto bits = uploaded(device, follow);
    auto to = uploaded(device, std::vector<Affine<double>>(J, Affine<double>::zero()));
    auto to_center = uploaded(device, std::vector<vec3<double>>(1, vec3<double>(0)));
    device.launch(J + 1, Join{from, bits, from_center, blocks, to, to_center});
    CHECK(test::relative_distance(test::numbers<double>(test::fetched(device, to)), expected) < 1e-14);
    double y = 0;
    for (std::size_t b = 0; b < blocks; ++b) y += center[blocks + b];
    CHECK(test::fetched(device, to_center)[0].y == doctest::Approx(y).epsilon(1e-12));
}

TEST_CASE("results have the same bits in any order of blocks and threads") {
    if (test::skip_without_device()) return;
    const Case c{.count = 400, .joints = 70};
    const Scene<float> scene(c, 9);
    test::in_every_order(
        [&] {
            Device device;
            return run<2, float>(device, scene, c);
        },
        [](const Result<float>& found, const Result<float>& expected) {
            CHECK(test::same_bits(found.splats, expected.splats));
            CHECK(test::same_bits(found.gaussians, expected.gaussians));
            CHECK(test::same_bits(found.sh, expected.sh));
            CHECK(test::same_bits(found.bones, expected.bones));
            CHECK(test::same_bits(found.center, expected.center));
        });
}

TEST_CASE("a step with the same sizes allocates nothing and waits for nothing") {
    if (test::skip_without_device()) return;
#if defined(GSH_CUDA_EMULATION)
    auto& emulation = test::CudaEmulation::instance();
    Device device;
    SkinnedSplatsScratch<Device, float> scratch;
    const Scene<float> scene({.count = 200}, 9);
    // The arrays are not the test's subject: backward alone, with empty gradients but for the bones.
    const auto means = uploaded(device, scene.means), log_scales = uploaded(device, scene.log_scales),
               sh = uploaded(device, scene.sh);
    const auto quats = uploaded(device, scene.quats);
    const auto logits = uploaded(device, scene.logits), weights = uploaded(device, scene.weights);
    const auto joints = uploaded(device, scene.joints);
    const auto bones = uploaded(device, scene.bones);
    Splats<Device, float> gradient;
    gradient.resize(200);
    fill_zero(device, gradient.view());
    auto dL_dbones = uploaded(device, scene.bones);
    const SkinnedSplats<Device, 2> skin(device);
    SkinnedSplats<Device, 2>::Cache cache;
    const auto step = [&] {
        skin.backward({means, quats, log_scales, logits, sh, {}, {joints, weights, scene.slots}}, bones,
                      scene.center[0], std::as_const(gradient).view(), cache, {}, dL_dbones);
    };
    step();
    const auto allocations = emulation.allocations, waits = emulation.waits;
    step();
    CHECK(emulation.allocations == allocations);
    CHECK(emulation.waits == waits);
#endif
}

} // namespace
} // namespace gsh::skinned_splats_on_device
