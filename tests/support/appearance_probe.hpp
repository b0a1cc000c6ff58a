// SPDX-License-Identifier: Apache-2.0
/// @file  A scalar of an appearance's colours and displacements, and its adjoint, for the tests of all appearances.
#pragma once

#include <gsh/cpu.hpp>
#include <gsh/model/appearance.hpp>
#include <gsh/model/canonical_points.hpp>
#include <gsh/model/field_appearance.hpp>

#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

namespace gsh::test {

/// Random points with two features each. About half of them have a share in the region.
template <class B>
SharedPoints<B, double> scattered_points(B& backend, std::size_t count = 23) {
    Rng rng(4);
    const auto positions = rng.vecs(count);
    CanonicalPriors priors{rng.numbers(count), rng.numbers(2 * count)};
    for (double& tau : priors.region) tau = std::max(tau, 0.0);
    return std::make_shared<const CanonicalPoints<B, double>>(backend, Span<const vec3<double>>(positions), priors);
}

inline FieldParams small_field() {
    return {.grid = {.base = 3, .growth = 1.6, .table_size = 128}, .width = 8, .hidden_layers = 1};
}
inline AppearanceParams small_appearance(std::size_t time_frames = 0) {
    return {.field = small_field(), .fine_level = 1, .sh_dc_scale = 2, .time_frames = time_frames, .seed = 5};
}

/// loss = sum of colours and displacements, each weighted at random.
template <class A>
class AppearanceProbe {
public:
    AppearanceProbe(A& appearance, std::size_t count, std::size_t frame)
        : appearance_(&appearance), frame_(frame), sh_(rng_.vecs(count * basis)), displacements_(rng_.vecs(count)) {}

    /// Colours, then displacements, of a forward pass.
    std::vector<double> outputs() {
        appearance_->forward(frame_);
        return kept();
    }
    /// Those of the last forward pass.
    std::vector<double> kept() const {
        const AppearanceView<double> view = appearance_->view();
        std::vector<double> all;
        const auto add = [&](const vec3<double>& v) { all.insert(all.end(), {v.x, v.y, v.z}); };
        for (std::size_t i = 0; i < displacements_.size(); ++i)
            for (std::size_t k = 0; k < basis; ++k) add(view.sh[i * view.sh_stride + k]);
        for (std::size_t i = 0; i < displacements_.size(); ++i) add(view.displacements[i * view.displacement_stride]);
        return all;
    }
    double loss() {
        const std::vector<double> values = outputs();
        const Span<const double> sh = scalars(sh_), displacements = scalars(displacements_);
        double sum = 0;
        for (std::size_t i = 0; i < sh.size(); ++i) sum += sh[i] * values[i];
        for (std::size_t i = 0; i < displacements.size(); ++i) sum += displacements[i] * values[sh.size() + i];
        return sum;
    }
    void backward() {
        appearance_->forward(frame_);
        const ColorGradient<double> dL_dcolors = appearance_->color_gradient();
        for (std::size_t i = 0; i < displacements_.size(); ++i)
            for (std::size_t k = 0; k < basis; ++k) dL_dcolors.sh[i * dL_dcolors.sh_stride + k] += sh_[i * basis + k];
        std::vector<vec3<double>> dL_dmeans = displacements_;
        appearance_->backward(frame_, dL_dmeans);
    }

private:
    static constexpr std::size_t basis = sh_basis_count(A::sh_degree);

    Rng rng_{6};
    A* appearance_;
    std::size_t frame_;
    std::vector<vec3<double>> sh_, displacements_; // [N, basis], [N]
};

/// Checks an appearance's adjoint against central differences, that it adds, that released memory changes nothing, and
/// that both passes on threads are bit-identical. Policy<B> is the appearance on backend B, made of (backend, points, params).
template <template <class> class Policy>
void check_appearance(const AppearanceParams& params, std::size_t frame = 0) {
    cpu::Serial serial;
    const auto points = scattered_points(serial);
    Policy<cpu::Serial> appearance(serial, points, params);
    randomize(appearance);
    AppearanceProbe probe(appearance, points->size(), frame);
    probe.backward();
    check_learned_gradients(appearance, [&] { return probe.loss(); });
    const auto once = learned_gradients(appearance), outputs = probe.outputs();
    probe.backward();
    check_doubled(once, learned_gradients(appearance));

    appearance.release_memory();
    CHECK(probe.kept() == outputs);
    Policy<cpu::Serial> again(serial, points, params);
    randomize(again);
    AppearanceProbe probe_again(again, points->size(), frame);
    probe_again.outputs();
    again.release_memory();
    probe_again.backward();
    CHECK(learned_gradients(again) == once);

    for (const std::size_t count : {1, 3}) {
        cpu::Threads threads(count);
        const auto points_there = scattered_points(threads);
        Policy<cpu::Threads> threaded(threads, points_there, params);
        randomize(threaded);
        AppearanceProbe probe_there(threaded, points->size(), frame);
        probe_there.backward();
        CHECK(probe_there.outputs() == outputs);
        CHECK(learned_gradients(threaded) == once);
    }
}

} // namespace gsh::test
