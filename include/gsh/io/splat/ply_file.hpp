// SPDX-License-Identifier: Apache-2.0
/// @file  PLY files: a header that describes tables of numbers, and the rows of one of them.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <vector>

namespace gsh {

/// One number of each row: its type and its position in a row.
struct PlyProperty {
    std::string name;
    char kind = 'f';        ///< as in NumPy: f, i, u
    std::size_t width = 4;  ///< bytes
    std::size_t offset = 0; ///< bytes from the row's start; in ASCII files the column
};

/// A table of a PLY file, such as its vertices.
struct PlyElement {
    std::string name;
    std::uint64_t count = 0;
    std::size_t row_size = 0; ///< bytes; in ASCII files columns
    std::vector<PlyProperty> properties = {};
    std::string unsupported =
        {}; ///< the complaint about a property that is not a plain number; such a table is not read

    [[nodiscard]] const PlyProperty* find(std::string_view property) const {
        for (const auto& candidate : properties)
            if (candidate.name == property) return &candidate;
        return nullptr;
    }
};

/// A PLY file, binary little-endian or ASCII, with plain numbers. Rows are read in blocks.
///
/// After construction, the file is large enough for the vertices and all tables before them. Whether it also holds a
/// table behind the vertices is checked by check_present, and by read_rows before it reads.
///
/// Errors  IoError for a file that is missing, truncated, not PLY, or has lists; ValueError for numbers that are not
///         finite.
class PlyFile {
public:
    explicit PlyFile(const std::filesystem::path& path) : name_(path.string()), file_(std::fopen(path.c_str(), "rbe")) {
        static_assert(std::endian::native == std::endian::little);
        std::error_code error;
        size_ = file_ ? std::filesystem::file_size(path, error) : 0;
        if (!file_ || error)
            throw IoError(name_ + ": cannot be opened: " +
                          (error ? error : std::error_code(errno, std::generic_category())).message());
        read_header();
    }

    [[nodiscard]] const std::string& name() const { return name_; }
    /// The text of the comment lines, at most 256 of them.
    [[nodiscard]] const std::vector<std::string>& comments() const { return comments_; }
    [[nodiscard]] const PlyElement* find(std::string_view element) const {
        for (const auto& candidate : elements_)
            if (candidate.name == element) return &candidate;
        return nullptr;
    }
    [[nodiscard]] const PlyElement& vertices() const { return *find("vertex"); }

    /// Throws IoError unless the file is large enough for an element and all before it. Callers that allocate memory
    /// for a table behind the vertices check it first.
    void check_present(const PlyElement& element) const { (void)begin_of(element); }

    /// Calls visit(row, values) for each row of an element, with the values of the `wanted` properties in their order.
    /// T is float, or std::uint32_t for properties that hold bits. In an ASCII file only the first table can be read.
    template <class T = float, class Visit>
    void read_rows(const PlyElement& element, const std::vector<PlyProperty>& wanted, const Visit& visit) {
        seek(element);
        std::vector<T> values(wanted.size());
        std::vector<double> columns(ascii_ ? element.row_size : 0);
        constexpr std::size_t block = 1 << 12; // rows
        std::vector<char> rows(ascii_ ? 0 : std::min<std::size_t>(block, element.count) * element.row_size);
        for (std::size_t begin = 0; begin < element.count; begin += block) {
            const std::size_t count = std::min<std::size_t>(block, element.count - begin);
            if (!ascii_ && std::fread(rows.data(), element.row_size, count, file_.get()) != count) fail("is truncated");
            for (std::size_t i = 0; i < count; ++i) {
                if (ascii_) read_columns(begin + i, columns);
                for (std::size_t k = 0; k < wanted.size(); ++k) {
                    const double value =
                        ascii_ ? columns[wanted[k].offset] : number_at(&rows[i * element.row_size], wanted[k]);
                    if constexpr (std::is_integral_v<T>) { // of 32 bits at most, so a double holds it
                        if (!(value >= 0 && value <= std::numeric_limits<T>::max()))
                            fail(detail::shortened(wanted[k].name) + " of row " + std::to_string(begin + i) +
                                 " is not an unsigned integer");
                    }
                    values[k] = static_cast<T>(value);
                    if (!std::isfinite(static_cast<double>(values[k])))
                        throw ValueError(name_ + ": " + detail::shortened(wanted[k].name) + " of " +
                                         detail::shortened(element.name) + " " + std::to_string(begin + i) + " is " +
                                         detail::number_text(value) + ", expected a finite number");
                }
                visit(begin + i, values);
            }
        }
    }

private:
    struct Close {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    std::string name_;
    std::unique_ptr<std::FILE, Close> file_;
    std::uintmax_t size_ = 0;
    bool ascii_ = false;
    std::size_t data_begin_ = 0;
    std::vector<PlyElement> elements_;
    std::vector<std::string> comments_;

    [[noreturn]] void fail(const std::string& reason) const { throw IoError(name_ + ": " + reason); }

    /// The next line without its end.
    std::string line() {
        std::string text;
        int c = 0;
        while ((c = std::fgetc(file_.get())) != EOF && c != '\n') {
            text.push_back(static_cast<char>(c));
            if (text.size() > 4096) fail("is not a PLY file: a header line is longer than 4096 characters");
        }
        if (c == EOF && text.empty()) fail("is truncated: the header has no end_header");
        if (text.ends_with('\r')) text.pop_back();
        return text;
    }

    void read_header() {
        char magic[4] = {};
        if (std::fread(magic, 1, 3, file_.get()) != 3 || std::string_view(magic) != "ply") fail("is not a PLY file");
        bool has_format = false;
        (void)line();
        while (true) {
            const std::string text = line();
            const std::vector<std::string_view> word = detail::words_in(text);
            if (word.empty() || word[0] == "obj_info") continue;
            if (word[0] == "comment") {
                if (comments_.size() < 256 && text.size() > 8) comments_.push_back(text.substr(8));
                continue;
            }
            if (word[0] == "end_header") break;
            if (word[0] == "format" && word.size() >= 2) {
                if (word[1] != "binary_little_endian" && word[1] != "ascii")
                    fail("has format " + detail::shortened(word[1]) + ", expected binary_little_endian or ascii");
                ascii_ = word[1] == "ascii";
                has_format = true;
            } else if (word[0] == "element" && word.size() == 3) {
                add_element(word);
            } else if (word[0] == "property" && word.size() >= 2) {
                if (!elements_.empty()) add_property(elements_.back(), word);
            } else {
                fail("is not a PLY file: unknown header line '" + detail::shortened(word[0]) + "'");
            }
        }
        if (!has_format) fail("has no format line");
        if (!find("vertex")) fail("has no vertex element");
        data_begin_ = static_cast<std::size_t>(std::ftell(file_.get()));
        for (const PlyElement& element : elements_) {
            if (element.name == "vertex") {
                (void)begin_of(element);
                return;
            }
            // Compressed Gaussians begin with the boxes of their chunks.
            if (element.count > 0 && (ascii_ || element.name != "chunk"))
                fail("holds " + detail::shortened(element.name) +
                     " elements before the vertices, expected vertices first");
        }
    }

    void add_element(const std::vector<std::string_view>& word) {
        const std::string name(word[1]);
        std::uint64_t count = 0;
        const char *const begin = word[2].data(), *const last = begin + word[2].size();
        const auto [end, code] = std::from_chars(begin, last, count);
        if (code != std::errc() || end != last)
            fail("element " + detail::shortened(name) + " has the count " + detail::shortened(word[2]) +
                 ", expected a number");
        if (find(name)) fail("element " + detail::shortened(name) + " stands there twice");
        if (elements_.size() >= 64) fail("has more than 64 elements");
        elements_.push_back({name, count});
    }

    void add_property(PlyElement& element, const std::vector<std::string_view>& word) const {
        struct Type {
            std::string_view name;
            char kind;
            std::size_t width;
        };
        static constexpr std::array<Type, 16> types{{{"float", 'f', 4},
                                                     {"float32", 'f', 4},
                                                     {"double", 'f', 8},
                                                     {"float64", 'f', 8},
                                                     {"uchar", 'u', 1},
                                                     {"uint8", 'u', 1},
                                                     {"char", 'i', 1},
                                                     {"int8", 'i', 1},
                                                     {"ushort", 'u', 2},
                                                     {"uint16", 'u', 2},
                                                     {"short", 'i', 2},
                                                     {"int16", 'i', 2},
                                                     {"uint", 'u', 4},
                                                     {"uint32", 'u', 4},
                                                     {"int", 'i', 4},
                                                     {"int32", 'i', 4}}};
        const auto type = word.size() == 3 ? std::find_if(types.begin(), types.end(),
                                                          [&](const Type& t) { return t.name == word[1]; })
                                           : types.end();
        if (type == types.end()) {
            element.unsupported = "property " + detail::shortened(word.back()) + " has type " +
                                  detail::shortened(word[1]) + ", expected a plain number type";
            if (element.name == "vertex") fail(element.unsupported);
            return;
        }
        if (element.find(word[2])) fail("property " + detail::shortened(word[2]) + " stands there twice");
        if (element.properties.size() >= 4096) fail("has more than 4096 properties");
        element.properties.push_back({std::string(word[2]), type->kind, type->width, element.row_size});
        element.row_size += ascii_ ? 1 : type->width;
    }

    /// The byte at which an element begins, if the file is large enough for it and for all before it.
    std::uintmax_t begin_of(const PlyElement& wanted) const {
        std::uintmax_t begin = data_begin_;
        for (const PlyElement& element : elements_) {
            const std::uintmax_t present = size_ - std::min<std::uintmax_t>(size_, begin);
            if (!element.unsupported.empty()) fail(element.unsupported);
            const std::size_t least = ascii_ ? 2 * element.row_size : element.row_size; // a digit and a blank each
            // The last blank of an ASCII file may be missing.
            if (element.count > 0 && (least == 0 || element.count > (present + ascii_) / least))
                fail("is truncated or its count absurd: " + std::to_string(element.count) + " " +
                     (element.name == "vertex" ? "vertices" : detail::shortened(element.name)) + " of at least " +
                     std::to_string(least) + " bytes, but " + std::to_string(present) + " bytes follow the header");
            if (&element == &wanted) break;
            begin += element.count * element.row_size;
        }
        return begin;
    }

    void seek(const PlyElement& element) {
        const std::uintmax_t begin = begin_of(element);
        if (ascii_ && &element != &elements_.front() && begin != data_begin_)
            fail("is an ASCII file; only its first element is read");
        if (::fseeko(file_.get(), static_cast<off_t>(ascii_ ? data_begin_ : begin), SEEK_SET) != 0)
            fail("is truncated");
    }

    static double number_at(const char* row, const PlyProperty& property) {
        const auto as = [&]<class Number>(Number number) {
            std::memcpy(&number, row + property.offset, sizeof number);
            return static_cast<double>(number);
        };
        if (property.kind == 'f') return property.width == 4 ? as(float()) : as(double());
        if (property.kind == 'u')
            return property.width == 1   ? as(std::uint8_t())
                   : property.width == 2 ? as(std::uint16_t())
                                         : as(std::uint32_t());
        return property.width == 1 ? as(std::int8_t()) : property.width == 2 ? as(std::int16_t()) : as(std::int32_t());
    }

    /// Numbers as C++ writes them, whatever the locale. Those beyond double become infinite or 0.
    void read_columns(std::size_t row, std::vector<double>& columns) {
        constexpr std::size_t longest = 400; // characters; the largest double has 309 digits
        std::string word;
        for (double& column : columns) {
            int c = std::fgetc(file_.get());
            while (is_blank(c)) c = std::fgetc(file_.get());
            word.clear();
            for (; c != EOF && !is_blank(c) && word.size() <= longest; c = std::fgetc(file_.get()))
                word.push_back(static_cast<char>(c));
            const char *const first = word.data() + word.starts_with('+'), *const last = word.data() + word.size();
            const auto [end, error] = std::from_chars(first, last, column);
            const bool beyond = error == std::errc::result_out_of_range;
            if ((error != std::errc() && !beyond) || end != last || word.size() > longest)
                fail("is truncated or damaged: " + (word.empty() ? "no number" : "'" + detail::shortened(word) + "'") +
                     " where vertex " + std::to_string(row) + " should go on");
            if (beyond) column = word.find("e-") != word.npos || word.find("E-") != word.npos ? 0 : HUGE_VAL;
        }
    }
    static bool is_blank(int c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
};

} // namespace gsh
