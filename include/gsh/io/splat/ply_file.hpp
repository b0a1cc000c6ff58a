// SPDX-License-Identifier: Apache-2.0
/// @file  PLY files: the rows of their tables, as numbers.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/ply_header.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace gsh {

/// A PLY file, binary or ASCII. Rows are read in blocks. Lists are skipped, wherever they stand.
///
/// After construction, the file is large enough for the vertices and all tables before them. Whether it also holds a
/// table behind the vertices is checked by check_present, and by read_rows before it reads.
///
/// Errors  IoError for a file that is missing, truncated or not PLY; ValueError for numbers that are not finite.
class PlyFile {
public:
    explicit PlyFile(const InputFile& input) : name_(input.name()), file_(input), size_(file_.size()) {
        static_assert(std::endian::native == std::endian::little);
        header_ = detail::PlyHeaderReader(file_, name_).read();
        data_begin_ = file_.position();
        check_present(vertices());
    }

    [[nodiscard]] const std::string& name() const { return name_; }
    /// The text of the comment lines, at most 256 of them.
    [[nodiscard]] const std::vector<std::string>& comments() const { return header_.comments; }
    [[nodiscard]] const PlyElement* find(std::string_view element) const { return header_.find(element); }
    [[nodiscard]] const PlyElement& vertices() const { return *find("vertex"); }

    /// Throws IoError unless the file is large enough for an element and all before it. Callers that allocate memory
    /// for a table behind the vertices check it first.
    void check_present(const PlyElement& element) const { (void)begin_of(element); }

    /// Calls visit(row, values) for each row of an element, with the values of the `wanted` properties in their order.
    /// T is float, whose values are finite; double, whose values are as the file has them, also NaN and infinities; or
    /// std::uint32_t for properties that hold bits.
    template <class T = float, class Visit>
    void read_rows(const PlyElement& element, const std::vector<PlyProperty>& wanted, const Visit& visit) {
        seek(begin_of(element));
        const bool by_number = is_ascii() || element.has_lists;
        std::vector<T> values(wanted.size());
        std::vector<double> columns(by_number ? element.properties.size() : 0);
        constexpr std::size_t block = 1 << 12; // rows
        std::vector<char> rows(by_number ? 0 : std::min<std::size_t>(block, element.count) * element.row_size);
        for (std::size_t begin = 0; begin < element.count; begin += block) {
            const std::size_t count = std::min<std::size_t>(block, element.count - begin);
            if (!rows.empty() && file_.read(rows.data(), element.row_size * count) != element.row_size * count)
                fail("is truncated");
            for (std::size_t i = 0; i < count; ++i) {
                if (by_number) read_columns(element, begin + i, columns.data());
                for (std::size_t k = 0; k < wanted.size(); ++k)
                    values[k] = converted<T>(
                        by_number ? columns[wanted[k].column]
                                  : number_at(&rows[i * element.row_size] + wanted[k].offset, wanted[k].type),
                        wanted[k], element, begin + i);
                visit(begin + i, values);
            }
        }
    }

    /// Throws ValueError about a number of a row: "FILE: x of vertex 3 is nan, expected a finite number".
    [[noreturn]] void refuse(const PlyElement& element, std::string_view property, std::size_t row, double value,
                             const std::string& expected = "a finite number") const {
        throw ValueError(name_ + ": " + std::string(property) + " of " + detail::shortened(element.name) + " " +
                         std::to_string(row) + " is " + detail::number_text(value) + ", expected " + expected);
    }

private:
    std::string name_;
    mutable InputStream file_; // its place is no state of this object: every reading begins with seek()
    std::uintmax_t size_ = 0, data_begin_ = 0;
    PlyHeader header_;

    [[noreturn]] void fail(const std::string& reason) const { throw IoError(name_ + ": " + reason); }
    [[nodiscard]] bool is_ascii() const { return header_.encoding == PlyEncoding::ascii; }

    template <class T>
    T converted(double value, const PlyProperty& property, const PlyElement& element, std::size_t row) const {
        if constexpr (std::is_integral_v<T>) { // of 32 bits at most, so a double holds it
            if (!(value >= 0 && value <= std::numeric_limits<T>::max()))
                fail(property.name + " of row " + std::to_string(row) + " is not an unsigned integer");
        }
        const T result = static_cast<T>(value);
        if constexpr (std::is_same_v<T, float>)
            if (!std::isfinite(result)) refuse(element, property.name, row, value);
        return result;
    }

    /// The byte at which an element begins, if the file is large enough for it and for all before it.
    std::uintmax_t begin_of(const PlyElement& wanted) const {
        std::uintmax_t begin = data_begin_;
        for (const PlyElement& element : header_.elements) {
            const std::uintmax_t present = size_ - std::min<std::uintmax_t>(size_, begin);
            if (!element.unsupported.empty()) fail(element.unsupported);
            const std::size_t least = is_ascii() ? 2 * element.row_size : element.row_size; // a digit and a blank each
            // The last blank of an ASCII file may be missing.
            if (least > 0 && element.count > (present + is_ascii()) / least)
                fail("is truncated or its count absurd: " + std::to_string(element.count) + " " +
                     (element.name == "vertex" ? "vertices" : detail::shortened(element.name)) + " of at least " +
                     std::to_string(least) + " bytes, but " + std::to_string(present) + " bytes follow");
            if (&element == &wanted) break;
            begin = end_of(element, begin);
        }
        return begin;
    }

    std::uintmax_t end_of(const PlyElement& element, std::uintmax_t begin) const {
        if (!is_ascii() && !element.has_lists) return begin + element.count * element.row_size;
        seek(begin);
        std::vector<double> unused(element.properties.size());
        for (std::size_t row = 0; row < element.count && !element.properties.empty(); ++row)
            read_columns(element, row, unused.data());
        return file_.position();
    }

    void seek(std::uintmax_t begin) const {
        if (!file_.seek(begin)) fail("is truncated");
    }

    double number_at(const char* bytes, const PlyType& type) const {
        const auto as = [&]<class Number>(Number number) {
            char own[sizeof number];
            std::memcpy(own, bytes, sizeof number);
            if (header_.encoding == PlyEncoding::big_endian) std::reverse(own, own + sizeof number);
            std::memcpy(&number, own, sizeof number);
            return static_cast<double>(number);
        };
        if (type.kind == 'f') return type.width == 4 ? as(float()) : as(double());
        if (type.kind == 'u')
            return type.width == 1 ? as(std::uint8_t()) : type.width == 2 ? as(std::uint16_t()) : as(std::uint32_t());
        return type.width == 1 ? as(std::int8_t()) : type.width == 2 ? as(std::int16_t()) : as(std::int32_t());
    }

    /// All numbers of the next row, a list's place taken by its length.
    void read_columns(const PlyElement& element, std::size_t row, double* columns) const {
        for (const PlyProperty& property : element.properties) {
            double& value = columns[property.column];
            value = next_number(property.is_list ? property.length : property.type, element, row);
            if (!property.is_list) continue;
            if (!(value >= 0 && value <= static_cast<double>(size_) && value == std::floor(value)))
                fail("the list " + detail::shortened(property.name) + " of row " + std::to_string(row) +
                     " has a length of " + detail::number_text(value));
            for (auto left = static_cast<std::uintmax_t>(value); left > 0; --left)
                (void)next_number(property.type, element, row);
        }
    }

    /// The number at the file's place: of a type, or in ASCII as C++ writes it, whatever the locale. Those beyond
    /// double become infinite or 0.
    double next_number(const PlyType& type, const PlyElement& element, std::size_t row) const {
        if (!is_ascii()) {
            char bytes[8];
            if (file_.read(bytes, type.width) != type.width) fail("is truncated");
            return number_at(bytes, type);
        }
        constexpr std::size_t longest = 400; // characters; the largest double has 309 digits
        std::string word;
        int c = file_.next();
        while (is_blank(c)) c = file_.next();
        for (; c != EOF && !is_blank(c) && word.size() <= longest; c = file_.next())
            word.push_back(static_cast<char>(c));
        double value = 0;
        const char *const first = word.data() + word.starts_with('+'), *const last = word.data() + word.size();
        const auto [end, error] = std::from_chars(first, last, value);
        const bool beyond = error == std::errc::result_out_of_range;
        if ((error != std::errc() && !beyond) || end != last || word.size() > longest)
            fail("is truncated or damaged: " + (word.empty() ? "no number" : "'" + detail::shortened(word) + "'") +
                 " where " + detail::shortened(element.name) + " " + std::to_string(row) + " should go on");
        if (!beyond) return value;
        const bool tiny = word.find("e-") != word.npos || word.find("E-") != word.npos;
        return tiny ? 0 : word.starts_with('-') ? -HUGE_VAL : HUGE_VAL;
    }
    static bool is_blank(int c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
};

} // namespace gsh
