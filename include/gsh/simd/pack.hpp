// SPDX-License-Identifier: Apache-2.0
/// @file  SIMD packs of xsimd as lane types for per-element code.
///
/// Opt-in (needs xsimd); the umbrella header does not include it. Arithmetic, comparisons, select, min, max, abs, sqrt,
/// exp and floor are those of xsimd, found by argument-dependent lookup.
#pragma once

#include <gsh/core/lane.hpp>

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized" // the AVX-512 intrinsics of GCC 12 start from an undefined register
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <xsimd/xsimd.hpp>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

namespace gsh {

/// As many scalars as the target's widest register holds.
template <std::floating_point S>
using Pack = xsimd::batch<S>;

template <class S, class Arch>
struct LaneTraits<xsimd::batch<S, Arch>> {
    using Scalar = S;
    using Mask = xsimd::batch_bool<S, Arch>;
    using Index = xsimd::batch<xsimd::as_unsigned_integer_t<S>, Arch>; ///< one index per lane, as wide as S
    static constexpr std::size_t width = xsimd::batch<S, Arch>::size;

    [[nodiscard]] static Index to_index(xsimd::batch<S, Arch> x) {
        return per_lane<typename Index::value_type>(x, [](S v) { return v; });
    }
    [[nodiscard]] static xsimd::batch<S, Arch> from_index(Index i) {
        return per_lane<S>(i, [](auto v) { return v; });
    }
    [[nodiscard]] static xsimd::batch<S, Arch> gather(const S* table, Index index) {
        return per_lane<S>(index, [table](auto i) { return table[i]; });
    }

private:
    /// Applies f to each lane through memory: exact, and as fast as the scalar loads that it replaces.
    template <class To, class From, class F>
    static xsimd::batch<To, Arch> per_lane(const xsimd::batch<From, Arch>& lanes, F f) {
        alignas(Arch::alignment()) From in[width];
        alignas(Arch::alignment()) To out[width];
        lanes.store_aligned(in);
        for (std::size_t i = 0; i < width; ++i) out[i] = static_cast<To>(f(in[i]));
        return xsimd::batch<To, Arch>::load_aligned(out);
    }
};

} // namespace gsh
