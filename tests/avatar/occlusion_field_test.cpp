// SPDX-License-Identifier: Apache-2.0
#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/occlusion_field.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>

#include "support/bodies.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t J = 4, P = 9 * (J - 1);
const std::vector<int> parents{-1, 0, 1, 1};

/// A trained network, the encoding of each Gaussian, and a pose.
struct Trained {
    Mlp mlp;
    std::size_t encoded;
    std::vector<float> weights, features;
    std::vector<mat3<double>> rotations;

    explicit Trained(std::size_t count, int hidden_layers = 2, int width = 13, std::size_t encoding = 6)
        : mlp({.inputs = static_cast<int>(encoding + P), .outputs = 1, .width = width, .hidden_layers = hidden_layers}),
          encoded(encoding), weights(mlp.initial_weights<float>(3)) {
        test::Rng rng(4);
        for (const double value : rng.numbers(count * encoding)) features.push_back(static_cast<float>(value));
        for (const auto& angle : rng.vecs(J, -0.8, 0.8)) rotations.push_back(rotation_from_axis_angle(angle));
    }
    template <class B>
    OcclusionFieldData bake(B& backend) const {
        return bake_occlusion_field(
            backend, mlp, Span<const float>(weights),
            FeatureView<const float>(Span<const float>(features), features.size() / encoded, encoded, encoded), 1.2,
            1.5);
    }
    template <class T>
    std::vector<mat3<T>> rotations_as() const {
        std::vector<mat3<T>> cast;
        for (const auto& R : rotations) cast.push_back(mat3<T>(R));
        return cast;
    }
};

template <class T, class B>
std::vector<T> field_ao(B& backend, const OcclusionFieldData& data, const Trained& trained) {
    const Skeleton<B, T> skeleton(backend, parents);
    const std::size_t count = trained.features.size() / trained.encoded;
    const OcclusionField<B, T> field(backend, data, count, J);
    const auto rotations = trained.rotations_as<T>();
    std::vector<T> ao(count);
    typename OcclusionField<B, T>::Cache cache;
    field.forward(skeleton, Span<const mat3<T>>(rotations), Span<T>(ao), cache);
    return ao;
}

OcclusionFieldData random_field(std::size_t points, std::size_t joints, std::uint64_t seed = 5) {
    OcclusionFieldData data{.width = 8, .hidden_layers = 2, .bias = 0.7, .largest = 1.3};
    test::Rng rng(seed);
    const auto fill = [&](std::vector<float>& values, std::size_t count) {
        for (const double value : rng.numbers(count)) values.push_back(static_cast<float>(value));
    };
    fill(data.neurons, points * 8);
    fill(data.pose_weights, 8 * 9 * (joints - 1));
    fill(data.weights, data.network().parameter_count());
    return data;
}

} // namespace

TEST_CASE("a baked field is the trained network bit for bit") {
    for (const int hidden_layers : {1, 2, 3})
        for (const std::size_t count : {std::size_t(1), std::size_t(65), std::size_t(1000)}) {
            CAPTURE(hidden_layers);
            CAPTURE(count);
            const Trained trained(count, hidden_layers, count == 65 ? 64 : 13);
            cpu::Serial backend;
            const auto rotations = trained.rotations_as<float>();
            std::vector<float> feature(P), expected(count);
            const Skeleton<cpu::Serial, float> skeleton(backend, parents);
            skeleton.feature(Span<const mat3<float>>(rotations), Span<float>(feature));
            Mlp::Cache<cpu::Serial, float> cache;
            const FeatureView<const float> features(Span<const float>(trained.features), count, 6, 6);
            trained.mlp.forward(backend, Span<const float>(trained.weights), MlpInputs<float>{features, {}, feature},
                                Span<float>(expected), cache);
            for (float& value : expected) value = 1.5f * sigmoid(value + 1.2f);
            CHECK(field_ao<float>(backend, trained.bake(backend), trained) == expected);
        }
}

TEST_CASE("a field's adjoint is its gradient, and adds") {
    const Trained trained(70);
    cpu::Serial backend;
    const OcclusionFieldData data = trained.bake(backend);
    const OcclusionField<cpu::Serial, double> field(backend, data, 70, J);
    const Skeleton<cpu::Serial, double> skeleton(backend, parents);
    auto rotations = trained.rotations;
    test::Rng rng(6);
    const std::vector<double> dL_dao = rng.numbers(70);
    std::vector<double> ao(70);
    OcclusionField<cpu::Serial, double>::Cache cache;
    const auto loss = [&] {
        field.forward(skeleton, Span<const mat3<double>>(rotations), Span<double>(ao), cache);
        double sum = 0;
        for (std::size_t i = 0; i < ao.size(); ++i) sum += ao[i] * dL_dao[i];
        return sum;
    };
    loss();
    std::vector<mat3<double>> dL_drotations(J, mat3<double>(0.0));
    const auto backward = [&] {
        field.backward(skeleton, Span<const double>(ao), Span<const double>(dL_dao), cache,
                       Span<mat3<double>>(dL_drotations));
    };
    backward();
    const auto once = dL_drotations;
    test::check_gradient(loss, test::scalars(rotations), test::scalars(dL_drotations));
    CHECK(once[0] == mat3<double>(0.0)); // ao does not depend on the direction in which the body faces
    loss();
    backward();
    for (std::size_t j = 0; j < J; ++j)
        for (int c = 0; c < 3; ++c) CHECK(length(dL_drotations[j][c] - 2.0 * once[j][c]) < 1e-14);
}

TEST_CASE("threads shade as one thread does") {
    for (const std::size_t count : {0, 1, 63, 3000}) {
        CAPTURE(count);
        const Trained trained(count);
        cpu::Serial serial;
        const OcclusionFieldData data = trained.bake(serial);
        const auto run = [&]<class B>(B& backend) {
            const Skeleton<B, float> skeleton(backend, parents);
            const OcclusionField<B, float> field(backend, data, count, J);
            const auto rotations = trained.rotations_as<float>();
            std::vector<float> ao(count), dL_dao(count, 0.3f);
            std::vector<mat3<float>> gradient(J, mat3<float>(0.0f));
            typename OcclusionField<B, float>::Cache cache;
            field.forward(skeleton, Span<const mat3<float>>(rotations), Span<float>(ao), cache);
            field.backward(skeleton, Span<const float>(ao), Span<const float>(dL_dao), cache,
                           Span<mat3<float>>(gradient));
            return std::pair(ao, gradient);
        };
        const auto expected = run(serial);
        for (const std::size_t threads : {1, 2, 5}) {
            cpu::Threads backend(threads);
            const auto found = run(backend);
            CHECK(found.first == expected.first);
            CHECK(found.second == expected.second);
            CHECK(trained.bake(backend).neurons == data.neurons);
        }
    }
}

TEST_CASE("an avatar's shadows follow its pose, and its pose learns from them") {
    const BodyModel body = test::tube(4, 6, 6);
    const std::vector<double> betas{0.3, -0.1};
    const auto samples =
        sample_surface(body, shaped_vertices(body, betas), std::vector<double>(body.vertex_count(), 2.0), 3);
    AvatarData data{make_rig(body, betas, samples), GaussianCloud<float>(samples.size(), 1), ColorClamp::below};
    test::Rng rng(6);
    for (std::size_t i = 0; i < samples.size(); ++i) {
        data.gaussians.means[i] = vec3<float>(samples.positions[i]);
        data.gaussians.log_scales[i] = vec3<float>(rng.vec(-4, -3));
        data.gaussians.quats[i] = {1, 0.2f, 0.1f, -0.3f};
    }
    for (auto& value : data.gaussians.sh) value = vec3<float>(rng.vec(-0.2, 0.2));
    AvatarData plain = data;
    data.occlusion_field = random_field(samples.size(), 4);
    data.ao.assign(samples.size(), 0.5f); // the mean, which is not used if there is a field

    cpu::Serial backend;
    Avatar<cpu::Serial, double> avatar(backend, data), unshaded(backend, plain);
    Motion motion = rest_motion(data.rig);
    motion.pose = rng.vecs(4, -0.5, 0.5);
    RigPose<cpu::Serial, double> pose;
    avatar.rig().upload_pose(motion, 0, pose);
    Avatar<cpu::Serial, double>::Cache cache, other_cache;
    Splats<cpu::Serial, double> splats, other, weights;
    for (auto* all : {&splats, &other, &weights}) all->resize(avatar.size());
    const auto posed = [&](const auto& of, auto& where, auto& with) { of.pose(pose, {0, 0.8, 3}, where.view(), with); };
    posed(avatar, splats, cache);
    posed(unshaded, other, other_cache);
    for (std::size_t i = 0; i < avatar.size(); ++i) {
        CHECK(splats.means[i] == other.means[i]);
        CHECK(length(splats.colors[i] - other.colors[i] * cache.ao[i]) < 1e-14);
    }
    // ao stays the same when the whole body turns, and changes when it bends.
    const std::vector<double> before(cache.ao.begin(), cache.ao.end());
    const auto shadows = [&](std::size_t joint) {
        const vec3<double> kept = pose.pose[joint];
        pose.pose[joint] += vec3<double>(0.3, 0, 0);
        posed(avatar, splats, cache);
        pose.pose[joint] = kept;
        return std::vector<double>(cache.ao.begin(), cache.ao.end());
    };
    CHECK(shadows(0) == before);
    CHECK(shadows(2) != before);

    for (auto& v : weights.means) v = rng.vec();
    for (auto& v : weights.colors) v = rng.vec();
    fill_zero(backend, SplatView<double>{{}, weights.covariances, weights.opacities, {}});
    const auto loss = [&] {
        posed(avatar, splats, cache);
        double sum = 0;
        for (std::size_t i = 0; i < avatar.size(); ++i)
            sum += dot(splats.means[i], weights.means[i]) + dot(splats.colors[i], weights.colors[i]);
        return sum;
    };
    loss();
    std::vector<vec3<double>> dL_dpose(4, vec3<double>(0.0)), dL_dtransl(1, vec3<double>(0.0));
    avatar.backward_to_pose(pose, {0, 0.8, 3}, std::as_const(weights).view(), cache, {dL_dpose, {}, dL_dtransl});
    const auto numbers = [](auto& buffer) { return view_as<double>(Span<vec3<double>>(buffer)); };
    const auto once = dL_dpose;
    test::check_gradient(loss, numbers(pose.pose), test::scalars(dL_dpose));
    test::check_gradient(loss, numbers(pose.transl), test::scalars(dL_dtransl));
    loss();
    avatar.backward_to_pose(pose, {0, 0.8, 3}, std::as_const(weights).view(), cache, {dL_dpose, {}, {}});
    for (std::size_t j = 0; j < 4; ++j) CHECK(length(dL_dpose[j] - 2.0 * once[j]) < 1e-12);
}

TEST_CASE("a field that does not fit is refused by name") {
    const auto message = [](const OcclusionFieldData& data) {
        try {
            check_occlusion_field("here", data, 10, J);
        } catch (const Error& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    const auto changed = [](const auto& change) {
        OcclusionFieldData data = random_field(10, J);
        change(data);
        return data;
    };
    const auto names = [&](const char* word, const auto& change) {
        CAPTURE(word);
        CHECK(message(changed(change)) == test::contains(word));
    };
    CHECK(message(random_field(10, J)).empty());
    names("field's width is 0, expected 1 to 4096", [](auto& d) { d.width = 0; });
    names("field's width is 4097, expected 1 to 4096", [](auto& d) { d.width = 4097; });
    names("field's hidden_layers is 0, expected 1 to 64", [](auto& d) { d.hidden_layers = 0; });
    names("field's hidden_layers is 65, expected 1 to 64", [](auto& d) { d.hidden_layers = 65; });
    names("neurons", [](auto& d) { d.neurons.pop_back(); });
    names("pose_weights", [](auto& d) { d.pose_weights.push_back(0); });
    names("weights", [](auto& d) { d.weights.pop_back(); });
    names("weights", [](auto& d) { d.hidden_layers = 3; });
    names("neurons[7]", [](auto& d) { d.neurons[7] = std::numeric_limits<float>::quiet_NaN(); });
    names("bias", [](auto& d) { d.bias = std::numeric_limits<double>::infinity(); });
    names("largest", [](auto& d) { d.largest = 0; });

    cpu::Serial backend;
    const OcclusionFieldData data = random_field(10, J);
    CHECK_THROWS_AS((OcclusionField<cpu::Serial>(backend, data, 11, J)), ShapeError);
    const OcclusionField<cpu::Serial> field(backend, data, 10, J);
    const Skeleton<cpu::Serial> skeleton(backend, parents), shorter(backend, std::vector<int>{-1, 0});
    OcclusionField<cpu::Serial>::Cache cache;
    std::vector<mat3<float>> rotations(J, mat3<float>(1.0f));
    std::vector<float> ao(10), fewer(9);
    const Span<const mat3<float>> turned(rotations);
    CHECK_THROWS_AS(field.backward(skeleton, ao, ao, cache, Span<mat3<float>>(rotations)),
                    ShapeError); // backward without forward
    CHECK_THROWS_AS(field.forward(skeleton, turned, fewer, cache), ShapeError);
    CHECK_THROWS_AS(field.forward(shorter, turned.subspan(0, 2), ao, cache), ShapeError);
    field.forward(skeleton, turned, ao, cache);
    CHECK_THROWS_AS(field.backward(skeleton, ao, fewer, cache, Span<mat3<float>>(rotations)), ShapeError);

    const Trained trained(3), flat(3, 0);
    CHECK_THROWS_AS((void)flat.bake(backend), ValueError);
    CHECK_THROWS_AS((void)bake_occlusion_field(backend, trained.mlp, Span<const float>(trained.weights).subspan(1, 10),
                                               FeatureView<const float>(trained.features, 3, 6, 6), 0, 1),
                    ShapeError);
}
