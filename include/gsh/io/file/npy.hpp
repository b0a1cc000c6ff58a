// SPDX-License-Identifier: Apache-2.0
/// @file  NumPy's array format, .npy: one array with its shape and type.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

static_assert(std::endian::native == std::endian::little, "the file formats here are little-endian");

using Shape = std::vector<std::size_t>;

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

/// The contents of an array's header.
struct NpyHeader {
    char kind = 0; ///< as in NumPy: 'f' real, 'i' signed, 'u' unsigned, 'b' bool, 'U' text, 'O' a pickled object
    std::size_t width = 0; ///< bytes per element
    bool fortran_order = false;
    Shape shape;
    std::string dtype; ///< as written in the file, for messages

    [[nodiscard]] bool is_real() const { return kind == 'f'; }
    [[nodiscard]] bool is_integer() const { return kind == 'i' || kind == 'u' || kind == 'b'; }
    [[nodiscard]] bool is_text() const { return kind == 'U'; }
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
[[nodiscard]] NpyArray<T> read_npy(const std::filesystem::path& path, Numbers numbers = Numbers::same_kind);

/// Writes one array, atomically.
template <class T>
void write_npy(const std::filesystem::path& path, Span<const T> data, const Shape& shape);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Reads up to `size` bytes and returns the number read; 0 at the end.
using ByteSource = std::function<std::size_t(void* data, std::size_t size)>;

/// "(10475, 3)"; -1 is written as *.
template <class Lengths>
std::string shape_text(const Lengths& shape) {
    std::string text = "(";
    for (std::size_t i = 0; i < std::size(shape); ++i) {
        const auto length = std::data(shape)[i];
        text += (i ? ", " : "") + (length == static_cast<decltype(length)>(-1) ? "*" : std::to_string(length));
    }
    return text + (std::size(shape) == 1 ? ",)" : ")");
}

/// Computes the product of the lengths times `width`; returns false if it overflows.
inline bool checked_bytes(const Shape& shape, std::size_t width, std::size_t& bytes) {
    bytes = width;
    bool empty = false;
    for (const std::size_t length : shape) empty = empty || length == 0;
    if (empty) return bytes = 0, true;
    for (const std::size_t length : shape)
        if (__builtin_mul_overflow(bytes, length, &bytes)) return false;
    return true;
}

inline std::size_t element_count(const Shape& shape) {
    std::size_t count = 1;
    for (const std::size_t length : shape) count *= length;
    return count;
}

inline void read_exactly(const ByteSource& source, void* data, std::size_t size, const std::string& what) {
    char* bytes = static_cast<char*>(data);
    while (size > 0) {
        const std::size_t count = source(bytes, size);
        if (count == 0) throw IoError(what + " is truncated: " + std::to_string(size) + " more bytes expected");
        bytes += count, size -= count;
    }
}

/// A parser for the subset of Python in which a header is written.
class HeaderText {
public:
    HeaderText(std::string_view text, const std::string& what) : text_(text), what_(what) {}

    /// Advances past `'key':`.
    void find(std::string_view key) {
        for (const char quote : {'\'', '"'}) {
            const std::size_t place = text_.find(quote + std::string(key) + quote);
            if (place == std::string_view::npos) continue;
            position_ = text_.find(':', place);
            if (position_ == std::string_view::npos) break;
            ++position_;
            return;
        }
        fail("its header has no '" + std::string(key) + "'");
    }
    char peek() {
        while (position_ < text_.size() && text_[position_] == ' ') ++position_;
        return position_ < text_.size() ? text_[position_] : '\0';
    }
    bool take(char c) { return peek() == c && ++position_; }
    bool take_word(std::string_view word) {
        peek();
        if (text_.substr(std::min(position_, text_.size()), word.size()) != word) return false;
        position_ += word.size();
        return true;
    }
    std::string quoted() {
        const char quote = peek();
        const std::size_t end = text_.find(quote, position_ + 1);
        if ((quote != '\'' && quote != '"') || end == std::string_view::npos) fail("its header is damaged");
        const std::string result(text_.substr(position_ + 1, end - position_ - 1));
        position_ = end + 1;
        return result;
    }
    std::size_t number() {
        if (peek() < '0' || peek() > '9') fail("its header is damaged");
        std::size_t value = 0;
        for (; position_ < text_.size() && text_[position_] >= '0' && text_[position_] <= '9'; ++position_)
            if (__builtin_mul_overflow(value, std::size_t(10), &value) ||
                __builtin_add_overflow(value, static_cast<std::size_t>(text_[position_] - '0'), &value))
                fail("its header claims an absurd length");
        take('L'); // the suffix of Python 2's long integers
        return value;
    }
    [[noreturn]] void fail(const std::string& reason) const { throw IoError(what_ + " is not an array: " + reason); }

private:
    std::string_view text_;
    const std::string& what_;
    std::size_t position_ = 0;
};

/// Reads magic, version and header. `size` is the size of the whole member; `what` names file and key.
inline NpyHeader read_npy_header(const ByteSource& source, std::size_t size, const std::string& what) {
    unsigned char start[12] = {};
    read_exactly(source, start, 8, what);
    if (std::memcmp(start, "\x93NUMPY", 6) != 0)
        throw IoError(what + " is not an array: it does not begin as NumPy's .npy format does");
    const int major = start[6];
    if (major < 1 || major > 3)
        throw IoError(what + " has .npy version " + std::to_string(major) + ", expected 1, 2 or 3");
    const std::size_t length_bytes = major == 1 ? 2 : 4;
    read_exactly(source, start + 8, length_bytes, what);
    std::size_t length = 0;
    std::memcpy(&length, start + 8, length_bytes);
    constexpr std::size_t longest = 1 << 20; // bytes; a few hundred are usual
    if (length > longest || 8 + length_bytes + length > size)
        throw IoError(what + " is damaged: its header claims " + std::to_string(length) + " bytes");
    std::string text(length, '\0');
    read_exactly(source, text.data(), length, what);

    NpyHeader header;
    HeaderText parser(text, what);
    parser.find("descr");
    if (parser.peek() == '[') { // a structured type, which is not supported
        header.dtype = "structured";
    } else {
        header.dtype = parser.quoted();
        const std::string& d = header.dtype;
        if (d.size() < 2 || std::string_view("<>|=").find(d[0]) == std::string_view::npos)
            parser.fail("dtype '" + d + "'");
        header.kind = d[1];
        for (std::size_t i = 2; i < d.size() && d[i] >= '0' && d[i] <= '9' && header.width < longest; ++i)
            header.width = header.width * 10 + static_cast<std::size_t>(d[i] - '0');
        if (header.kind == 'U') header.width *= 4;
        if (d[0] == '>' && header.width > 1) header.kind = '>'; // big-endian, which is not supported
    }
    parser.find("fortran_order");
    header.fortran_order = parser.take_word("True");
    if (!header.fortran_order && !parser.take_word("False")) parser.fail("its header is damaged");
    parser.find("shape");
    if (!parser.take('(')) parser.fail("its header is damaged");
    while (!parser.take(')')) {
        header.shape.push_back(parser.number());
        if (!parser.take(',') && parser.peek() != ')') parser.fail("its header is damaged");
        if (header.shape.size() > 32) parser.fail("it has more than 32 axes");
    }
    if (header.kind == 'O') return header; // its size is unknown

    std::size_t bytes = 0;
    const std::size_t present = size - (8 + length_bytes + length);
    if (!checked_bytes(header.shape, header.width, bytes) || bytes != present)
        throw IoError(what + " is truncated or damaged: shape " + shape_text(header.shape) + " of " + header.dtype +
                      " does not fit its " + std::to_string(present) + " bytes");
    return header;
}

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
    const float magnitude = exponent == 31  ? (fraction ? std::numeric_limits<float>::quiet_NaN()
                                                        : std::numeric_limits<float>::infinity())
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
                        refuse(std::to_string(value), "a number that fits " + npy_dtype<T>());
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

/// Magic, version 1.0 and header, padded to 64 bytes as in NumPy.
inline std::string npy_header_bytes(const std::string& dtype, const Shape& shape) {
    std::string text = "{'descr': '" + dtype + "', 'fortran_order': False, 'shape': " + shape_text(shape) + ", }";
    const std::size_t unpadded = 10 + text.size() + 1;
    text.append((64 - unpadded % 64) % 64, ' ').push_back('\n');
    const auto length = static_cast<std::uint16_t>(text.size());
    return std::string("\x93NUMPY\x01\x00", 8) + static_cast<char>(length & 255) + static_cast<char>(length >> 8) +
           text;
}

/// Text as one unicode scalar ('<U5'), so that str(array) returns it in Python.
inline std::string utf8_to_utf32(std::string_view text) {
    std::string result;
    for (std::size_t i = 0; i < text.size();) {
        const auto lead = static_cast<unsigned char>(text[i]);
        const std::size_t length = lead < 0x80 ? 1 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;
        std::uint32_t code = length == 1 ? lead : lead & (0x7Fu >> length);
        for (std::size_t k = 1; k < length && i + k < text.size(); ++k)
            code = code << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3Fu);
        for (int shift = 0; shift < 32; shift += 8) result.push_back(static_cast<char>(code >> shift & 255));
        i += length;
    }
    return result;
}

inline std::string utf32_to_utf8(const std::uint32_t* codes, std::size_t count) {
    std::string text;
    for (std::size_t i = 0; i < count && codes[i] != 0; ++i) {
        const std::uint32_t c = codes[i];
        const auto put = [&](std::uint32_t byte) { text.push_back(static_cast<char>(byte)); };
        if (c < 0x80) put(c);
        else if (c < 0x800) put(0xC0 | c >> 6), put(0x80 | (c & 63));
        else if (c < 0x10000) put(0xE0 | c >> 12), put(0x80 | (c >> 6 & 63)), put(0x80 | (c & 63));
        else put(0xF0 | (c >> 18 & 7)), put(0x80 | (c >> 12 & 63)), put(0x80 | (c >> 6 & 63)), put(0x80 | (c & 63));
    }
    return text;
}

} // namespace detail

template <class T>
NpyArray<T> read_npy(const std::filesystem::path& path, Numbers numbers) {
    const std::string what = path.string();
    const auto close = [](std::FILE* stream) { std::fclose(stream); };
    const std::unique_ptr<std::FILE, decltype(close)> file(std::fopen(path.c_str(), "rbe"), close);
    std::error_code error;
    const std::size_t size = std::filesystem::file_size(path, error);
    if (!file || error) throw IoError(what + ": cannot be opened: " + std::generic_category().message(errno));
    const detail::ByteSource source = [&](void* data, std::size_t count) {
        return std::fread(data, 1, count, file.get());
    };
    const NpyHeader header = detail::read_npy_header(source, size, what);
    detail::check_dtype<T>(header, what, numbers);
    return {header.shape, detail::read_npy_numbers<T>(source, header, what, numbers)};
}

template <class T>
void write_npy(const std::filesystem::path& path, Span<const T> data, const Shape& shape) {
    check_size("write_npy", path.string(), data.size(), detail::element_count(shape), "the shape says so");
    AtomicFile file(path);
    file.write(detail::npy_header_bytes(detail::npy_dtype<T>(), shape));
    file.write(data.data(), data.size() * sizeof(T));
    file.commit();
}

} // namespace gsh
