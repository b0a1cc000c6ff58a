// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene's Gaussians as splats on the CPU, with one Gaussian in each lane of a vector register.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/prefetch.hpp>
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
        if (!out.sh.empty()) prefetch_rows(out.sh);
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            add_attributes<T>(gradient, lane, out, i);
            if (!element.dL_dcenters.empty()) get_lane<T>(gradient.center, lane, element.dL_dcenters[i]);
        }
        if (!out.sh.empty())
            add_rows<T>(dL_dsh, count, [&](std::size_t lane) -> Coefficients& {
                return reinterpret_cast<Coefficients&>(out.sh[index[lane] * Gaussian::basis_count]);
            });
        count = 0;
    }

private:
    using Coefficients = vec3<T>[Gaussian::basis_count];

    typename Gaussian::template Input<W> in_;
    vec3<W> sh_[Gaussian::basis_count];

    /// Asks for the coefficients of a block further on: without it, most of the time goes into waiting for them.
    template <class Rows>
    GSH_INLINE void prefetch_rows(const Rows& sh) const {
        constexpr std::size_t row = sizeof(Coefficients), ahead = 2 * width;
        const char* const from = reinterpret_cast<const char*>(sh.data()) + (index[0] + ahead) * row;
        for (std::size_t byte = 0; byte < width * row; byte += 64) prefetch(from + byte);
    }
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
        }
        put_rows<T>(sh_, [&](std::size_t lane) -> const Coefficients& {
            return reinterpret_cast<const Coefficients&>(from.sh[index[lane] * Gaussian::basis_count]);
        });
        prefetch_rows(from.sh);
    }
};

} // namespace detail

template <CpuBackend B, int Degree, class T>
void static_splats_forward(B& backend, const gsh::detail::StaticSplatForward<Degree, T>& element) {
    detail::for_blocks<detail::StaticBlock<Degree, T>>(backend, element.input.gaussians.size(), element);
}

template <CpuBackend B, int Degree, class T>
void static_splats_backward(B& backend, const gsh::detail::StaticSplatBackward<Degree, T>& element) {
    detail::for_dense_blocks<detail::StaticBlock<Degree, T>>(backend, element.input.gaussians.size(), element);
}

} // namespace gsh::cpu
