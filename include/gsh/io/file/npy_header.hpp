// SPDX-License-Identifier: Apache-2.0
/// @file  The header of NumPy's array format: type, order and shape of the numbers that follow.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

static_assert(std::endian::native == std::endian::little, "the file formats here are little-endian");

using Shape = std::vector<std::size_t>;

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

namespace detail {

/// Reads up to `size` bytes and returns the number read; 0 at the end.
using ByteSource = std::function<std::size_t(void* data, std::size_t size)>;

/// "(10475, 3)"; -1 is written as *.
template <class Lengths>
std::string shape_text(const Lengths& shape) {
    std::string text = "(";
    for (std::size_t i = 0; i < std::size(shape); ++i) {
        if (i == 6) return text + ", …)"; // of 32 axes at most
        const auto length = std::data(shape)[i];
        text += (i ? ", " : "") + (length == static_cast<decltype(length)>(-1) ? "*" : std::to_string(length));
    }
    return text + (std::size(shape) == 1 ? ",)" : ")");
}

/// Computes the product of the lengths times `width`; returns false if it overflows, or if the elements take no bytes,
/// so that nothing bounds their number. The other lengths of an array that is empty along one axis may be up to
/// 4 million in product: rows of no numbers are counted, too.
inline bool checked_bytes(const Shape& shape, std::size_t width, std::size_t& bytes) {
    constexpr std::size_t most_empty = std::size_t(1) << 22;
    std::size_t others = 1, zeros = 0;
    for (const std::size_t length : shape)
        if (length == 0)
            ++zeros;
        else if (__builtin_mul_overflow(others, length, &others))
            return false;
    if (zeros) return bytes = 0, others <= most_empty;
    return width > 0 && !__builtin_mul_overflow(others, width, &bytes);
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

/// Whether a header is what stands between { and }, with blanks around it.
inline bool is_one_dictionary(std::string_view text) {
    constexpr std::string_view blank(" \t\r\n\0", 5);
    const std::size_t first = text.find_first_not_of(blank), last = text.find_last_not_of(blank);
    return first != last && text[first] == '{' && text[last] == '}' && text.find('}') == last;
}

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
    // Bytes behind the dictionary would be the file's next ones, where the length is wrong.
    if (!is_one_dictionary(text)) parser.fail("its header is damaged");
    parser.find("descr");
    if (parser.peek() == '[') { // a structured type, which is not supported
        header.dtype = "structured";
    } else {
        header.dtype = parser.quoted();
        const std::string& d = header.dtype;
        if (d.size() < 2 || std::string_view("<>|=").find(d[0]) == std::string_view::npos)
            parser.fail("dtype '" + shortened(d) + "'");
        header.kind = d[1];
        for (std::size_t i = 2; i < d.size() && d[i] >= '0' && d[i] <= '9' && header.width < longest; ++i)
            header.width = header.width * 10 + static_cast<std::size_t>(d[i] - '0');
        if (header.kind == 'U') header.width *= 4;
        if (d[0] == '>' && header.width > 1) header.kind = '>'; // big-endian, which is not supported
        header.dtype = shortened(header.dtype);
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
    if (header.kind == 0)
        throw IoError(what + " is a structured array, expected plain numbers; save each field as an array of its own");
    if (header.width == 0)
        throw IoError(what + " has dtype " + header.dtype + ", whose elements have no bytes, expected plain numbers");
    if (!checked_bytes(header.shape, header.width, bytes) || bytes != present)
        throw IoError(what + " is truncated or damaged: shape " + shape_text(header.shape) + " of " + header.dtype +
                      " does not fit its " + std::to_string(present) + " bytes");
    return header;
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

} // namespace detail
} // namespace gsh
