// SPDX-License-Identifier: Apache-2.0
/// @file  Feature matrices: one row per point, columns grouped in blocks.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace gsh {

/// A matrix [rows, columns] whose columns are stored in groups of `block`, one group after the other. Within a group,
/// the numbers of a row are contiguous. block = columns is the plain row-major matrix. block = Features of a hash grid
/// stores each level separately, so that a pass over one level streams through memory.
///
/// Shapes  values [columns / block][rows][block]; block divides columns.
template <class T>
struct FeatureView {
    Span<T> values;
    std::size_t rows = 0, columns = 0, block = 0;

    FeatureView() = default;
    FeatureView(Span<T> values_, std::size_t rows_, std::size_t columns_, std::size_t block_)
        : values(values_), rows(rows_), columns(columns_), block(block_) {}
    /// A writable view converts to a read-only one.
    template <std::same_as<T> U> // a template, since nvcc warns of a conversion to one's own type
        requires(!std::is_const_v<T>)
    [[nodiscard]] operator FeatureView<const U>() const
    {
        return {values, rows, columns, block};
    }
    [[nodiscard]] bool empty() const { return columns == 0; }
    /// Address of (0, column); the next rows follow at distance `block`.
    [[nodiscard]] GSH_HD T* column(std::size_t c) const {
        return values.data() + (rows ? c / block * rows * block + c % block : 0); // without rows there is no memory
    }
    [[nodiscard]] GSH_HD T& operator()(std::size_t row, std::size_t c) const { return column(c)[row * block]; }

    /// The same rows, columns [first, first + count) only. Both are multiples of block, unless all columns are taken.
    [[nodiscard]] FeatureView slice(std::size_t first, std::size_t count) const {
        check_value(first + count <= columns && first % block == 0 && count % block == 0, "FeatureView::slice",
                    "first and count must be multiples of block and lie within columns");
        return {values.subspan(first * rows, count * rows), rows, count, block};
    }
};

/// values as a row-major matrix of `columns` columns.
template <class T>
[[nodiscard]] FeatureView<T> row_major(Span<T> values, std::size_t columns) {
    check_value(columns > 0 && values.size() % columns == 0, "row_major",
                "values must hold a whole number of rows of `columns` numbers");
    return {values, values.size() / columns, columns, columns};
}

/// values as groups of `block` columns, one group after the other.
template <class T>
[[nodiscard]] FeatureView<T> blocked(Span<T> values, std::size_t columns, std::size_t block) {
    check_value(block > 0 && columns > 0 && columns % block == 0 && values.size() % columns == 0, "blocked",
                "block must divide columns, and values hold a whole number of rows of `columns` numbers");
    return {values, values.size() / columns, columns, block};
}

/// Throws ShapeError unless the view is a [rows, columns] matrix.
template <class T>
void check_features(std::string_view where, std::string_view argument, const FeatureView<T>& view, std::size_t rows,
                    std::size_t columns) {
    const auto check = [&](const char* name, std::size_t found, std::size_t expected, std::string_view hint = {}) {
        if (found != expected) check_size(where, std::string(argument).append(name), found, expected, hint);
    };
    check(".rows", view.rows, rows, "store one row per point");
    check(".columns", view.columns, columns);
    if (view.block == 0 || view.columns % view.block != 0)
        throw ValueError(std::string(where).append(": ").append(argument).append(".block must divide its columns"));
    check(".values", view.values.size(), rows * columns);
}

/// Inputs of a network: features, further numbers of each point, and numbers common to all points.
///
/// Shapes  features [N, F] in any blocks, points [N, P] row-major, shared [S]; the network's inputs are F + P + S
///         numbers in this order.
template <class T>
struct MlpInputs {
    FeatureView<const T> features;
    Span<const T> points = {};
    Span<const T> shared = {};
};

/// How a backward pass writes an output to which nothing else contributes: add, as everywhere, or assign. Assigning
/// saves the caller the zeroing, and the pass the reading of a large intermediate gradient.
enum class Write { add, assign };

} // namespace gsh
