// SPDX-License-Identifier: Apache-2.0
/// @file  Where lists and slots begin, for more thread blocks of splats and more tiles than the kernel takes at a time.
#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/bin.cuh>

#include <doctest/doctest.h>

#include "render/cuda/raster_device.hpp"
#include "support/cuda_device.hpp"
#include "support/device_arrays.hpp"
#include "support/raster_scene.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace cuda_bins { // joined builds: other tests have helpers of the same names

using namespace gsh;
using cuda::BlockCount;
using cuda::Device;

/// All that ScanCounts writes.
struct Scanned {
    RasterStatus status;
    std::vector<std::uint32_t> refused, halted, block_begin, tile_begin, tile_end, tile_order, sort_begin, blend_begin;
};

Scanned scan(const std::vector<BlockCount>& blocks, const std::vector<std::uint32_t>& tile_counts,
             std::uint64_t max_pairs = 1u << 26) {
    using Numbers = std::vector<std::uint32_t>;
    Device device;
    const std::size_t tiles = tile_counts.size();
    const auto counts = uploaded(device, tile_counts);
    const auto of_blocks = uploaded(device, blocks);
    auto status = uploaded(device, std::vector<RasterStatus>(1));
    auto refused = uploaded(device, Numbers(1, 7)), halted = uploaded(device, Numbers(1, 0)),
         classes = uploaded(device, Numbers(cuda::tile_classes, 0));
    cuda::Buffer<std::uint32_t> block_begin(blocks.size()), tile_begin(tiles + 1), tile_end(tiles), tile_order(tiles),
        sort_begin(tiles + 1), blend_begin(tiles + 1);
    device.launch(2, cuda::detail::ScanCounts{of_blocks, block_begin, status, refused, halted, max_pairs,
                                              std::numeric_limits<std::uint64_t>::max(), counts, classes, tile_begin,
                                              tile_end, tile_order, sort_begin, blend_begin});
    const auto get = [&](const auto& buffer) { return test::fetched(device, buffer); };
    return {get(status)[0], get(refused),    get(halted),     get(block_begin), get(tile_begin),
            get(tile_end),  get(tile_order), get(sort_begin), get(blend_begin)};
}

/// Sums of what is before each number, and of all at the end.
template <class Values, class Count>
std::vector<std::uint32_t> running(const Values& values, const Count& count) {
    std::vector<std::uint32_t> sums{0};
    for (const auto& value : values) sums.push_back(sums.back() + static_cast<std::uint32_t>(count(value)));
    return sums;
}

TEST_CASE("lists and slots begin where those before end, for any number of tiles and of blocks of splats") {
    if (test::skip_without_device()) return;
    for (const std::size_t size : {0u, 1u, 31u, 32u, 33u, 1023u, 1024u, 1025u, 2049u, 3100u}) {
        CAPTURE(size);
        test::Rng rng(size + 1);
        std::vector<std::uint32_t> tiles;
        std::vector<BlockCount> blocks;
        std::uint32_t visible = 0;
        for (std::size_t i = 0; i < size; ++i) {
            const std::uint32_t kind = static_cast<std::uint32_t>(rng.below(4)); // none, few, some to sort, many
            tiles.push_back(kind == 0 ? 0 : static_cast<std::uint32_t>(1 + rng.below(kind < 3 ? 40 * kind : 7000)));
            blocks.push_back({rng.below(2000), static_cast<std::uint32_t>(rng.below(129)), 0, ~0u});
            visible += blocks.back().visible;
        }
        const Scanned found = scan(blocks, tiles);
        auto begin = running(blocks, [](const BlockCount& block) { return block.pairs; });
        CHECK(found.status.pairs == begin.back());
        begin.pop_back();
        CHECK(found.block_begin == begin);
        CHECK(found.status.visible == visible);
        CHECK(found.status.nonfinite == 0);
        CHECK(found.refused[0] == 0);
        CHECK(found.halted[0] == 0);

        const auto lists = running(tiles, [](std::uint32_t count) { return count; });
        const auto further = [](std::uint32_t at_once) {
            return [at_once](std::uint32_t count) { return count == 0 ? 0 : (count - 1) / at_once; };
        };
        CHECK(found.tile_begin == lists);
        CHECK(found.tile_end == std::vector<std::uint32_t>(lists.begin(), lists.end() - 1));
        CHECK(found.sort_begin == running(tiles, further(cuda::sorted_at_once)));
        CHECK(found.blend_begin == running(tiles, further(cuda::blended_at_once)));

        std::vector<std::uint32_t> seen(size, 0);
        bool descends = true; // to the precision of a class: a quarter of an octave
        for (std::size_t i = 0; i < size; ++i) {
            REQUIRE(found.tile_order[i] < size);
            ++seen[found.tile_order[i]];
            const std::uint32_t count = tiles[found.tile_order[i]];
            const std::uint32_t before = i == 0 ? count : tiles[found.tile_order[i - 1]];
            descends = descends && 4 * count < 5 * before + 4;
        }
        CHECK(std::all_of(seen.begin(), seen.end(), [](std::uint32_t times) { return times == 1; }));
        CHECK(descends);
    }
}

TEST_CASE("a pass is refused for the first Gaussian that is not finite, and for too many pairs, in any block") {
    if (test::skip_without_device()) return;
    const std::vector<std::uint32_t> tiles(3, 5);
    for (const std::size_t first : {0u, 40u, 1023u, 1024u, 2100u}) {
        CAPTURE(first);
        std::vector<BlockCount> blocks(2200, BlockCount{3, 2, 0, ~0u});
        for (const std::size_t block : {first, std::size_t(2150)})
            blocks[block].nonfinite = 2, blocks[block].first_nonfinite = static_cast<std::uint32_t>(128 * block + 5);
        const Scanned found = scan(blocks, tiles);
        CHECK(found.status.nonfinite == 4);
        CHECK(found.status.first_nonfinite == 128 * first + 5);
        CHECK(found.refused[0] == 1);
        CHECK(found.halted[0] == 1);
    }
    const std::vector<BlockCount> blocks(1025, BlockCount{3, 2, 0, ~0u});
    CHECK(scan(blocks, tiles, 3 * 1025).refused[0] == 0);
    CHECK(scan(blocks, tiles, 3 * 1025 - 1).refused[0] == 1);
}

TEST_CASE("an image of more tiles than are summed at a time is that of the host") {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    auto scene = test::make_scene(rng, 60, 16, 16 * 1026, 0.05);
    scene.camera.cy = 16 * 1024; // Gaussians reach tiles of the first and of the second 1,024
    const auto weights = test::random_weights(rng, scene.camera);
    const auto background = test::raster::random_image(rng, scene.camera);
    cpu::Serial serial;
    Device device;
    const auto expected = test::raster::run(serial, scene, weights, background);
    const auto found = test::raster::run(device, scene, weights, background);
    CHECK(found.status.pairs == expected.status.pairs);
    CHECK(test::raster::largest_difference(found.images.color, expected.images.color) <= 1e-10);
    test::raster::check_gradients(found, expected, 1e-10);
}

} // namespace cuda_bins
