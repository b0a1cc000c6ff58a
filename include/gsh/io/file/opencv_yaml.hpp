// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the subset of YAML that OpenCV's FileStorage writes: numbers, matrices and lists of strings.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/atomic_file.hpp>

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
/// Errors  IoError, ShapeError naming file and key.
class OpenCvYaml {
public:
    explicit OpenCvYaml(const std::filesystem::path& path) : path_(path), text_(read_file(path, std::size_t(1) << 26)) {
        std::string key;
        for (std::size_t start = 0; start < text_.size();) {
            std::size_t end = text_.find('\n', start);
            if (end == std::string::npos) end = text_.size();
            std::string_view line(text_.data() + start, end - start);
            start = end + 1;
            if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
            if (line.empty() || line[0] == '%' || line[0] == '#' || line.starts_with("---") || line.starts_with("..."))
                continue;
            if (line[0] != ' ' && line[0] != '-') { // a new entry starts in the first column
                const std::size_t colon = line.find(':');
                if (colon == std::string_view::npos)
                    throw IoError(path_.string() + ": '" + detail::shortened(line) +
                                  "' is not KEY: VALUE, expected YAML as OpenCV writes it");
                key = std::string(line.substr(0, colon));
                line.remove_prefix(colon + 1);
            }
            entries_[key].append(line).push_back(' ');
        }
    }
    [[nodiscard]] bool has(const std::string& key) const { return entries_.count(key) > 0; }
    [[nodiscard]] double number(const std::string& key) const {
        const std::vector<double> values = numbers_in(key, at(key));
        if (values.size() != 1) throw IoError(name_of(key) + " is not a number");
        return values[0];
    }
    /// The data of a matrix with `count` numbers; 0 accepts any number.
    [[nodiscard]] std::vector<double> matrix(const std::string& key, std::size_t count) const {
        const std::string& text = at(key);
        const std::size_t open = text.find('['), close = text.find(']', open);
        if (open == std::string::npos || close == std::string::npos)
            throw IoError(name_of(key) + " has no data [...], expected a matrix");
        const std::vector<double> values = numbers_in(key, std::string_view(text).substr(open + 1, close - open - 1));
        if (count && values.size() != count)
            throw ShapeError(name_of(key) + " has " + std::to_string(values.size()) + " numbers, expected " +
                             std::to_string(count));
        return values;
    }
    /// A list of strings, with dashes or in brackets.
    [[nodiscard]] std::vector<std::string> texts(const std::string& key) const {
        std::vector<std::string> result;
        std::string word;
        const auto finish = [&] {
            if (!word.empty() && word != "-") result.push_back(word);
            word.clear();
        };
        for (const char c : at(key)) {
            if (c == ' ' || c == ',' || c == '[' || c == ']' || c == '"' || c == '\'')
                finish();
            else
                word.push_back(c);
        }
        finish();
        return result;
    }
    [[nodiscard]] std::string name_of(const std::string& key) const {
        return path_.string() + ": " + detail::shortened(key);
    }

private:
    std::filesystem::path path_;
    std::string text_;
    std::map<std::string, std::string> entries_; // the text after each key, lines joined

    [[nodiscard]] const std::string& at(const std::string& key) const {
        const auto entry = entries_.find(key);
        if (entry == entries_.end()) throw IoError(name_of(key) + " is missing");
        return entry->second;
    }
    [[nodiscard]] std::vector<double> numbers_in(const std::string& key, std::string_view text) const {
        std::vector<double> values;
        const char *p = text.data(), *end = p + text.size();
        while (p != end) {
            if (*p == ' ' || *p == ',' || *p == '+') {
                ++p;
                continue;
            }
            double value = 0;
            const auto [next, error] = std::from_chars(p, end, value);
            if (error != std::errc() || !std::isfinite(value))
                throw IoError(name_of(key) + " holds '" +
                              detail::shortened(text.substr(static_cast<std::size_t>(p - text.data()), 20)) +
                              "', expected finite numbers");
            values.push_back(value);
            p = next;
        }
        return values;
    }
};

} // namespace gsh
