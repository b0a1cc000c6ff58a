// SPDX-License-Identifier: Apache-2.0
/// @file  What the kernels of the hash grid read beside its table: features as rows, and the weights of levels.
#pragma once

#include <gsh/backend/cuda/divisor.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/cuda/row.cuh>
#include <gsh/field/features.hpp>
#include <gsh/field/hash_level.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string_view>

namespace gsh::cuda::detail {

/// Features of a grid as rows: row (l, i) is level l's part of point i. Numbers of rows have 32 bits.
template <class R>
struct HashRows {
    Span<R> rows;
    std::uint32_t points;
    Divisor levels; ///< of a group of columns

    HashRows(std::string_view where, Span<R> all, std::size_t point_count, std::size_t levels_of_group)
        : rows(all), points(static_cast<std::uint32_t>(point_count)),
          levels(static_cast<std::uint32_t>(levels_of_group)) {
        check_value(all.size() <= std::numeric_limits<std::uint32_t>::max(), where,
                    "too many points; the CUDA backend counts points times levels in 32 bits");
    }
    template <class T, std::size_t F>
    static HashRows of(std::string_view where, const FeatureView<T>& view) {
        return HashRows(where, as_rows<F>(where, view.values), view.rows, view.block / F);
    }
    /// Index of the first point's row; the next follow at distance stride(). As FeatureView::column.
    [[nodiscard]] __device__ std::uint32_t begin(unsigned level) const {
        const unsigned group = levels.quotient(level);
        return group * stride() * points + levels.remainder(level, group);
    }
    [[nodiscard]] __device__ std::uint32_t stride() const { return levels.number; }
};

/// LevelWeights without padding. A recorded step compares the bytes of its kernels with those of the step before.
template <class T>
struct HashWeights {
    std::size_t split;
    Span<const T> coarse, fine;

    explicit HashWeights(const LevelWeights<T>& w)
        : split(static_cast<std::size_t>(w.split)), coarse(w.coarse), fine(w.fine) {}
    [[nodiscard]] __device__ T operator()(unsigned level, std::size_t i) const {
        const Span<const T> weights = level < split ? coarse : fine;
        return weights.empty() ? T(1) : weights[i];
    }
};

} // namespace gsh::cuda::detail
