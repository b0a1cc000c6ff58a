// SPDX-License-Identifier: Apache-2.0
/// @file  NumPy's array format, .npy: one array with its shape and type.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy_header.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// An array in C order (the last index varies fastest); an empty shape is a single number.
template <class T>
struct NpyArray {
    Shape shape;
    std::vector<T> data;

    [[nodiscard]] std::size_t size() const { return data.size(); }
    /// Length along an axis.
    [[nodiscard]] std::size_t dim(std::size_t axis) const { return shape.at(axis); }
    [[nodiscard]] const T& operator[](std::size_t i) const { return data[i]; }
};

/// The stored types that may be converted to the requested element type.
enum class Numbers {
    same_kind, ///< integers from integers, reals from reals of any width: a wrong dtype is an error
    any,       ///< integers may be read as reals too
    exact,     ///< only the same type, bit for bit; NaN and infinities are accepted
};

/// Reads a file that holds one array.
///
/// Errors  IoError for a file that is missing, truncated or of another kind or dtype; ShapeError for a shape that does
///         not fit `pattern`, in which -1 stands for any length; ValueError for NaN, infinities and numbers out of T's
///         range.
template <class T>
[[nodiscard]] NpyArray<T> read_npy(const InputFile& input, Numbers numbers = Numbers::same_kind);

/// Writes one array, atomically.
template <class T>
void write_npy(const std::filesystem::path& path, Span<const T> data, const Shape& shape);
/// The same into an open file, which the caller commits.
template <class T>
void write_npy(AtomicFile& file, Span<const T> data, const Shape& shape);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Throws unless the shape fits the caller's pattern; -1 stands for any length.
inline void check_shape(const std::string& what, const Shape& shape, Span<const std::int64_t> pattern) {
    bool fits = shape.size() == pattern.size();
    for (std::size_t i = 0; fits && i < pattern.size(); ++i)
        fits = pattern[i] == -1 || static_cast<std::uint64_t>(pattern[i]) == shape[i];
    if (!fits) throw ShapeError(what + " has shape " + shape_text(shape) + ", expected " + shape_text(pattern));
}

template <class T>
concept NpyNumber = std::is_arithmetic_v<T> && !std::same_as<T, bool> && !std::same_as<T, long double>;

template <NpyNumber T>
std::string npy_dtype() {
    const char kind = std::floating_point<T> ? 'f' : std::is_signed_v<T> ? 'i' : 'u';
    return std::string(sizeof(T) == 1 ? "|" : "<") + kind + std::to_string(sizeof(T));
}

/// IEEE half to float.
inline float half_to_float(std::uint16_t half) {
    const int exponent = (half >> 10) & 31, fraction = half & 1023;
    const float magnitude =
        exponent == 31  ? (fraction ? std::numeric_limits<float>::quiet_NaN() : std::numeric_limits<float>::infinity())
        : exponent == 0 ? std::ldexp(static_cast<float>(fraction), -24)
                        : std::ldexp(static_cast<float>(fraction + 1024), exponent - 25);
    return half & 0x8000 ? -magnitude : magnitude;
}

/// "f[12, 2]" for the element at `position` in the file.
inline std::string element_name(const NpyHeader& header, std::size_t position) {
    std::vector<std::size_t> index(header.shape.size());
    for (std::size_t k = 0; k < index.size(); ++k) {
        const std::size_t axis = header.fortran_order ? k : index.size() - 1 - k;
        index[axis] = position % header.shape[axis];
        position /= header.shape[axis];
    }
    std::string text = "[";
    for (std::size_t i = 0; i < index.size(); ++i) text += (i ? ", " : "") + std::to_string(index[i]);
    return text + "]";
}

template <NpyNumber Stored, NpyNumber T>
void convert_numbers(const ByteSource& source, const NpyHeader& header, const std::string& what, bool half, T* out) {
    const std::size_t count = element_count(header.shape);
    constexpr std::size_t block = 1 << 15;
    std::vector<Stored> stored(std::min(block, count));
    for (std::size_t begin = 0; begin < count; begin += block) {
        const std::size_t size = std::min(block, count - begin);
        read_exactly(source, stored.data(), size * sizeof(Stored), what);
        for (std::size_t i = 0; i < size; ++i) {
            const auto refuse = [&](const std::string& value, const std::string& expected) {
                throw ValueError(what + element_name(header, begin + i) + " is " + value + ", expected " + expected);
            };
            if constexpr (std::floating_point<T>) {
                double value = static_cast<double>(stored[i]);
                if constexpr (std::same_as<Stored, std::uint16_t>)
                    if (half) value = half_to_float(stored[i]);
                if (!std::isfinite(value)) refuse(std::isnan(value) ? "NaN" : "infinite", "a finite number");
                if constexpr (sizeof(T) < sizeof(double))
                    if (std::abs(value) > static_cast<double>(std::numeric_limits<T>::max()))
                        refuse(detail::number_text(value), "a number that fits " + npy_dtype<T>());
                out[begin + i] = static_cast<T>(value);
            } else {
                if (!std::in_range<T>(stored[i]))
                    refuse(std::to_string(stored[i]), "an integer that fits " + npy_dtype<T>());
                out[begin + i] = static_cast<T>(stored[i]);
            }
        }
    }
}

/// Fortran order to C order.
template <class T>
std::vector<T> to_c_order(const std::vector<T>& columns, const Shape& shape) {
    std::vector<T> rows(columns.size());
    std::vector<std::size_t> index(shape.size(), 0);
    for (const T& value : columns) {
        std::size_t place = 0;
        for (std::size_t axis = 0; axis < shape.size(); ++axis) place = place * shape[axis] + index[axis];
        rows[place] = value;
        for (std::size_t axis = 0; axis < shape.size() && ++index[axis] == shape[axis]; ++axis) index[axis] = 0;
    }
    return rows;
}

/// Throws unless numbers of this type may be converted to T.
template <NpyNumber T>
void check_dtype(const NpyHeader& header, const std::string& what, Numbers numbers) {
    const std::string found = what + " has dtype " + header.dtype;
    if (header.kind == 'O')
        throw IoError(what +
                      " is a pickled Python object, expected a plain array of numbers; save it from Python as one");
    if (numbers == Numbers::exact) {
        if (header.dtype != npy_dtype<T>() && !(sizeof(T) == 1 && header.dtype == "<" + npy_dtype<T>().substr(1)))
            throw IoError(found + ", expected " + npy_dtype<T>());
        return;
    }
    const bool real = header.is_real() && (header.width == 2 || header.width == 4 || header.width == 8);
    const bool integer = header.is_integer() && std::has_single_bit(header.width) && header.width <= 8;
    if (std::floating_point<T> ? real || (integer && numbers == Numbers::any) : integer) return;
    throw IoError(found + ", expected " +
                  (std::floating_point<T> ? "real numbers (<f4 or <f8)" : "integers (<i4, <u4, <i8 or similar)"));
}

/// The numbers after a header that read_npy_header and check_dtype have accepted.
template <NpyNumber T>
std::vector<T> read_npy_numbers(const ByteSource& source, const NpyHeader& header, const std::string& what,
                                Numbers numbers) {
    std::vector<T> data(element_count(header.shape));
    const auto convert = [&]<class Stored>(Stored, bool half = false) {
        convert_numbers<Stored>(source, header, what, half, data.data());
    };
    if (numbers == Numbers::exact) {
        read_exactly(source, data.data(), data.size() * sizeof(T), what);
    } else if constexpr (std::floating_point<T>) {
        if (header.kind == 'f' && header.width == 2) convert(std::uint16_t(), true);
        if (header.kind == 'f' && header.width == 4) convert(float());
        if (header.kind == 'f' && header.width == 8) convert(double());
    }
    if (numbers != Numbers::exact && header.kind != 'f') {
        const bool is_signed = header.kind == 'i';
        if (header.width == 1) is_signed ? convert(std::int8_t()) : convert(std::uint8_t());
        if (header.width == 2) is_signed ? convert(std::int16_t()) : convert(std::uint16_t());
        if (header.width == 4) is_signed ? convert(std::int32_t()) : convert(std::uint32_t());
        if (header.width == 8) is_signed ? convert(std::int64_t()) : convert(std::uint64_t());
    }
    return header.fortran_order && header.shape.size() > 1 ? to_c_order(data, header.shape) : std::move(data);
}

/// The header of an .npy file.
inline NpyHeader npy_header_of(const InputFile& input) {
    InputStream file(input);
    return read_npy_header([&](void* data, std::size_t count) { return file.read(data, count); }, file.size(),
                           input.name());
}

} // namespace detail

template <class T>
NpyArray<T> read_npy(const InputFile& input, Numbers numbers) {
    const std::string what = input.name();
    InputStream file(input);
    const detail::ByteSource source = [&](void* data, std::size_t count) { return file.read(data, count); };
    const NpyHeader header = detail::read_npy_header(source, file.size(), what);
    detail::check_dtype<T>(header, what, numbers);
    return {header.shape, detail::read_npy_numbers<T>(source, header, what, numbers)};
}

template <class T>
void write_npy(AtomicFile& file, Span<const T> data, const Shape& shape) {
    check_size("write_npy", file.path().string(), data.size(), detail::element_count(shape), "the shape says so");
    file.write(detail::npy_header_bytes(detail::npy_dtype<T>(), shape));
    file.write(data.data(), data.size() * sizeof(T));
}

template <class T>
void write_npy(const std::filesystem::path& path, Span<const T> data, const Shape& shape) {
    AtomicFile file(path);
    write_npy<T>(file, data, shape);
    file.commit();
}

} // namespace gsh
