// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays of a few Gaussians, bones and splats, for tests of posing.
#pragma once

#include "support/gradient.hpp"

#include <gsh/avatar/skinned_splats.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::test {

/// All inputs of posing and their gradients. Bones have shear, unless they are replaced.
template <class T>
struct SkinnedScene {
    static constexpr std::size_t joint_count = 5, influences = 3;

    std::vector<vec3<T>> means, log_scales, sh;
    std::vector<quat<T>> quats;
    std::vector<T> logits, ao, weights;
    std::vector<std::uint16_t> joints;
    std::vector<Affine<T>> bones;
    std::vector<vec3<T>> center;
    std::size_t sh_stride;

    SkinnedScene(std::size_t count, std::size_t basis, std::size_t stride, std::uint64_t seed) : sh_stride(stride) {
        Rng rng(seed);
        const auto number = [&](double low, double high) { return static_cast<T>(rng.uniform(low, high)); };
        for (std::size_t i = 0; i < count; ++i) {
            means.push_back(vec3<T>(rng.vec())), log_scales.push_back(vec3<T>(rng.vec()));
            const auto q = rng.quat();
            quats.push_back({T(q.w), T(q.x), T(q.y), T(q.z)});
            logits.push_back(number(-2, 2)), ao.push_back(number(0.5, 1));
            T sum = 0;
            for (std::size_t k = 0; k < influences; ++k) {
                joints.push_back(static_cast<std::uint16_t>((i + 2 * k) % joint_count));
                weights.push_back(k < 1 + i % influences ? number(0.2, 1) : T(0));
                sum += weights.back();
            }
            for (std::size_t k = 0; k < influences; ++k) weights[i * influences + k] /= sum;
            for (std::size_t k = 0; k < stride; ++k) {
                // With small coefficients all colours are inside (0, 1), away from the clamp's kinks. Every
                // third Gaussian is far above 1 in one channel, where the gradient must vanish.
                vec3<T> value(rng.vec(-0.05, 0.05));
                if (k == 0 && i % 3 == 2) value.y = T(8);
                sh.push_back(k < basis ? value : vec3<T>(T(9)));
            }
        }
        for (std::size_t j = 0; j < joint_count; ++j) {
            Affine<T> bone{mat3<T>(T(1)), vec3<T>(rng.vec())};
            for (int c = 0; c < 3; ++c) bone.linear[c] += vec3<T>(rng.vec(-0.4, 0.4));
            bones.push_back(bone);
        }
        center.push_back(vec3<T>(rng.vec(4, 6)));
    }

    void clear() {
        for (auto* values : {&means, &log_scales, &sh, &center})
            std::fill(values->begin(), values->end(), vec3<T>(T(0)));
        std::fill(quats.begin(), quats.end(), quat<T>{0, 0, 0, 0});
        std::fill(logits.begin(), logits.end(), T(0));
        std::fill(ao.begin(), ao.end(), T(0));
        std::fill(bones.begin(), bones.end(), Affine<T>::zero());
    }
    SkinnedView<T> view() { return {means, quats, log_scales, logits, sh, ao, {}, sh_stride}; }
    SkinnedView<const T> input() const {
        return {means, quats, log_scales, logits, sh, ao, {joints, weights, influences}, sh_stride};
    }
};

template <class T>
struct SplatArrays {
    std::vector<vec3<T>> means, colors;
    std::vector<sym3<T>> covariances;
    std::vector<T> opacities;

    explicit SplatArrays(std::size_t count, std::uint64_t seed = 99)
        : means(count), colors(count), covariances(count), opacities(count) {
        Rng rng(seed);
        for (std::size_t i = 0; i < count; ++i) {
            means[i] = vec3<T>(rng.vec()), colors[i] = vec3<T>(rng.vec());
            const vec3<T> a(rng.vec()), b(rng.vec());
            covariances[i] = {a.x, a.y, a.z, b.x, b.y, b.z};
            opacities[i] = T(rng.uniform(-1, 1));
        }
    }
    SplatView<T> view() { return {means, covariances, opacities, colors}; }
    SplatView<const T> view() const { return {means, covariances, opacities, colors}; }
};

inline double inner(const SplatArrays<double>& a, const SplatArrays<double>& b) {
    double sum = 0;
    for (std::size_t i = 0; i < a.means.size(); ++i) {
        sum += dot(a.means[i], b.means[i]) + dot(a.colors[i], b.colors[i]) + a.opacities[i] * b.opacities[i];
        const auto &c = a.covariances[i], &d = b.covariances[i];
        sum += c.xx * d.xx + c.xy * d.xy + c.xz * d.xz + c.yy * d.yy + c.yz * d.yz + c.zz * d.zz;
    }
    return sum;
}

/// Compares the gradients of the Gaussians' attributes with central differences of `loss`, which reads `scene`.
template <class Loss>
void check_attribute_gradients(const Loss& loss, SkinnedScene<double>& scene, SkinnedScene<double>& gradient) {
    check_gradient(loss, scalars(scene.means), scalars(gradient.means));
    check_gradient(loss, scalars(scene.quats), scalars(gradient.quats));
    check_gradient(loss, scalars(scene.log_scales), scalars(gradient.log_scales));
    check_gradient(loss, scalars(scene.logits), scalars(gradient.logits));
    check_gradient(loss, scalars(scene.sh), scalars(gradient.sh));
    check_gradient(loss, scalars(scene.ao), scalars(gradient.ao));
}

} // namespace gsh::test
