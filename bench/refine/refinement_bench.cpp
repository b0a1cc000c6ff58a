// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/optim/cpu/adam.hpp>
#include <gsh/refine/refinement.hpp>

#include <benchmark/benchmark.h>

#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t joints = 55, frames = 300, expressions = 10, shapes = 10;

RigData rig() {
    RigData data;
    data.betas.assign(shapes, 0);
    data.joints.assign(joints, vec3<double>(0.0));
    data.body.parents.assign(joints, 0);
    data.body.parents[0] = -1;
    data.body.shape_count = static_cast<int>(shapes), data.body.expression_count = static_cast<int>(expressions);
    return data;
}

Motion motion() {
    Motion m;
    Rng rng(1);
    m.joint_count = joints, m.expression_count = expressions;
    m.betas.assign(shapes, 0);
    for (std::size_t t = 0; t < frames; ++t) {
        for (std::size_t j = 0; j < joints; ++j) m.pose.push_back({rng.uniform(), rng.uniform(), rng.uniform()});
        m.expression.insert(m.expression.end(), expressions, 0);
        m.transl.push_back(vec3<double>(0.0));
        m.timestamps.push_back(static_cast<double>(t));
    }
    return m;
}

/// The work of refinement in a training step: the pose of a frame, its adjoint, the regularisation terms, and Adam.
void step(benchmark::State& state) {
    cpu::Serial backend;
    RefinementParams config = test_time_params();
    if (state.range(0)) config.pose.terms = {.pull = 1e-3, .drift = 1e-3, .acceleration = 1e-3};
    MotionRefinement<cpu::Serial> refinement(backend, rig(), motion(), {}, config);
    RigPose<cpu::Serial> pose;
    std::size_t t = 0;
    for (auto _ : state) {
        const std::size_t frame = t++ % frames;
        refinement.pose(frame, pose);
        const auto gradient = refinement.pose_gradient();
        for (auto& g : gradient.pose) g = vec3<float>(0.1f);
        refinement.accumulate(frame, gradient);
        refinement.step();
    }
}
BENCHMARK(step)->ArgName("acceleration")->Arg(0)->Arg(1)->Unit(benchmark::kMicrosecond);

} // namespace
