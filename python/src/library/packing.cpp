// SPDX-License-Identifier: Apache-2.0
/// @file  Packed arrays: rows of the Gaussians that are not culled.

#include "library/packing.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"

#include <algorithm>
#include <cstddef>
#include <cstring>

namespace gsh_python {

namespace {
constexpr std::size_t grain = 8192;
}

int find_visible(const Sizes& sizes, const std::int32_t* radii, std::int64_t* count, std::int64_t* ids,
                 std::int64_t* batch_ids, std::int64_t* camera_ids, std::int64_t* gaussian_ids) {
    return guarded([&] {
        std::int64_t found = 0, i = 0;
        for (std::int64_t image = 0; image < sizes.batches * sizes.cameras; ++image)
            for (std::int64_t n = 0; n < sizes.count; ++n, ++i) {
                if (radii[2 * i] <= 0 || radii[2 * i + 1] <= 0) continue;
                ids[found] = i, gaussian_ids[found] = n;
                batch_ids[found] = image / sizes.cameras, camera_ids[found] = image % sizes.cameras;
                ++found;
            }
        *count = found;
    });
}

int gather_rows(int thread_count, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count,
                const void* from, void* to) {
    return guarded([&] {
        const auto row = static_cast<std::size_t>(row_bytes / 4);
        const auto* const source = static_cast<const std::uint32_t*>(from);
        auto* const target = static_cast<std::uint32_t*>(to);
        threads(thread_count).for_chunks(static_cast<std::size_t>(count), grain,
                                         [=](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t k = begin; k < end; ++k)
                for (std::size_t c = 0; c < row; ++c)
                    target[k * row + c] = source[static_cast<std::size_t>(ids[k]) * row + c];
        });
    });
}

int scatter_rows(int thread_count, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count,
                 const void* from, std::int64_t rows, void* to) {
    return guarded([&] {
        const auto row = static_cast<std::size_t>(row_bytes / 4);
        const auto* const source = static_cast<const std::uint32_t*>(from);
        auto* const target = static_cast<std::uint32_t*>(to);
        threads(thread_count).for_chunks(static_cast<std::size_t>(rows), grain,
                                         [=](std::size_t, std::size_t begin, std::size_t end) {
            std::fill(target + begin * row, target + end * row, 0u);
            const std::int64_t* id = std::lower_bound(ids, ids + count, static_cast<std::int64_t>(begin));
            for (; id != ids + count && *id < static_cast<std::int64_t>(end); ++id)
                for (std::size_t c = 0; c < row; ++c)
                    target[static_cast<std::size_t>(*id) * row + c] =
                        source[static_cast<std::size_t>(id - ids) * row + c];
        });
    });
}

} // namespace gsh_python
