// SPDX-License-Identifier: Apache-2.0
/// @file  The header of a PLY file: its tables, their properties and the comments.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// A number type of a PLY file.
struct PlyType {
    char kind = 'f';       ///< as in NumPy: f, i, u
    std::size_t width = 4; ///< bytes
};

/// One number of each row, or a list of numbers, which begins with its length.
struct PlyProperty {
    std::string name;
    PlyType type;           ///< of the number, or of each number of a list
    std::size_t offset = 0; ///< bytes from the row's start, if no list stands before
    std::size_t column = 0; ///< its place among the properties
    PlyType length = {};    ///< of a list
    bool is_list = false;
};

/// A table of a PLY file, such as its vertices.
struct PlyElement {
    std::string name;
    std::uint64_t count = 0;
    std::size_t row_size = 0; ///< bytes of a row with empty lists; in ASCII files the least number of columns
    std::vector<PlyProperty> properties = {};
    bool has_lists = false;
    std::string unsupported = {}; ///< the complaint about a property of unknown type; such a table is not read

    /// A property that is one number.
    [[nodiscard]] const PlyProperty* find(std::string_view property) const {
        for (const auto& candidate : properties)
            if (candidate.name == property && !candidate.is_list) return &candidate;
        return nullptr;
    }
};

/// How the numbers of a PLY file are stored.
enum class PlyEncoding { ascii, little_endian, big_endian };

/// What a PLY file says before its numbers.
struct PlyHeader {
    PlyEncoding encoding = PlyEncoding::ascii;
    std::vector<PlyElement> elements;
    std::vector<std::string> comments; ///< their texts, at most 256

    [[nodiscard]] const PlyElement* find(std::string_view element) const {
        for (const auto& candidate : elements)
            if (candidate.name == element) return &candidate;
        return nullptr;
    }
};

namespace detail {

/// Reads the header of an open file, up to its end_header.
/// Errors  IoError beginning with `name`, for what is no PLY file or has no vertices.
class PlyHeaderReader {
public:
    PlyHeaderReader(InputStream& file, const std::string& name) : file_(file), name_(name) {}

    [[nodiscard]] PlyHeader read() {
        char magic[4] = {};
        if (file_.read(magic, 3) != 3 || std::string_view(magic) != "ply") fail("is not a PLY file");
        bool has_format = false;
        (void)line();
        while (true) {
            const std::string text = line();
            const std::vector<std::string_view> word = words_in(text);
            if (word.empty() || word[0] == "obj_info") continue;
            if (word[0] == "comment") {
                if (header_.comments.size() < 256 && text.size() > 8) header_.comments.push_back(text.substr(8));
                continue;
            }
            if (word[0] == "end_header") break;
            if (word[0] == "format" && word.size() >= 2) {
                // Sizes of rows follow from it.
                if (has_format || !header_.elements.empty()) fail("has a second format line, or one behind an element");
                set_encoding(word[1]);
                has_format = true;
            } else if (word[0] == "element" && word.size() == 3) {
                add_element(word);
            } else if (word[0] == "property" && word.size() >= 2) {
                if (!header_.elements.empty()) add_property(header_.elements.back(), word);
            } else {
                fail("is not a PLY file: unknown header line '" + shortened(word[0]) + "'");
            }
        }
        if (!has_format) fail("has no format line");
        if (!header_.find("vertex")) fail("has no vertex element");
        return std::move(header_);
    }

private:
    InputStream& file_;
    const std::string& name_;
    PlyHeader header_;

    [[noreturn]] void fail(const std::string& reason) const { throw IoError(name_ + ": " + reason); }

    /// The next line without its end.
    std::string line() {
        std::string text;
        int c = 0;
        while ((c = file_.next()) != EOF && c != '\n') {
            text.push_back(static_cast<char>(c));
            if (text.size() > 4096) fail("is not a PLY file: a header line is longer than 4096 characters");
        }
        if (c == EOF && text.empty()) fail("is truncated: the header has no end_header");
        if (text.ends_with('\r')) text.pop_back();
        return text;
    }

    void set_encoding(std::string_view word) {
        if (word == "ascii")
            header_.encoding = PlyEncoding::ascii;
        else if (word == "binary_little_endian")
            header_.encoding = PlyEncoding::little_endian;
        else if (word == "binary_big_endian")
            header_.encoding = PlyEncoding::big_endian;
        else
            fail("has format " + shortened(word) + ", expected ascii, binary_little_endian or binary_big_endian");
    }

    void add_element(const std::vector<std::string_view>& word) {
        std::uint64_t count = 0;
        const char *const begin = word[2].data(), *const last = begin + word[2].size();
        const auto [end, code] = std::from_chars(begin, last, count);
        if (code != std::errc() || end != last)
            fail("element " + shortened(word[1]) + " has the count " + shortened(word[2]) + ", expected a number");
        if (header_.find(word[1])) fail("element " + shortened(word[1]) + " stands there twice");
        if (header_.elements.size() >= 64) fail("has more than 64 elements");
        header_.elements.push_back({std::string(word[1]), count});
    }

    /// Errors  none: no type for an unknown name.
    static const PlyType* type_called(std::string_view name) {
        struct Named {
            std::string_view name;
            PlyType type;
        };
        static constexpr std::array<Named, 16> types{{{"float", {'f', 4}},
                                                      {"float32", {'f', 4}},
                                                      {"double", {'f', 8}},
                                                      {"float64", {'f', 8}},
                                                      {"uchar", {'u', 1}},
                                                      {"uint8", {'u', 1}},
                                                      {"char", {'i', 1}},
                                                      {"int8", {'i', 1}},
                                                      {"ushort", {'u', 2}},
                                                      {"uint16", {'u', 2}},
                                                      {"short", {'i', 2}},
                                                      {"int16", {'i', 2}},
                                                      {"uint", {'u', 4}},
                                                      {"uint32", {'u', 4}},
                                                      {"int", {'i', 4}},
                                                      {"int32", {'i', 4}}}};
        const auto found =
            std::find_if(types.begin(), types.end(), [&](const Named& named) { return named.name == name; });
        return found == types.end() ? nullptr : &found->type;
    }

    /// "property TYPE NAME", or "property list TYPE TYPE NAME".
    void add_property(PlyElement& element, const std::vector<std::string_view>& word) const {
        const bool is_list = word.size() == 5 && word[1] == "list";
        const PlyType* const length = is_list ? type_called(word[2]) : nullptr;
        const PlyType* const type = is_list ? type_called(word[3]) : word.size() == 3 ? type_called(word[1]) : nullptr;
        if (!type || (is_list && (!length || length->kind == 'f'))) {
            element.unsupported = "property " + shortened(word.back()) + " has type " + shortened(word[1]) +
                                  ", expected a plain number type or a list of one";
            return;
        }
        const auto same = [&](const PlyProperty& other) { return other.name == word.back(); };
        if (std::any_of(element.properties.begin(), element.properties.end(), same))
            fail("property " + shortened(word.back()) + " stands there twice");
        if (element.properties.size() >= 4096) fail("has more than 4096 properties");
        PlyProperty property{std::string(word.back()), *type, element.row_size, element.properties.size()};
        if (is_list) property.is_list = true, property.length = *length;
        element.has_lists = element.has_lists || is_list;
        element.row_size += header_.encoding == PlyEncoding::ascii ? 1 : is_list ? length->width : type->width;
        element.properties.push_back(std::move(property));
    }
};

} // namespace detail

} // namespace gsh
