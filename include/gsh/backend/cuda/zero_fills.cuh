// SPDX-License-Identifier: Apache-2.0
/// @file  Sets several arrays of the device to zero in one launch.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstring>
#include <type_traits>

namespace gsh::cuda::detail {

/// Arrays that become zero. A step zeroes the gradients of a part one after the other; as launches of their own they
/// would take a microsecond each.
struct ZeroFills {
    static constexpr std::size_t word = 4; // bytes that a thread stores at once
    static constexpr unsigned block_size = 256, words_of_block = 4 * block_size, most = 8;

    Span<unsigned char> arrays[most];
    unsigned first_block[most] = {};
    unsigned count = 0, blocks = 0;

    /// Whether `value` can be written as zero words.
    template <class T>
    [[nodiscard]] static bool is_zero(const T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        if constexpr (sizeof(T) % word != 0 || alignof(T) % word != 0) {
            return false;
        } else {
            const auto* const bytes = reinterpret_cast<const unsigned char*>(&value);
            for (std::size_t i = 0; i < sizeof(T); ++i)
                if (bytes[i] != 0) return false;
            return true;
        }
    }
    [[nodiscard]] bool full() const { return count == most; }
    template <class T>
    void add(Span<T> values) {
        arrays[count] = {reinterpret_cast<unsigned char*>(values.data()), values.size() * sizeof(T)};
        first_block[count++] = blocks;
        blocks += static_cast<unsigned>(chunk_count(values.size() * (sizeof(T) / word), words_of_block));
    }

    __device__ void operator()() const {
        unsigned k = 0;
        while (k + 1 < count && first_block[k + 1] <= blockIdx.x) ++k;
        const std::size_t begin = std::size_t(blockIdx.x - first_block[k]) * words_of_block;
        for (unsigned i = threadIdx.x; i < words_of_block; i += block_size) {
            const std::size_t at = word * (begin + i);
            if (at < arrays[k].size()) std::memset(__builtin_assume_aligned(&arrays[k][at], word), 0, word);
        }
    }
};

} // namespace gsh::cuda::detail
