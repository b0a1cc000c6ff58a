// SPDX-License-Identifier: Apache-2.0
/// @file  Stable parallel radix sort of integer keys.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace gsh::cpu::inline GSH_ISA {

/// Sorts items by their unsigned member `key`; equal keys stay in order. Returns whichever of the two arrays holds the
/// result. Digits cover only the bits in which the keys differ from the smallest key, so the depths of a body two
/// metres away take two passes instead of three.
///
/// Shapes  items [n], scratch [n]; histograms is resized as needed.
template <CpuBackend B, class Item>
[[nodiscard]] Span<Item> radix_sort(B& backend, Span<Item> items, Span<Item> scratch,
                                    typename B::template Buffer<std::uint32_t>& histograms) {
    using Key = decltype(Item::key);
    constexpr int max_digit_bits = 11; // 2048 counters for each chunk: 8 KiB, which fits the first-level cache
    const std::size_t n = items.size();
    if (n < 2) return items;
    const std::size_t grain = std::max<std::size_t>(8192, (n + 31) / 32), chunks = chunk_count(n, grain);

    Key low = items[0].key, high = low;
    for (const Item& item : items) {
        low = std::min(low, item.key);
        high = std::max(high, item.key);
    }
    const int bits = static_cast<int>(std::bit_width(static_cast<Key>(high - low)));
    const int passes = (bits + max_digit_bits - 1) / max_digit_bits;
    if (passes == 0) return items;
    const int digit_bits = (bits + passes - 1) / passes;
    const std::size_t digits = std::size_t(1) << digit_bits;
    histograms.resize(chunks * digits);
    const Span<std::uint32_t> counts = histograms;

    for (int pass = 0; pass < passes; ++pass) {
        const auto digit = [&, shift = pass * digit_bits](Key key) {
            return static_cast<std::size_t>((key - low) >> shift) & (digits - 1);
        };
        backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
            std::uint32_t* const count = counts.data() + chunk * digits;
            std::fill(count, count + digits, 0u);
            for (std::size_t i = begin; i < end; ++i) ++count[digit(items[i].key)];
        });
        std::uint32_t sum = 0; // counts become start positions: by digit, then by chunk
        for (std::size_t d = 0; d < digits; ++d)
            for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
                std::uint32_t& place = counts[chunk * digits + d];
                const std::uint32_t count = place;
                place = sum;
                sum += count;
            }
        backend.for_chunks(n, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
            std::uint32_t* const place = counts.data() + chunk * digits;
            for (std::size_t i = begin; i < end; ++i) scratch[place[digit(items[i].key)]++] = items[i];
        });
        std::swap(items, scratch);
    }
    return items;
}

} // namespace gsh::cpu
