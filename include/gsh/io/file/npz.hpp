// SPDX-License-Identifier: Apache-2.0
/// @file  Reads NumPy's archives, .npz: named arrays in one zip file.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/utf.hpp>
#include <gsh/io/file/zip_reader.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads members by name; stored or deflated, C or Fortran order, .npy versions 1 to 3.
///
/// A member is inflated only when it is read, and memory is allocated only after its header agrees with its size. A
/// pickled member is an error only if its numbers are read.
///
/// Errors  those of read_npy; each message begins with the file and names the key. Files of other kinds (pickles,
///         files of PyTorch, …) are named as such.
class NpzReader {
public:
    /// Limits on allocation, for a member inflated, and again as read. Members of real body models stay below 200 MiB.
    /// Weights and regressors, sparse but stored densely, inflate 150 times and are small.
    using Limits = ZipReader::Limits;

    explicit NpzReader(InputFile input) : NpzReader(std::move(input), Limits()) {}
    NpzReader(InputFile input, Limits limits);

    [[nodiscard]] const std::filesystem::path& path() const { return zip_.path(); }
    /// Bytes of the archive.
    [[nodiscard]] std::size_t size() const { return zip_.size(); }
    [[nodiscard]] std::vector<std::string> keys() const;
    [[nodiscard]] bool has(std::string_view key) const { return locate(key) >= 0; }
    /// True for a member that exists and is not pickled; for optional keys.
    [[nodiscard]] bool has_array(std::string_view key) const;
    /// Type and shape, without reading the numbers.
    [[nodiscard]] NpyHeader header(std::string_view key) const;

    template <class T>
    [[nodiscard]] NpyArray<T> read(std::string_view key, Numbers numbers = Numbers::same_kind) const;
    /// The same with a shape check; -1 stands for any length: read<float>("v_template", {-1, 3}).
    template <class T>
    [[nodiscard]] NpyArray<T> read(std::string_view key, std::initializer_list<std::int64_t> pattern,
                                   Numbers numbers = Numbers::same_kind) const;
    /// A single number, stored as () or (1,).
    template <class T>
    [[nodiscard]] T read_number(std::string_view key, Numbers numbers = Numbers::same_kind) const;
    /// An array of unicode texts, or a single one.
    [[nodiscard]] std::vector<std::string> read_texts(std::string_view key) const;

    /// "FILE: key", the prefix of every message about a member.
    [[nodiscard]] std::string name_of(std::string_view key) const {
        return path().string() + ": " + detail::shortened(key);
    }

private:
    Limits limits_;
    ZipReader zip_;

    [[nodiscard]] zip_int64_t locate(std::string_view key) const { return zip_.locate(std::string(key) + ".npy"); }
    [[nodiscard]] ZipReader::Member open(std::string_view key) const;
    /// `member` must outlive the result.
    [[nodiscard]] static detail::ByteSource source_of(ZipReader::Member& member) {
        return [&member](void* data, std::size_t size) { return member.read(data, size); };
    }
    void check_budget(const NpyHeader& header, std::size_t width, const std::string& what) const;
    template <class T>
    NpyArray<T> read_checked(std::string_view key, const Span<const std::int64_t>* pattern, Numbers numbers) const;
};

// -------------------------------------------------------------------------------------------------------------

inline NpzReader::NpzReader(InputFile input, Limits limits)
    : limits_(limits), zip_(std::move(input), {"an .npz archive", "npz"}, limits) {
    const std::string name = zip_.path().string();
    if (zip_.names().empty()) throw IoError(name + ": is empty, expected an .npz archive of arrays");
    if (keys().empty())
        throw IoError(name + ": " +
                      not_the_kind(zip_.input(), "an .npz archive", "npz",
                                   "is a zip archive without arrays (.npy), expected an .npz archive"));
}

inline std::vector<std::string> NpzReader::keys() const {
    std::vector<std::string> keys;
    for (const std::string& name : zip_.names())
        if (name.ends_with(".npy")) keys.push_back(name.substr(0, name.size() - 4));
    return keys;
}

inline ZipReader::Member NpzReader::open(std::string_view key) const {
    const std::string what = name_of(key);
    const zip_int64_t index = locate(key);
    if (index >= 0) return zip_.open(index, what);
    bool pickled = true;
    for (const auto& name : keys()) pickled = pickled && !has_array(name);
    throw IoError(what + " is missing; the file holds: " + detail::listed(keys(), "no arrays") +
                  (pickled ? std::string(", pickled; ") + detail::python_page : ""));
}

inline void NpzReader::check_budget(const NpyHeader& header, std::size_t width, const std::string& what) const {
    std::size_t bytes = 0;
    if (!detail::checked_bytes(header.shape, width, bytes) || bytes > limits_.member_bytes)
        throw IoError(what + " has shape " + detail::shape_text(header.shape) + ", more than the limit of " +
                      std::to_string(limits_.member_bytes) + " bytes in memory");
    if (bytes > limits_.ratio_free_bytes && bytes / limits_.ratio > size())
        throw IoError(what + " takes " + std::to_string(bytes) + " bytes in memory, more than " +
                      std::to_string(limits_.ratio) + " times the " + std::to_string(size()) +
                      " of the archive; the file is made to exhaust memory");
}

inline NpyHeader NpzReader::header(std::string_view key) const {
    ZipReader::Member member = open(key);
    return detail::read_npy_header(source_of(member), member.size(), name_of(key));
}

inline bool NpzReader::has_array(std::string_view key) const {
    return has(key) && header(key).kind != 'O';
}

template <class T>
NpyArray<T> NpzReader::read_checked(std::string_view key, const Span<const std::int64_t>* pattern,
                                    Numbers numbers) const {
    const std::string what = name_of(key);
    ZipReader::Member member = open(key);
    const detail::ByteSource source = source_of(member);
    const NpyHeader found = detail::read_npy_header(source, member.size(), what);
    detail::check_dtype<T>(found, what, numbers);
    if (pattern) detail::check_shape(what, found.shape, *pattern);
    check_budget(found, sizeof(T), what);
    NpyArray<T> array{found.shape, detail::read_npy_numbers<T>(source, found, what, numbers)};
    member.finish();
    return array;
}

template <class T>
NpyArray<T> NpzReader::read(std::string_view key, Numbers numbers) const {
    return read_checked<T>(key, nullptr, numbers);
}

template <class T>
NpyArray<T> NpzReader::read(std::string_view key, std::initializer_list<std::int64_t> pattern, Numbers numbers) const {
    const Span<const std::int64_t> lengths(pattern.begin(), pattern.size());
    return read_checked<T>(key, &lengths, numbers);
}

template <class T>
T NpzReader::read_number(std::string_view key, Numbers numbers) const {
    const Shape shape = header(key).shape;
    if (shape.size() > 1 || detail::element_count(shape) != 1)
        throw ShapeError(name_of(key) + " has shape " + detail::shape_text(shape) + ", expected a single number");
    return read<T>(key, numbers).data[0];
}

inline std::vector<std::string> NpzReader::read_texts(std::string_view key) const {
    const std::string what = name_of(key);
    ZipReader::Member member = open(key);
    const detail::ByteSource source = source_of(member);
    const NpyHeader found = detail::read_npy_header(source, member.size(), what);
    if (!found.is_text()) throw IoError(what + " has dtype " + found.dtype + ", expected unicode text");
    check_budget(found, found.width + sizeof(std::string), what);
    const std::size_t count = detail::element_count(found.shape), length = found.width / 4;
    std::vector<std::uint32_t> codes(count * length);
    detail::read_exactly(source, codes.data(), codes.size() * 4, what);
    member.finish();
    for (const std::uint32_t code : codes)
        if (code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF))
            throw IoError(what + " is damaged: " + std::to_string(code) + " is no character of Unicode");
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < count; ++i) texts.push_back(detail::utf32_to_utf8(codes.data() + i * length, length));
    return texts;
}

} // namespace gsh
