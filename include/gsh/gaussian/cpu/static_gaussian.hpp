// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene's Gaussians as splats on the CPU, with one Gaussian in each lane of a vector register.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_block.hpp>

#include <cstddef>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::StaticInput;
using gsh::detail::StaticSplatBackward;
using gsh::detail::StaticSplatForward;

template <int Degree, class T>
struct StaticBlock : WideBlock<T> {
    using typename WideBlock<T>::W;
    using WideBlock<T>::count, WideBlock<T>::index;
    using Gaussian = StaticGaussian<Degree>;

    void forward(const StaticSplatForward<Degree, T>& element) {
        if (!this->fill()) return;
        read(element.input);
        const auto out = Gaussian::forward(in_, element.clamping);
        const auto& splats = element.splats;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            get_lane<T>(out.mean, lane, splats.means[i]);
            get_lane<T>(out.covariance, lane, splats.covariances[i]);
            get_lane<T>(out.opacity, lane, splats.opacities[i]);
            get_lane<T>(out.color, lane, splats.colors[i]);
        }
        count = 0;
    }

    void backward(const StaticSplatBackward<Degree, T>& element) {
        if (!this->fill()) return;
        read(element.input);
        const auto& splats = element.dL_dsplats;
        typename Gaussian::template Output<W> dL_dout;
        this->gather(dL_dout.mean, [&](std::size_t i) -> auto& { return splats.means[i]; });
        this->gather(dL_dout.covariance, [&](std::size_t i) -> auto& { return splats.covariances[i]; });
        this->gather(dL_dout.opacity, [&](std::size_t i) -> auto& { return splats.opacities[i]; });
        this->gather(dL_dout.color, [&](std::size_t i) -> auto& { return splats.colors[i]; });
        typename Gaussian::template Gradient<W> gradient;
        vec3<W> dL_dsh[Gaussian::basis_count];
        for (vec3<W>& value : dL_dsh) value = vec3<W>(W(T(0)));
        gradient.sh = dL_dsh;
        Gaussian::backward(in_, element.clamping, dL_dout, gradient);

        const auto& out = element.dL_dgaussians;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            if (!out.means.empty()) add_lane<T>(gradient.mean, lane, out.means[i]);
            if (!out.quats.empty()) add_lane<T>(gradient.q, lane, out.quats[i]);
            if (!out.log_scales.empty()) add_lane<T>(gradient.log_scale, lane, out.log_scales[i]);
            if (!out.opacity_logits.empty()) add_lane<T>(gradient.opacity_logit, lane, out.opacity_logits[i]);
            for (std::size_t k = 0; k < Gaussian::basis_count && !out.sh.empty(); ++k)
                add_lane<T>(dL_dsh[k], lane, out.sh[i * Gaussian::basis_count + k]);
            if (!element.dL_dcenters.empty()) get_lane<T>(gradient.center, lane, element.dL_dcenters[i]);
        }
        count = 0;
    }

private:
    typename Gaussian::template Input<W> in_;
    vec3<W> sh_[Gaussian::basis_count];

    void read(const StaticInput<Degree, T>& input) {
        const auto& from = input.gaussians;
        const vec3<T> center = input.center();
        in_.center = vec3<W>(W(center.x), W(center.y), W(center.z));
        in_.sh = sh_;
        this->gather(in_.mean, [&](std::size_t i) -> auto& { return from.means[i]; });
        this->gather(in_.q, [&](std::size_t i) -> auto& { return from.quats[i]; });
        this->gather(in_.log_scale, [&](std::size_t i) -> auto& { return from.log_scales[i]; });
        this->gather(in_.opacity_logit, [&](std::size_t i) -> auto& { return from.opacity_logits[i]; });
        this->gather(sh_, [&](std::size_t i) -> const vec3<T>(&)[Gaussian::basis_count] {
            return reinterpret_cast<const vec3<T>(&)[Gaussian::basis_count]>(from.sh[i * Gaussian::basis_count]);
        });
    }
};

} // namespace detail

/// The result of a lane depends on its own Gaussian alone, so the grouping of Gaussians into blocks does not change any
/// result.
template <CpuBackend B, int Degree, class T>
void static_splats_forward(B& backend, const gsh::detail::StaticSplatForward<Degree, T>& element) {
    constexpr std::size_t grain = 1024;
    backend.for_chunks(element.input.gaussians.size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        detail::StaticBlock<Degree, T> block;
        for (std::size_t i = begin; i < end; ++i)
            if (block.push(i)) block.forward(mine);
        block.forward(mine);
    });
}

template <CpuBackend B, int Degree, class T>
void static_splats_backward(B& backend, const gsh::detail::StaticSplatBackward<Degree, T>& element) {
    constexpr std::size_t grain = 1024;
    backend.for_chunks(element.input.gaussians.size(), grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        const auto mine = element;
        detail::StaticBlock<Degree, T> block;
        for (std::size_t i = begin; i < end; ++i)
            if (!mine.skip(i) && block.push(i)) block.backward(mine);
        block.backward(mine);
    });
}

} // namespace gsh::cpu
