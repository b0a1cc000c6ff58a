// SPDX-License-Identifier: Apache-2.0
/// @file  A text file line by line: words, numbers, and error messages that name the line.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Without blanks at both ends.
[[nodiscard]] inline std::string_view trimmed(std::string_view text) {
    const auto first = text.find_first_not_of(" \t\r\n\v\f");
    if (first == std::string_view::npos) return {};
    return text.substr(first, text.find_last_not_of(" \t\r\n\v\f") - first + 1);
}

[[nodiscard]] inline std::string_view first_word(std::string_view text) {
    return text.substr(0, text.find_first_of(" \t\r\n\v\f"));
}

[[nodiscard]] inline std::vector<std::string_view> words_in(std::string_view text) {
    std::vector<std::string_view> words;
    for (text = trimmed(text); !text.empty(); text = trimmed(text.substr(words.back().size())))
        words.push_back(first_word(text));
    return words;
}

/// Whether two words are equal but for the case of ASCII letters.
[[nodiscard]] inline bool is_word(std::string_view found, std::string_view expected) {
    if (found.size() != expected.size()) return false;
    for (std::size_t i = 0; i < found.size(); ++i)
        if (std::tolower(static_cast<unsigned char>(found[i])) != std::tolower(static_cast<unsigned char>(expected[i])))
            return false;
    return true;
}

/// Lines without blanks at their ends; empty ones are skipped. The text must outlive this object.
class TextLines {
public:
    /// `name` is the file's, for messages.
    TextLines(std::string_view text, std::string name) : rest_(text), name_(std::move(name)) {
        if (rest_.starts_with("\xef\xbb\xbf")) rest_.remove_prefix(3);
    }

    /// Goes to the next line; false at the end.
    bool next() {
        while (!rest_.empty()) {
            const auto end = rest_.find('\n');
            line_ = trimmed(rest_.substr(0, end));
            rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
            ++number_;
            if (!line_.empty()) return true;
        }
        line_ = {};
        return false;
    }
    [[nodiscard]] std::string_view line() const { return line_; }
    [[nodiscard]] const std::string& name() const { return name_; }

    /// The number of lines after this one that are not empty.
    [[nodiscard]] std::size_t count_rest() const {
        TextLines copy = *this;
        std::size_t count = 0;
        while (copy.next()) ++count;
        return count;
    }

    /// All words of a text as numbers. `reason` follows the message about a wrong count.
    /// Errors  IoError unless there are `count` of them, all finite.
    [[nodiscard]] std::vector<double> numbers(std::string_view text, std::size_t count,
                                              std::string_view reason = {}) const {
        std::vector<double> values;
        std::size_t found = 0;
        for (text = trimmed(text); !text.empty(); text = trimmed(text)) {
            const std::string_view word = first_word(text);
            text.remove_prefix(word.size());
            const std::string_view digits = word.starts_with('+') ? word.substr(1) : word;
            double value = 0;
            const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
            if (error != std::errc() || end != digits.data() + digits.size() || !std::isfinite(value))
                fail("holds '" + shortened(word) + "', expected a finite number");
            if (++found <= count) values.push_back(value);
        }
        if (found != count)
            fail("holds " + std::to_string(found) + " numbers, expected " + std::to_string(count) +
                 std::string(reason));
        return values;
    }

    /// Throws IoError: "FILE:12: this line WHAT".
    [[noreturn]] void fail(const std::string& what) const {
        if (line_.empty()) fail_at_end("too early: the next line " + what);
        throw IoError(name_ + ":" + std::to_string(number_) + ": this line " + what);
    }
    /// Throws IoError: "FILE: ends WHAT".
    [[noreturn]] void fail_at_end(const std::string& what) const { throw IoError(name_ + ": ends " + what); }

private:
    std::string_view rest_, line_;
    std::string name_;
    std::size_t number_ = 0;
};

} // namespace gsh::detail
