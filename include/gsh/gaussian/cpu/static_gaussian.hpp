// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene's Gaussians as splats on the CPU, with one Gaussian in each lane of a vector register.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/gaussian/cpu/gaussian_lanes.hpp>
#include <gsh/gaussian/splats.hpp>
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
    using WideBlock<T>::count, WideBlock<T>::index, WideBlock<T>::width;
    using Gaussian = StaticGaussian<Degree>;

    void forward(const StaticSplatForward<Degree, T>& element) {
        if (!this->fill()) return;
        read(element.input);
        if (element.splats.is_factored())
            write(Gaussian::forward_factored(in_, element.clamping), element.splats);
        else
            write(Gaussian::forward(in_, element.clamping), element.splats);
        count = 0;
    }

    void backward(const StaticSplatBackward<Degree, T>& element) {
        if (!this->fill()) return;
        read(element.input);
        typename Gaussian::template Gradient<W> gradient;
        vec3<W> dL_dsh[Gaussian::basis_count];
        for (vec3<W>& value : dL_dsh) value = vec3<W>(W(T(0)));
        gradient.sh = dL_dsh;
        if (element.dL_dsplats.is_factored())
            Gaussian::backward(in_, element.clamping, read<FactoredSplat<W>>(element.dL_dsplats), gradient);
        else
            Gaussian::backward(in_, element.clamping, read<Splat<W>>(element.dL_dsplats), gradient);

        const auto& out = element.dL_dgaussians;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            add_attributes<T>(gradient, lane, out, i);
            for (std::size_t k = 0; k < Gaussian::basis_count && !out.sh.empty(); ++k)
                add_lane<T>(dL_dsh[k], lane, out.sh[i * Gaussian::basis_count + k]);
            if (!element.dL_dcenters.empty()) get_lane<T>(gradient.center, lane, element.dL_dcenters[i]);
        }
        count = 0;
    }

private:
    typename Gaussian::template Input<W> in_;
    vec3<W> sh_[Gaussian::basis_count];

    template <class Out>
    GSH_INLINE void write(const Out& out, const SplatView<T>& to) const {
        for (std::size_t lane = 0; lane < count; ++lane) get_splat<T>(out, lane, to, index[lane]);
    }
    template <class Out>
    [[nodiscard]] GSH_INLINE Out read(const SplatView<const T>& from) const {
        Out out;
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>)
            put_splats<T>(out, lane, index + lane, from);
        return out;
    }
    void read(const StaticInput<Degree, T>& input) {
        const auto& from = input.gaussians;
        const vec3<T> center = input.center();
        in_.center = vec3<W>(W(center.x), W(center.y), W(center.z));
        in_.sh = sh_;
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>) {
            const std::size_t* i = index + lane;
            put_attributes<T>(in_, lane, i, from);
            put_lanes<T>(sh_, lane, [&](std::size_t j) -> const vec3<T>(&)[Gaussian::basis_count] {
                return reinterpret_cast<const vec3<T>(&)[Gaussian::basis_count]>(from.sh[i[j] * Gaussian::basis_count]);
            });
        }
    }
};

} // namespace detail

template <CpuBackend B, int Degree, class T>
void static_splats_forward(B& backend, const gsh::detail::StaticSplatForward<Degree, T>& element) {
    detail::for_blocks<detail::StaticBlock<Degree, T>>(backend, element.input.gaussians.size(), element);
}

template <CpuBackend B, int Degree, class T>
void static_splats_backward(B& backend, const gsh::detail::StaticSplatBackward<Degree, T>& element) {
    detail::for_blocks<detail::StaticBlock<Degree, T>>(backend, element.input.gaussians.size(), element,
                                                       [&](std::size_t i) { return element.skip(i); });
}

} // namespace gsh::cpu
