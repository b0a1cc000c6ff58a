// SPDX-License-Identifier: Apache-2.0
/// @file  Text files with lines of numbers separated by commas or blanks.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// The lines of a file as numbers; empty lines are skipped.
///
/// Errors  IoError, ShapeError naming file and line.
class NumberLines {
public:
    explicit NumberLines(const InputFile& input) : path_(input.path()) {
        const std::string text = read_file(input, std::size_t(1) << 26);
        const char *p = text.data(), *end = p + text.size();
        std::size_t number = 1;
        while (p != end) {
            Line line{number, {}};
            while (p != end && *p != '\n') {
                if (*p == ' ' || *p == ',' || *p == '\t' || *p == '\r' || *p == '+') {
                    ++p;
                    continue;
                }
                double value = 0;
                const auto [next, error] = std::from_chars(p, end, value);
                if (error != std::errc() || !std::isfinite(value))
                    refuse(input, number, std::string_view(p, static_cast<std::size_t>(end - p)));
                line.values.push_back(value);
                p = next;
            }
            if (p != end) ++p;
            if (!line.values.empty()) lines_.push_back(std::move(line));
            ++number;
        }
        if (lines_.empty()) throw IoError(input.name() + ": holds no numbers");
    }
    [[nodiscard]] std::size_t size() const { return lines_.size(); }
    /// The numbers of a line; throws unless there are `count` of them (0: any number).
    [[nodiscard]] const std::vector<double>& at(std::size_t i, std::size_t count, const char* what) const {
        if (i >= lines_.size())
            throw IoError(path_.string() + ": ends after " + std::to_string(lines_.size()) +
                          " lines of numbers, expected " + what);
        if (count && lines_[i].values.size() != count)
            throw ShapeError(where(lines_[i].number) + ": holds " + std::to_string(lines_[i].values.size()) +
                             " numbers, expected " + std::to_string(count) + ": " + what);
        return lines_[i].values;
    }
    [[nodiscard]] vec3<double> vector(std::size_t i, const char* what) const {
        const std::vector<double>& v = at(i, 3, what);
        return {v[0], v[1], v[2]};
    }
    [[nodiscard]] std::vector<double> all() const {
        std::vector<double> values;
        for (const Line& line : lines_) values.insert(values.end(), line.values.begin(), line.values.end());
        return values;
    }
    [[nodiscard]] std::string where(std::size_t number) const { return path_.string() + ":" + std::to_string(number); }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }

private:
    [[noreturn]] void refuse(const InputFile& input, std::size_t number, std::string_view rest) const {
        const std::string foreign = not_the_kind(input, "lines of numbers", "text", "");
        if (!foreign.empty()) throw IoError(path_.string() + ": " + foreign);
        throw IoError(where(number) + ": '" + detail::shortened(rest.substr(0, rest.find('\n')).substr(0, 20)) +
                      "' is not a finite number");
    }
    struct Line {
        std::size_t number;
        std::vector<double> values;
    };
    std::filesystem::path path_;
    std::vector<Line> lines_;
};

} // namespace gsh
