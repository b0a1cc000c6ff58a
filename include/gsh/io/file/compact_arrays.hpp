// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays of archives in fewer bytes: sparse ones without loss, quantised ones with steps per column.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <type_traits>
#include <vector>

namespace gsh {

/// How an array of a model is stored.
enum class ArrayStorage {
    dense,   ///< every number, in the layout of SMPL's programs
    single,  ///< the same in single precision
    sparse,  ///< without zeros where most numbers are zero; bit for bit what it was
    compact, ///< quantised; smaller, and a little different
};

/// Adds an array; if fewer than half of its numbers are other than zero, as KEY.indices, KEY.values and KEY.shape.
inline void add_sparse(NpzWriter& file, const std::string& key, const std::vector<double>& numbers,
                       const Shape& shape) {
    std::vector<std::uint32_t> indices;
    std::vector<double> values;
    const auto is_zero = [](double value) { return value == 0 && !std::signbit(value); };
    const auto used =
        static_cast<std::size_t>(std::count_if(numbers.begin(), numbers.end(), [&](double v) { return !is_zero(v); }));
    if (2 * used > numbers.size() || numbers.size() > std::numeric_limits<std::uint32_t>::max())
        return file.add(key, numbers, shape);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        if (is_zero(numbers[i])) continue;
        indices.push_back(static_cast<std::uint32_t>(i));
        values.push_back(numbers[i]);
    }
    file.add(key + ".indices", indices);
    file.add(key + ".values", values);
    file.add(key + ".shape", std::vector<std::int64_t>(shape.begin(), shape.end()));
}

/// Adds rows of `width` numbers as integers Q of one or two bytes: number = offset + step · integer, with an offset and
/// a step for each column, as KEY.q [width, rows], KEY.offset and KEY.step. Around zero, the offset is zero, and so are
/// numbers below half a step, which then compress well.
/// Errors  ShapeError unless these are whole rows; ValueError for NaN and infinities.
template <class Q, class T>
    requires std::is_same_v<Q, std::int8_t> || std::is_same_v<Q, std::int16_t>
void add_quantised(NpzWriter& file, const std::string& key, Span<const T> numbers, std::size_t width,
                   bool around_zero = false) {
    const std::size_t count = width ? numbers.size() / width : 0;
    check_size("add_quantised", key, numbers.size(), count * width, "whole rows");
    check_finite<T>("add_quantised", key, numbers);
    constexpr double steps = std::numeric_limits<Q>::max();
    std::vector<Q> integers(numbers.size());
    std::vector<float> offsets(width), sizes(width);
    for (std::size_t c = 0; c < width; ++c) {
        double low = around_zero ? 0 : HUGE_VAL, high = around_zero ? 0 : -HUGE_VAL;
        for (std::size_t i = 0; i < count; ++i)
            low = std::min<double>(low, numbers[i * width + c]), high = std::max<double>(high, numbers[i * width + c]);
        offsets[c] = around_zero || count == 0 ? 0 : static_cast<float>((low + high) / 2);
        const double reach = count ? std::max(high - offsets[c], offsets[c] - low) : 0;
        sizes[c] = static_cast<float>(reach / steps);
        for (std::size_t i = 0; i < count && sizes[c] > 0; ++i)
            integers[c * count + i] = static_cast<Q>(
                std::clamp(std::round((numbers[i * width + c] - double(offsets[c])) / sizes[c]), -steps, steps));
    }
    file.add(key + ".q", integers, {width, count});
    file.add(key + ".offset", offsets);
    file.add(key + ".step", sizes);
}

/// True for an array in any of these forms.
[[nodiscard]] inline bool has_numbers(const NpzReader& file, const std::string& key) {
    return file.has_array(key) || file.has(key + ".indices") || file.has(key + ".q");
}

/// An array in any of these forms, with its shape; a quantised one has the shape [rows, width].
///
/// Errors  those of NpzReader; ShapeError or ValueError, naming file and key, for parts that do not fit each other or
///         more than 1 GiB.
template <class T>
[[nodiscard]] NpyArray<T> read_numbers(const NpzReader& file, const std::string& key,
                                       Numbers numbers = Numbers::same_kind) {
    constexpr std::size_t limit = (std::size_t(1) << 30) / sizeof(T);
    if (file.has(key + ".q")) {
        const bool bytes = file.header(key + ".q").width == 1;
        const auto offsets = file.read<float>(key + ".offset"), steps = file.read<float>(key + ".step");
        const auto width = static_cast<std::int64_t>(offsets.size());
        NpyArray<T> result;
        const auto expand = [&](const auto& q) {
            const std::size_t columns = q.dim(0), count = q.dim(1);
            check_size(file.name_of(key + ".step"), "step", steps.size(), columns, "one for each column");
            check_value(q.size() <= limit, file.name_of(key), "is larger than 1 GiB");
            detail::check_claim(file.name_of(key), q.size() * sizeof(T), file.size());
            check_finite<float>(file.name_of(key), "offset", offsets.data);
            check_finite<float>(file.name_of(key), "step", steps.data);
            result.shape = {count, columns};
            result.data.resize(q.size());
            for (std::size_t i = 0; i < count; ++i)
                for (std::size_t c = 0; c < columns; ++c)
                    result.data[i * columns + c] =
                        static_cast<T>(double(offsets[c]) + double(steps[c]) * q[c * count + i]);
        };
        if (bytes)
            expand(file.read<std::int8_t>(key + ".q", {width, -1}));
        else
            expand(file.read<std::int16_t>(key + ".q", {width, -1}));
        return result;
    }
    if (!file.has(key + ".indices")) return file.read<T>(key, numbers);
    const auto indices = file.read<std::uint32_t>(key + ".indices");
    const auto values = file.read<T>(key + ".values");
    const auto shape = file.read<std::int64_t>(key + ".shape");
    check_size(file.name_of(key + ".values"), "values", values.size(), indices.size(), "one for each index");
    NpyArray<T> result;
    std::size_t size = 1;
    for (const std::int64_t length : shape.data) {
        check_value(length >= 0 && static_cast<std::uint64_t>(length) <= limit, file.name_of(key + ".shape"),
                    "holds " + std::to_string(length));
        result.shape.push_back(static_cast<std::size_t>(length));
        check_value(length == 0 || size <= limit / static_cast<std::size_t>(length), file.name_of(key),
                    "is larger than 1 GiB");
        size *= static_cast<std::size_t>(length);
    }
    detail::check_claim(file.name_of(key), size * sizeof(T), file.size());
    result.data.assign(size, T(0));
    for (std::size_t k = 0; k < indices.size(); ++k) {
        check_value(indices[k] < size, file.name_of(key + ".indices"),
                    "holds " + std::to_string(indices[k]) + ", expected less than " + std::to_string(size));
        result.data[indices[k]] = values[k];
    }
    return result;
}

/// The same with a check of the shape; -1 stands for any length.
template <class T>
[[nodiscard]] NpyArray<T> read_numbers(const NpzReader& file, const std::string& key,
                                       std::initializer_list<std::int64_t> pattern,
                                       Numbers numbers = Numbers::same_kind) {
    NpyArray<T> array = read_numbers<T>(file, key, numbers);
    if (file.has(key + ".q") && pattern.size() != 2) { // rows were joined when they were written
        Shape shape;
        std::size_t known = 1;
        for (const std::int64_t length : pattern) known *= length > 0 ? static_cast<std::size_t>(length) : 1;
        for (const std::int64_t length : pattern)
            shape.push_back(length >= 0 ? static_cast<std::size_t>(length) : known ? array.size() / known : 0);
        if (detail::element_count(shape) == array.size()) array.shape = shape;
    }
    const Span<const std::int64_t> lengths(pattern.begin(), pattern.size());
    detail::check_shape(file.name_of(key), array.shape, lengths);
    return array;
}

} // namespace gsh
