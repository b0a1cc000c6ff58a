// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/tile_sort.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

using namespace gsh;

namespace {

template <class V>
cuda::Buffer<V> on_device(cuda::Device& device, const std::vector<V>& host) {
    cuda::Buffer<V> buffer(host.size());
    device.upload(Span<const V>(host), Span<V>(buffer));
    return buffer;
}

} // namespace

TEST_CASE_TEMPLATE("Lists of any length are sorted by depth, then by slot", T, float, double) {
    if (test::skip_without_device()) return;
    using Key = cuda::SortKey<T>;
    test::Rng rng(1);
    const std::vector<std::uint32_t> lengths = {5000, 4609, 4608, 2305, 2304, 2303, 300, 257, 256, 255, 33, 32,
                                                31,   19,   18,   17,   10,   9,    8,   2,   1,   0,   0};
    const std::size_t tiles = lengths.size();
    std::vector<std::uint32_t> begin(tiles + 1), further(tiles + 1), order(tiles), owners;
    for (std::size_t t = 0; t < tiles; ++t) {
        begin[t + 1] = begin[t] + lengths[t];
        further[t + 1] = further[t] + (lengths[t] == 0 ? 0 : (lengths[t] - 1) / cuda::sorted_at_once);
        order[t] = static_cast<std::uint32_t>((t * 5 + 3) % tiles);
    }
    const std::size_t n = begin[tiles];
    std::vector<std::uint32_t> slots(n);
    std::iota(slots.begin(), slots.end(), 0u);
    for (std::size_t i = n; i-- > 1;) std::swap(slots[i], slots[rng.below(i + 1)]);
    std::vector<Key> keys;
    std::vector<T> depths(n);
    for (std::size_t i = 0; i < n; ++i) {
        owners.push_back(static_cast<std::uint32_t>(rng.below(1000)));
        depths[slots[i]] = static_cast<T>(i % 3 == 0 ? 1.5 : rng.uniform(0.2, 9)); // many are equal
        keys.push_back(Key::of(depths[slots[i]], slots[i]));
    }
    cuda::Device device;
    cuda::Buffer<Key> on_keys = on_device(device, keys);
    const auto on_begin = on_device(device, begin), on_further = on_device(device, further);
    const auto on_order = on_device(device, order), on_owners = on_device(device, owners);
    const auto refused = on_device(device, std::vector<std::uint32_t>(1, 0));
    cuda::Buffer<cuda::TileInstance> instances(n);
    const cuda::detail::Segments segments{on_order, on_begin, on_further, cuda::sorted_at_once,
                                          static_cast<std::uint32_t>(n / cuda::sorted_at_once)};
    using Merge = cuda::detail::MergeTiles<T>;
    device.launch(segments.blocks(),
                  cuda::detail::SortTiles<T>{refused, segments, on_keys, on_owners, instances});
    device.launch(segments.further * Merge::blocks_of_segment, Merge{refused, segments, on_keys, on_owners, instances});
    std::vector<cuda::TileInstance> found(n);
    device.download(Span<const cuda::TileInstance>(instances), Span<cuda::TileInstance>(found));
    for (std::size_t t = 0; t < tiles; ++t) {
        std::vector<std::uint32_t> expected(slots.begin() + begin[t], slots.begin() + begin[t + 1]);
        std::sort(expected.begin(), expected.end(), [&](std::uint32_t a, std::uint32_t b) {
            return depths[a] < depths[b] || (depths[a] == depths[b] && a < b);
        });
        bool same = true;
        for (std::size_t i = 0; i < expected.size(); ++i) {
            const cuda::TileInstance& instance = found[begin[t] + i];
            same = same && instance.slot == expected[i] && instance.splat == owners[instance.slot];
        }
        CAPTURE(lengths[t]);
        CHECK(same);
    }
}
