// SPDX-License-Identifier: Apache-2.0
/// @file  A small body in a pose for occlusion policies, and a scalar of their ambient occlusion with its adjoint.
#pragma once

#include <gsh/avatar/rig.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/cpu.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/field_occlusion.hpp>
#include <gsh/model/occlusion.hpp>

#include "support/bodies.hpp"
#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <cstddef>
#include <utility>
#include <vector>

namespace gsh::test {

/// A tube's rig, its points, and one pose.
template <class B>
struct OcclusionScene {
    static constexpr std::size_t frames = 5;

    B backend;
    BodyModel body = tube(4, 6, 6);
    SurfaceSamples samples = sample_surface(body, body.v_template, std::vector<double>(body.vertex_count(), 0.6), 3);
    RigData data = make_rig(body, std::vector<double>(2, 0.0), samples);
    Rig<B, double> rig;
    CanonicalPoints<B, double> points;
    RigPose<B, double> pose;
    typename Rig<B, double>::Cache cache;
    std::vector<double> weights; // dL_dao

    explicit OcclusionScene(B where = B())
        : backend(std::move(where)), rig(backend, data), points(backend, samples.positions) {
        Rng rng(7);
        Motion motion = rest_motion(data);
        motion.pose = rng.vecs(4, -0.6, 0.6);
        rig.upload_pose(motion, 0, pose);
        weights = rng.numbers(samples.size());
    }
    [[nodiscard]] std::size_t size() const { return samples.size(); }
    [[nodiscard]] std::size_t pose_feature_count() const { return data.body.pose_feature_count(); }
    static FieldOcclusionParams params() {
        return {.grid = {.base = 3, .growth = 1.6, .table_size = 64},
                .width = 8,
                .hidden_layers = 1,
                .largest = 1.7,
                .initial = 0.9,
                .seed = 5};
    }

    OcclusionInput<B, double> input(std::size_t frame = 2) {
        rig.forward(pose, data.joints, cache);
        return {frame, rig.skeleton(), pose.pose, cache.rotations};
    }
    std::vector<double> ao_of(auto& occlusion, std::size_t frame = 2) {
        std::vector<double> ao(size());
        occlusion.forward(input(frame), ao);
        return ao;
    }
    double loss(auto& occlusion) {
        const std::vector<double> ao = ao_of(occlusion);
        double sum = 0;
        for (std::size_t i = 0; i < ao.size(); ++i) sum += weights[i] * ao[i];
        return sum;
    }
    void backward(auto& occlusion, Span<vec3<double>> dL_dpose) {
        const std::vector<double> ao = ao_of(occlusion);
        std::vector<double> dL_dao = weights; // is overwritten
        occlusion.backward(input(), ao, dL_dao, dL_dpose);
    }
    void backward_to_pose(auto& occlusion, Span<vec3<double>> dL_dpose) {
        const std::vector<double> ao = ao_of(occlusion);
        std::vector<double> dL_dao = weights;
        occlusion.backward_to_pose(input(), ao, dL_dao, dL_dpose);
    }
};

} // namespace gsh::test
