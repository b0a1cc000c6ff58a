// SPDX-License-Identifier: Apache-2.0
/// @file  Writes NumPy's archives, .npz: named arrays in one zip file.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/utf.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Whether the members of an archive are stored as they are, or deflated.
enum class Packing { stored, deflated };

/// Writes members one after the other. Uncompressed, writing is fast. Equal arrays give equal bytes.
///
/// The file appears on commit. It holds at most 4 GiB in total.
class NpzWriter {
public:
    explicit NpzWriter(std::filesystem::path path, Packing packing = Packing::stored)
        : file_(std::move(path)), packing_(packing) {}

    template <class T>
    void add(std::string_view key, Span<const T> data, const Shape& shape);
    /// A one-dimensional array.
    template <class T>
    void add(std::string_view key, const std::vector<T>& data) {
        add<T>(key, Span<const T>(data), {data.size()});
    }
    template <class T>
    void add(std::string_view key, const std::vector<T>& data, const Shape& shape) {
        add<T>(key, Span<const T>(data), shape);
    }
    /// A 0-d array: a single number.
    template <class T>
        requires std::is_arithmetic_v<T>
    void add(std::string_view key, T number) {
        add<T>(key, Span<const T>(&number, 1), Shape{});
    }
    /// A 0-d unicode array.
    void add_text(std::string_view key, std::string_view text);
    /// A 1-d unicode array.
    void add_texts(std::string_view key, const std::vector<std::string>& texts);

    /// Makes the file appear. With a path `keep`, the file that it replaces is there afterwards (AtomicFile::commit).
    void commit(const std::filesystem::path& keep = {});

private:
    AtomicFile file_;
    Packing packing_;
    std::string directory_; // central directory so far
    std::vector<std::string> names_;

    void add_member(std::string_view key, const std::string& header, const void* data, std::size_t size);
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Appends integers in little-endian order.
template <class... Integers>
void append_bytes(std::string& out, Integers... values) {
    const auto append = [&](auto value) { out.append(reinterpret_cast<const char*>(&value), sizeof value); };
    (append(values), ...);
}

} // namespace detail

template <class T>
void NpzWriter::add(std::string_view key, Span<const T> data, const Shape& shape) {
    check_size("NpzWriter::add", key, data.size(), detail::element_count(shape), "the shape says so");
    add_member(key, detail::npy_header_bytes(detail::npy_dtype<T>(), shape), data.data(), data.size() * sizeof(T));
}

inline void NpzWriter::add_text(std::string_view key, std::string_view text) {
    std::string codes = detail::utf8_to_utf32(text);
    if (codes.empty()) codes.resize(4, '\0'); // NumPy does not support text of width 0
    add_member(key, detail::npy_header_bytes("<U" + std::to_string(codes.size() / 4), {}), codes.data(), codes.size());
}

inline void NpzWriter::add_texts(std::string_view key, const std::vector<std::string>& texts) {
    std::vector<std::string> rows;
    std::size_t longest = 4;
    for (const auto& text : texts) {
        rows.push_back(detail::utf8_to_utf32(text));
        longest = std::max(longest, rows.back().size());
    }
    std::string codes;
    for (auto& row : rows) codes += (row.resize(longest, '\0'), row);
    add_member(key, detail::npy_header_bytes("<U" + std::to_string(longest / 4), {texts.size()}), codes.data(),
               codes.size());
}

inline void NpzWriter::add_member(std::string_view key, const std::string& header, const void* data, std::size_t size) {
    const std::string name = std::string(key) + ".npy";
    if (std::find(names_.begin(), names_.end(), name) != names_.end())
        throw ValueError(file_.path().string() + ": " + std::string(key) + " is added twice");
    names_.push_back(name);
    constexpr std::size_t limit = 0xFFFFFFFFu - (1u << 20); // leaves room for the directory
    const std::size_t offset = file_.size(), total = header.size() + size;
    if (total > limit || offset + total > limit)
        throw IoError(file_.path().string() + ": " + std::string(key) +
                      " makes it larger than 4 GiB, the most that we write");

    Crc32 crc;
    crc.add(header.data(), header.size());
    crc.add(data, size);

    std::string packed;
    if (packing_ == Packing::deflated)
        packed = gsh::deflated(header + std::string(static_cast<const char*>(data), size));
    constexpr std::uint16_t version = 20, utf8_flag = 1 << 11, no_time = 0, first_day = 1 << 5 | 1; // 1980-01-01
    const std::uint16_t method = packing_ == Packing::deflated ? 8 : 0;
    const auto bytes = static_cast<std::uint32_t>(total),
               packed_bytes = packing_ == Packing::deflated ? static_cast<std::uint32_t>(packed.size()) : bytes;
    std::string common;
    detail::append_bytes(common, version, utf8_flag, method, no_time, first_day, crc.value(), packed_bytes, bytes,
                         static_cast<std::uint16_t>(name.size()), std::uint16_t(0));
    file_.write(std::string("PK\x03\x04", 4) + common + name);
    if (packing_ == Packing::deflated) {
        file_.write(packed);
    } else {
        file_.write(header);
        file_.write(data, size);
    }

    directory_.append("PK\x01\x02", 4);
    detail::append_bytes(directory_, version);
    directory_ += common;
    detail::append_bytes(directory_, std::uint16_t(0), std::uint16_t(0), std::uint16_t(0), std::uint32_t(0),
                         static_cast<std::uint32_t>(offset));
    directory_ += name;
}

inline void NpzWriter::commit(const std::filesystem::path& keep) {
    const auto offset = static_cast<std::uint32_t>(file_.size());
    const auto count = static_cast<std::uint16_t>(names_.size());
    std::string end("PK\x05\x06", 4);
    detail::append_bytes(end, std::uint16_t(0), std::uint16_t(0), count, count,
                         static_cast<std::uint32_t>(directory_.size()), offset, std::uint16_t(0));
    file_.write(directory_);
    file_.write(end);
    file_.commit(Sync::disk, keep);
}

} // namespace gsh
