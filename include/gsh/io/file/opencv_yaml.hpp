// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the subset of YAML that OpenCV's FileStorage writes: numbers, matrices and lists of strings.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace gsh {

/// The entries of a file by key.
///
/// A matrix is `!!opencv-matrix` with rows, cols, dt and data, `!!opencv-nd-matrix` with sizes, dt and data (as OpenCV
/// 5.0 writes arrays of one dimension), or a plain list of numbers. The fields may have any order, and lists may go on
/// over several lines.
///
/// Errors  IoError, ShapeError naming file and key; also for a key that occurs twice, and a matrix whose size is not
///         that of its data.
class OpenCvYaml {
public:
    explicit OpenCvYaml(const InputFile& input);

    [[nodiscard]] bool has(const std::string& key) const { return entries_.count(key) > 0; }
    [[nodiscard]] double number(const std::string& key) const {
        const std::vector<double> values = numbers_in(key, at(key));
        if (values.size() != 1) throw IoError(name_of(key) + " is not a number");
        return values[0];
    }
    /// The data of a matrix with `count` numbers; 0 accepts any number.
    [[nodiscard]] std::vector<double> matrix(const std::string& key, std::size_t count) const;
    /// A list of strings, with dashes or in brackets.
    [[nodiscard]] std::vector<std::string> texts(const std::string& key) const;
    [[nodiscard]] std::string name_of(const std::string& key) const {
        return path_.string() + ": " + detail::shortened(key);
    }

private:
    std::filesystem::path path_;
    std::map<std::string, std::string> entries_; // the text after each key, without comments

    [[nodiscard]] const std::string& at(const std::string& key) const {
        const auto entry = entries_.find(key);
        if (entry == entries_.end()) throw IoError(name_of(key) + " is missing");
        return entry->second;
    }
    [[nodiscard]] std::vector<double> numbers_in(const std::string& key, std::string_view text) const;
    static std::map<std::string, std::string> fields_of(std::string_view text);
    void check_matrix_size(const std::string& key, const std::map<std::string, std::string>& fields,
                           std::size_t found) const;
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A line up to its comment: a # at its beginning or after a blank, outside of quotes.
inline std::string_view without_comment(std::string_view line) {
    char quote = 0;
    for (std::size_t i = 0; i < line.size(); ++i) {
        const char c = line[i];
        if (quote)
            quote = c == quote ? char(0) : quote;
        else if (c == '"' || c == '\'')
            quote = c;
        else if (c == '#' && (i == 0 || line[i - 1] == ' '))
            return line.substr(0, i);
    }
    return line;
}

} // namespace detail

inline OpenCvYaml::OpenCvYaml(const InputFile& input) : path_(input.path()) {
    const std::string text = read_file(input, std::size_t(1) << 26);
    std::string key;
    for (std::size_t start = 0; start < text.size();) {
        const std::size_t end = std::min(text.find('\n', start), text.size());
        std::string_view line = detail::without_comment(std::string_view(text).substr(start, end - start));
        start = end + 1;
        // Python's text mode on Windows turns the \r\n that EasyMocap writes into \r\r\n.
        while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.remove_suffix(1);
        if (line.empty() || line[0] == '%' || line.starts_with("---") || line.starts_with("...")) continue;
        if (line[0] != ' ' && line[0] != '-' && line[0] != '\t') { // a new entry starts in the first column
            const std::size_t colon = line.find(':');
            if (colon == std::string_view::npos)
                throw IoError(path_.string() + ": " +
                              not_the_kind(input, "YAML as OpenCV writes it", "yaml",
                                           "'" + detail::shortened(line) +
                                               "' is not KEY: VALUE, expected YAML as OpenCV writes it"));
            key = std::string(detail::trimmed(line.substr(0, colon)));
            line.remove_prefix(colon + 1);
            if (has(key) && key != "none") // see texts
                throw IoError(name_of(detail::shortened(key)) + " occurs twice, expected each key once");
        }
        entries_[key].append(line).push_back('\n');
    }
}

inline std::vector<double> OpenCvYaml::matrix(const std::string& key, std::size_t count) const {
    const std::string& text = at(key);
    const auto fields = fields_of(text);
    const auto data = fields.find("data");
    const std::string_view list = detail::trimmed(data == fields.end() ? std::string_view(text) : data->second);
    if (list.starts_with("!!binary"))
        throw IoError(name_of(key) + " holds its data in base64, expected numbers; write the file without "
                                     "FileStorage::WRITE_BASE64");
    if (list.empty() || (list[0] != '[' && list[0] != '-'))
        throw IoError(name_of(key) + " has no data [...], expected a matrix");
    const std::vector<double> values = numbers_in(key, list);
    if (count && values.size() != count)
        throw ShapeError(name_of(key) + " has " + std::to_string(values.size()) + " numbers, expected " +
                         std::to_string(count));
    check_matrix_size(key, fields, values.size());
    return values;
}

inline std::vector<std::string> OpenCvYaml::texts(const std::string& key) const {
    const std::string* text = &at(key);
    // With OpenCV 5, EasyMocap's first writer (for OpenCV 3 and 4) gives names: "[", none: "01", …, none: "]".
    if (detail::trimmed(*text) == "\"[\"" && has("none")) text = &at("none");
    std::vector<std::string> result;
    std::string word;
    char quote = 0;
    const auto finish = [&] {
        const std::string_view found = detail::trimmed(word);
        if (!found.empty() && found != "-" && found != "]") result.emplace_back(found);
        word.clear();
    };
    for (const char c : *text) {
        if (quote) {
            if (c == quote)
                quote = 0;
            else
                word.push_back(c);
        } else if ((c == '"' || c == '\'') && word.empty()) {
            quote = c;
        } else if (c == '\n' || c == ',' || c == '[' || c == ']') {
            finish();
        } else if (c == ' ' && word == "-") {
            word.clear();
        } else if (!word.empty() || !detail::trimmed(std::string_view(&c, 1)).empty()) { // no blanks before a word
            word.push_back(c);
        }
    }
    finish();
    return result;
}

inline std::vector<double> OpenCvYaml::numbers_in(const std::string& key, std::string_view text) const {
    std::vector<double> values;
    const char *p = text.data(), *end = p + text.size();
    while (p != end) {
        const bool dash = *p == '-' && (p + 1 == end || p[1] == ' '); // of a list
        if (dash || std::string_view(" ,+[]\n\t").find(*p) != std::string_view::npos) {
            ++p;
            continue;
        }
        double value = 0;
        const auto [next, error] = std::from_chars(p, end, value);
        if (error != std::errc() || !std::isfinite(value))
            throw IoError(
                name_of(key) + " holds '" +
                detail::shortened(detail::first_word(text.substr(static_cast<std::size_t>(p - text.data())))) +
                "', expected finite numbers");
        values.push_back(value);
        p = next;
    }
    return values;
}

/// The fields of a matrix: "sizes" ↦ "[ 3 ]". A line begins a field unless it is inside of brackets.
inline std::map<std::string, std::string> OpenCvYaml::fields_of(std::string_view text) {
    std::map<std::string, std::string> fields;
    std::string field;
    int open = 0;
    while (!text.empty()) {
        const std::size_t end = std::min(text.find('\n'), text.size());
        std::string_view line = text.substr(0, end);
        text.remove_prefix(std::min(end + 1, text.size()));
        const std::size_t colon = line.find(':');
        if (open == 0 && colon != std::string_view::npos) {
            field = std::string(detail::trimmed(line.substr(0, colon)));
            line.remove_prefix(colon + 1);
        }
        for (const char c : line) open += c == '[' ? 1 : c == ']' ? -1 : 0;
        if (!field.empty()) fields[field].append(line).push_back('\n');
    }
    return fields;
}

inline void OpenCvYaml::check_matrix_size(const std::string& key, const std::map<std::string, std::string>& fields,
                                          std::size_t found) const {
    std::vector<double> sizes;
    for (const char* field : {"rows", "cols", "sizes"})
        if (const auto value = fields.find(field); value != fields.end())
            for (const double size : numbers_in(key, value->second)) sizes.push_back(size);
    if (sizes.empty()) return; // a plain list
    if (sizes.size() > 8)
        throw ShapeError(name_of(key) + " has " + std::to_string(sizes.size()) + " sizes, expected one or two");
    double expected = 1;
    std::string text;
    for (const double size : sizes) {
        expected *= size;
        text += (text.empty() ? "" : " x ") + detail::number_text(size);
    }
    if (const auto type = fields.find("dt"); type != fields.end()) { // d, f, "3f": a number of channels, and a type
        const std::string_view written = type->second;
        const std::size_t digit = written.find_first_of("0123456789");
        if (digit != std::string_view::npos && written.find_first_of("0123456789", digit + 1) == std::string_view::npos)
            expected *= written[digit] - '0', text += std::string(" of ") + written[digit] + " channels";
    }
    if (expected != static_cast<double>(found))
        throw ShapeError(name_of(key) + " is " + text + " by its size, but has " + std::to_string(found) + " numbers");
}

} // namespace gsh
