// SPDX-License-Identifier: Apache-2.0
/// @file  The cheapest assignment of rows to columns.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace gsh {

/// Gives each row a column of its own, or none, so that the sum of costs is least. A row without a column costs `none`,
/// so that no row gets a column that costs more. Returns the column of each row, or -1.
///
/// Shapes  costs [rows, columns], finite; rows or columns may be 0.
/// Errors  ShapeError if there are not as many costs.
/// Source  Kuhn, "The Hungarian method for the assignment problem", 1955; with shortest augmenting paths as in Jonker
///         and Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems", 1987.
[[nodiscard]] inline std::vector<int> cheapest_assignment(Span<const double> costs, std::size_t rows,
                                                          std::size_t columns, double none) {
    check_size("cheapest_assignment", "costs", costs.size(), rows * columns, "one for each row and column");
    // Each row has one more column of its own that costs `none`, so that all rows can be assigned.
    const std::size_t wide = columns + rows;
    constexpr double never = std::numeric_limits<double>::infinity();
    const auto cost = [&](std::size_t r, std::size_t c) {
        return c < columns ? costs[r * columns + c] : c - columns == r ? none : never;
    };
    std::vector<double> row_price(rows, 0), column_price(wide, 0);
    std::vector<int> row_of(wide, -1);
    for (std::size_t start = 0; start < rows; ++start) {
        // The cheapest path from this row to a free column: over columns whose rows move on to another one.
        std::vector<double> distance(wide, never);
        std::vector<int> from(wide, -1); // the column before it on the path, or -1 for `start`
        std::vector<bool> done(wide, false);
        std::size_t row = start, end = wide;
        int column = -1;
        double walked = 0;
        while (end == wide) {
            std::size_t next = wide;
            for (std::size_t c = 0; c < wide; ++c) {
                if (done[c]) continue;
                const double through = walked + cost(row, c) - row_price[row] - column_price[c];
                if (through < distance[c]) distance[c] = through, from[c] = column;
                if (next == wide || distance[c] < distance[next]) next = c;
            }
            walked = distance[next];
            done[next] = true, column = static_cast<int>(next);
            if (row_of[next] < 0)
                end = next;
            else
                row = static_cast<std::size_t>(row_of[next]);
        }
        row_price[start] += walked;
        for (std::size_t c = 0; c < wide; ++c)
            if (done[c] && c != end) {
                row_price[static_cast<std::size_t>(row_of[c])] += walked - distance[c];
                column_price[c] -= walked - distance[c];
            }
        for (int c = static_cast<int>(end); c >= 0;) {
            const int before = from[static_cast<std::size_t>(c)];
            row_of[static_cast<std::size_t>(c)] =
                before < 0 ? static_cast<int>(start) : row_of[static_cast<std::size_t>(before)];
            c = before;
        }
    }
    std::vector<int> column_of(rows, -1);
    for (std::size_t c = 0; c < columns; ++c)
        if (row_of[c] >= 0) column_of[static_cast<std::size_t>(row_of[c])] = static_cast<int>(c);
    return column_of;
}

} // namespace gsh
