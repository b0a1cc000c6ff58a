// SPDX-License-Identifier: Apache-2.0
/// @file  For each entry of a hash grid, the list of what is added to its gradient; made once for fixed points.
///
/// The gradient of the table is gathered: one group of threads per entry adds up its list in a fixed order. On coarse
/// levels a few dozen entries have all points in their lists, eight times. There, points are first summed per cell:
/// each reads its gradient once and adds to eight sums, and the lists of the entries contain sums of cells. On fine
/// levels, where a cell has hardly more than one point, eight sums would be as long as what they sum, and the lists
/// contain the points themselves.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/core/span.hpp>
#include <gsh/field/hash_level.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <unordered_map>
#include <vector>

namespace gsh::detail {

/// A contribution to an entry: weight times a row, which is the gradient of a point or a sum of a cell.
template <class T>
struct alignas(2 * sizeof(T)) HashItem { // one read
    std::uint32_t row;
    T weight;
};

/// Work of one block, all of one level.
struct HashTask {
    std::uint32_t first, count; ///< segments of cells, or entries
    std::uint16_t level;
    std::uint8_t lane_bits; ///< 2^lane_bits threads per entry
    bool summed;        ///< the entries' items are sums of cells
};

/// Shapes  segments [S + 1]: segment s has points[segments[s], segments[s + 1]), all of one cell, and makes the sums of
///         its eight corners, rows 8 s to 8 s + 7; entries [E]: entry e has items[item_begin[e], item_begin[e + 1]).
template <std::floating_point T, std::size_t Levels>
struct HashLists {
    // A segment is a few steps of eight threads; more would take longer than the rest of the pass.
    static constexpr std::size_t segment_size = 64, segments_per_block = 32;
    static constexpr std::uint8_t segment_lane_bits = 3;
    static constexpr std::size_t gather_block = 128;
    /// Threads that share a list of up to so many items. Most lists have a few, and one thread reads them in one turn
    /// (HashGather::ahead) or two.
    struct Lanes {
        std::uint8_t bits;
        std::size_t most_items;
    };
    static constexpr Lanes classes[3] = {{0, 8}, {2, 64}, {5, std::numeric_limits<std::size_t>::max()}};
    static constexpr std::size_t least_points_of_cell = 3; ///< on average, for which a level is summed per cell

    std::vector<std::uint32_t> touched;
    std::array<std::size_t, Levels + 1> touched_begin{};
    std::size_t lookups = 0;

    std::vector<std::uint32_t> points, segments{0};
    std::vector<HashTask> sum_tasks;
    std::vector<std::uint32_t> entries, item_begin{0};
    std::vector<HashItem<T>> items;
    std::vector<HashTask> gather_tasks;

    template <class Grid>
    HashLists(const Grid& grid, Span<const vec3<T>> positions, const LevelWeights<T>& weights) {
        for (std::size_t l = 0; l < Levels; ++l) {
            add_level(grid.level(static_cast<int>(l)), l, positions, weights.of_level(static_cast<int>(l)));
            touched_begin[l + 1] = touched.size();
        }
    }

private:
    static constexpr std::uint32_t none = ~0u;

    struct Cell {
        std::uint32_t x, y, z;
        bool operator==(const Cell&) const = default;
    };
    struct CellHash {
        std::size_t operator()(const Cell& c) const { return mix_bits(mix_bits(std::uint64_t(c.y) << 32 | c.z) ^ c.x); }
    };

    void add_level(const HashLevel& level, std::size_t l, Span<const vec3<T>> positions, Span<const T> weights) {
        std::vector<std::uint32_t> used, cell_of; // points with a share in the level, and the numbers of their cells
        std::unordered_map<Cell, std::uint32_t, CellHash> numbers;
        for (std::uint32_t i = 0; i < positions.size(); ++i) {
            if (!weights.empty() && weights[i] == T(0)) continue;
            const HashCell<T> cell = level.cell(positions[i]);
            // In the order of first use, neighbours in memory stay neighbours.
            const Cell key{cell.x[0], cell.y[0], cell.z[0]};
            cell_of.push_back(numbers.try_emplace(key, static_cast<std::uint32_t>(numbers.size())).first->second);
            used.push_back(i);
        }
        lookups += 8 * used.size();
        const bool summed = used.size() >= least_points_of_cell * numbers.size();
        if (!summed) {
            add_entries(level, l, false, [&](const auto& add) {
                for (const std::uint32_t i : used) {
                    const HashCell<T> cell = level.cell(positions[i]);
                    for (int c = 0; c < 8; ++c)
                        add(level.index(cell, c), i, cell.weight(c) * (weights.empty() ? T(1) : weights[i]));
                }
            });
            return;
        }
        const std::size_t first = segments.size() - 1;
        add_segments(used, cell_of, numbers.size());
        const std::size_t last = segments.size() - 1;
        for (std::size_t s = first; s < last; s += segments_per_block)
            sum_tasks.push_back({static_cast<std::uint32_t>(s),
                                 static_cast<std::uint32_t>(std::min(segments_per_block, last - s)),
                                 static_cast<std::uint16_t>(l), segment_lane_bits, true});
        add_entries(level, l, true, [&](const auto& add) {
            for (std::size_t s = first; s < last; ++s) {
                const HashCell<T> cell = level.cell(positions[points[segments[s]]]);
                for (int c = 0; c < 8; ++c)
                    add(level.index(cell, c), static_cast<std::uint32_t>(8 * s + static_cast<std::size_t>(c)), T(1));
            }
        });
    }

    /// Cells one after the other, each with its points in their order, in segments.
    void add_segments(const std::vector<std::uint32_t>& used, const std::vector<std::uint32_t>& cell_of,
                      std::size_t cells) {
        std::vector<std::size_t> begin(cells + 1, 0);
        for (const std::uint32_t cell : cell_of) ++begin[cell + 1];
        for (std::size_t c = 0; c < cells; ++c) begin[c + 1] += begin[c];
        const std::size_t base = points.size();
        points.resize(base + used.size());
        for (std::size_t c = 0; c < cells; ++c)
            for (std::size_t at = begin[c]; at < begin[c + 1];) {
                at = std::min(at + segment_size, begin[c + 1]);
                segments.push_back(static_cast<std::uint32_t>(base + at));
            }
        for (std::size_t k = 0; k < used.size(); ++k) points[base + begin[cell_of[k]]++] = used[k];
    }

    /// visit(add) calls add(entry, row, weight) for each item of the level, the same each time.
    template <class Visit>
    void add_entries(const HashLevel& level, std::size_t l, bool summed, const Visit& visit) {
        std::vector<std::uint32_t> rank(level.size, none), entry, count; // entries in the order of first use
        visit([&](std::uint32_t e, std::uint32_t, T) {
            std::uint32_t& r = rank[e - level.offset];
            if (r == none) {
                r = static_cast<std::uint32_t>(entry.size());
                entry.push_back(e);
                count.push_back(0);
            }
            ++count[r];
        });
        std::size_t total = items.size();
        for (const std::uint32_t of_entry : count) total += of_entry;
        check_value(total <= std::size_t(std::numeric_limits<std::int32_t>::max()), "HashGrid::prepare",
                    "too many points; the CUDA backend counts eight uses of the table per point and level in 32 bits");
        for (std::uint32_t e = 0; e < level.size; ++e)
            if (rank[e] != none) touched.push_back(level.offset + e);

        std::vector<std::uint32_t> next(entry.size()); // where the next item of an entry goes
        std::size_t least_items = 1;
        for (const auto& [lane_bits, most_items] : classes) {
            const std::size_t first = entries.size();
            for (std::size_t r = 0; r < entry.size(); ++r) {
                if (count[r] < least_items || count[r] > most_items) continue;
                next[r] = item_begin.back();
                entries.push_back(entry[r]);
                item_begin.push_back(next[r] + count[r]);
            }
            const std::size_t groups = gather_block >> lane_bits;
            for (std::size_t e = first; e < entries.size(); e += groups)
                gather_tasks.push_back({static_cast<std::uint32_t>(e),
                                        static_cast<std::uint32_t>(std::min(groups, entries.size() - e)),
                                        static_cast<std::uint16_t>(l), lane_bits, summed});
            least_items = most_items + 1;
        }
        items.resize(item_begin.back());
        visit([&](std::uint32_t e, std::uint32_t row, T weight) {
            items[next[rank[e - level.offset]]++] = {row, weight};
        });
    }
};

} // namespace gsh::detail
