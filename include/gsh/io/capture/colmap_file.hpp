// SPDX-License-Identifier: Apache-2.0
/// @file  Sequential readers of COLMAP's files: numbers of a binary file, words of a text file.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/input_file.hpp>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh::detail {

/// Sequential reader of a binary file.
class ColmapBytes {
public:
    explicit ColmapBytes(std::filesystem::path path)
        : path_(std::move(path)), bytes_(read_file(path_, std::size_t(1) << 34)) {}

    template <class Number>
    Number next() {
        static_assert(std::endian::native == std::endian::little);
        Number number;
        need(sizeof number);
        std::memcpy(&number, bytes_.data() + at_, sizeof number);
        at_ += sizeof number;
        return number;
    }
    std::string text() {
        const std::size_t end = bytes_.find('\0', at_);
        if (end == std::string::npos) fail("is truncated");
        std::string result = bytes_.substr(at_, end - at_);
        at_ = end + 1;
        return result;
    }
    /// Skips `count` entries of `size` bytes.
    void skip(std::uint64_t count, std::size_t size) {
        if (count > (bytes_.size() - at_) / size) fail("is truncated");
        at_ += static_cast<std::size_t>(count) * size;
    }
    /// Reads the number of entries that follow. Each takes at least `size` bytes, which is checked before any
    /// allocation.
    std::uint64_t count(std::size_t size) {
        const auto n = next<std::uint64_t>();
        if (n > (bytes_.size() - at_) / size)
            fail("claims " + std::to_string(n) + " entries of at least " + std::to_string(size) + " bytes, but " +
                 std::to_string(bytes_.size() - at_) + " bytes follow; is it truncated?");
        return n;
    }
    void finish() const {
        if (at_ != bytes_.size()) fail("goes on after its last entry; is it a file of COLMAP?");
    }
    [[nodiscard]] std::string where(const std::string& entry) const { return path_.string() + ": " + entry; }
    [[noreturn]] void fail(const std::string& what) const { throw IoError(path_.string() + ": " + what); }

private:
    void need(std::size_t size) const {
        if (size > bytes_.size() - at_) fail("is truncated");
    }
    std::filesystem::path path_;
    std::string bytes_;
    std::size_t at_ = 0;
};

/// Reads a text file line by line and word by word, without comments.
class ColmapLines {
public:
    explicit ColmapLines(std::filesystem::path path)
        : path_(std::move(path)), text_(read_file(path_, std::size_t(1) << 34)) {}

    /// Advances to the next line that is not empty; false at the end of the file.
    bool next() {
        do
            if (!advance()) return false;
        while (line_.find_first_not_of(" \t\r") == std::string_view::npos ||
               line_[line_.find_first_not_of(" \t\r")] == '#');
        rest_ = line_;
        return true;
    }
    /// Skips the next line, even if it is empty.
    void skip() { advance(); }

    std::string_view word() {
        const std::size_t begin = std::min(rest_.find_first_not_of(" \t\r"), rest_.size());
        const std::size_t end = std::min(rest_.find_first_of(" \t\r", begin), rest_.size());
        if (begin == end) fail("ends too early");
        const std::string_view result = rest_.substr(begin, end - begin);
        rest_.remove_prefix(end);
        return result;
    }
    /// The rest of the line; names of images may contain blanks.
    std::string remainder() {
        const std::size_t begin = rest_.find_first_not_of(" \t\r");
        if (begin == std::string_view::npos) fail("ends too early");
        return std::string(rest_.substr(begin, rest_.find_last_not_of(" \t\r") + 1 - begin));
    }
    [[nodiscard]] bool has_more() const { return rest_.find_first_not_of(" \t\r") != std::string_view::npos; }
    template <class Number>
    Number number() {
        const std::string_view text = word();
        Number value{};
        const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (code != std::errc() || end != text.data() + text.size())
            fail("has '" + shortened(text) + "' where a number should be");
        return value;
    }
    [[nodiscard]] std::string where() const { return path_.string() + ": line " + std::to_string(line_number_); }
    [[noreturn]] void fail(const std::string& what) const { throw IoError(where() + " " + what); }

private:
    bool advance() {
        if (at_ >= text_.size()) return false;
        const std::size_t end = std::min(text_.find('\n', at_), text_.size());
        line_ = std::string_view(text_).substr(at_, end - at_);
        at_ = end + 1;
        ++line_number_;
        return true;
    }
    std::filesystem::path path_;
    std::string text_;
    std::string_view line_, rest_;
    std::size_t at_ = 0, line_number_ = 0;
};

} // namespace gsh::detail
