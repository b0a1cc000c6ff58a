// SPDX-License-Identifier: Apache-2.0
/// @file  Reads NumPy's archives, .npz: named arrays in one zip file.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/utf.hpp>

#include <zip.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
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
    /// Limits on allocation. Members of real body models stay below 200 MiB. Weights and regressors, sparse but stored
    /// densely, inflate 150 times and are small.
    struct Limits {
        std::size_t member_bytes = std::size_t(1) << 30; ///< per member, inflated, and again as read
        std::size_t ratio = detail::most_inflation;      ///< inflated to deflated, for members above ratio_free_bytes
        std::size_t ratio_free_bytes = detail::unquestioned_memory;
    };

    explicit NpzReader(std::filesystem::path path) : NpzReader(std::move(path), Limits()) {}
    NpzReader(std::filesystem::path path, Limits limits);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    /// Bytes of the archive.
    [[nodiscard]] std::size_t size() const { return size_; }
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
        return path_.string() + ": " + detail::shortened(key);
    }

private:
    struct Discard {
        void operator()(zip_t* archive) const { zip_discard(archive); }
    };
    struct CloseMember {
        void operator()(zip_file_t* file) const { zip_fclose(file); }
    };
    struct Member {
        std::unique_ptr<zip_file_t, CloseMember> file;
        std::size_t size = 0;
        detail::ByteSource source;
    };

    std::filesystem::path path_;
    Limits limits_;
    std::size_t size_ = 0;
    std::unique_ptr<zip_t, Discard> archive_;

    [[nodiscard]] zip_int64_t locate(std::string_view key) const;
    [[nodiscard]] Member open(std::string_view key) const;
    void finish(Member& member, const std::string& what) const;
    void check_budget(const NpyHeader& header, std::size_t width, const std::string& what) const;
    template <class T>
    NpyArray<T> read_checked(std::string_view key, const Span<const std::int64_t>* pattern, Numbers numbers) const;
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline std::string zip_error_text(int code) {
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    std::string text = zip_error_strerror(&error);
    zip_error_fini(&error);
    return text;
}

} // namespace detail

inline NpzReader::NpzReader(std::filesystem::path path, Limits limits) : path_(std::move(path)), limits_(limits) {
    const std::string name = path_.string();
    std::error_code ignored;
    if (std::filesystem::is_directory(path_, ignored)) throw IoError(name + ": is a directory, expected an .npz file");
    int code = 0;
    archive_.reset(zip_open(path_.c_str(), ZIP_RDONLY, &code));
    if (!archive_) {
        const bool no_zip = code == ZIP_ER_NOZIP || code == ZIP_ER_INCONS;
        if (!no_zip) throw IoError(name + ": cannot be opened: " + detail::zip_error_text(code));
        throw IoError(name + ": " +
                      not_the_kind(path_, "an .npz archive", "npz",
                                   "cannot be opened: not an .npz (zip) archive, or a truncated one"));
    }
    const auto size = std::filesystem::file_size(path_, ignored);
    size_ = ignored ? 0 : static_cast<std::size_t>(size);
    if (zip_get_num_entries(archive_.get(), 0) <= 0)
        throw IoError(name + ": is empty, expected an .npz archive of arrays");
    if (keys().empty())
        throw IoError(name + ": " +
                      not_the_kind(path_, "an .npz archive", "npz",
                                   "is a zip archive without arrays (.npy), expected an .npz archive"));
}

inline std::vector<std::string> NpzReader::keys() const {
    std::vector<std::string> names;
    const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
    for (zip_int64_t i = 0; i < count; ++i) {
        const char* name = zip_get_name(archive_.get(), static_cast<zip_uint64_t>(i), ZIP_FL_ENC_GUESS);
        std::string_view key = name ? name : "";
        if (key.ends_with(".npy")) names.emplace_back(key.substr(0, key.size() - 4));
    }
    return names;
}

inline zip_int64_t NpzReader::locate(std::string_view key) const {
    return zip_name_locate(archive_.get(), (std::string(key) + ".npy").c_str(), 0);
}

inline NpzReader::Member NpzReader::open(std::string_view key) const {
    const std::string what = name_of(key);
    const zip_int64_t index = locate(key);
    if (index < 0) {
        bool pickled = true;
        for (const auto& name : keys()) pickled = pickled && !has_array(name);
        throw IoError(what + " is missing; the file holds: " + detail::listed(keys(), "no arrays") +
                      (pickled ? std::string(", pickled; ") + detail::python_page : ""));
    }
    zip_stat_t stat;
    constexpr zip_uint64_t wanted = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE;
    if (zip_stat_index(archive_.get(), static_cast<zip_uint64_t>(index), 0, &stat) != 0 ||
        (stat.valid & wanted) != wanted)
        throw IoError(what + " is damaged: its size is not known");
    if (stat.comp_size > size_) // which libzip does not compare
        throw IoError(what + " is truncated: it claims " + std::to_string(stat.comp_size) + " bytes of the file's " +
                      std::to_string(size_));
    if (stat.size > limits_.member_bytes)
        throw IoError(what + " claims " + std::to_string(stat.size) + " bytes, more than the limit of " +
                      std::to_string(limits_.member_bytes) + "; the file is damaged or made to exhaust memory");
    if (stat.size > limits_.ratio_free_bytes && stat.size / limits_.ratio > stat.comp_size)
        throw IoError(what + " inflates from " + std::to_string(stat.comp_size) + " to " + std::to_string(stat.size) +
                      " bytes, more than " + std::to_string(limits_.ratio) +
                      " times; the file is made to exhaust memory");
    Member member;
    member.size = stat.size;
    member.file.reset(zip_fopen_index(archive_.get(), static_cast<zip_uint64_t>(index), 0));
    if (!member.file) throw IoError(what + " cannot be read: " + zip_strerror(archive_.get()));
    member.source = [file = member.file.get(), what](void* data, std::size_t size) {
        const zip_int64_t count = zip_fread(file, data, size);
        if (count < 0) throw IoError(what + " is damaged: " + zip_file_strerror(file));
        return static_cast<std::size_t>(count);
    };
    return member;
}

inline void NpzReader::finish(Member& member, const std::string& what) const {
    char more = 0;
    if (member.source(&more, 1) != 0) // at the end libzip compares the checksum
        throw IoError(what + " is damaged: it is longer than it claims");
}

inline void NpzReader::check_budget(const NpyHeader& header, std::size_t width, const std::string& what) const {
    std::size_t bytes = 0;
    if (!detail::checked_bytes(header.shape, width, bytes) || bytes > limits_.member_bytes)
        throw IoError(what + " has shape " + detail::shape_text(header.shape) + ", more than the limit of " +
                      std::to_string(limits_.member_bytes) + " bytes in memory");
    if (bytes > limits_.ratio_free_bytes && bytes / limits_.ratio > size_)
        throw IoError(what + " takes " + std::to_string(bytes) + " bytes in memory, more than " +
                      std::to_string(limits_.ratio) + " times the " + std::to_string(size_) +
                      " of the archive; the file is made to exhaust memory");
}

inline NpyHeader NpzReader::header(std::string_view key) const {
    Member member = open(key);
    return detail::read_npy_header(member.source, member.size, name_of(key));
}

inline bool NpzReader::has_array(std::string_view key) const {
    return has(key) && header(key).kind != 'O';
}

template <class T>
NpyArray<T> NpzReader::read_checked(std::string_view key, const Span<const std::int64_t>* pattern,
                                    Numbers numbers) const {
    const std::string what = name_of(key);
    Member member = open(key);
    const NpyHeader found = detail::read_npy_header(member.source, member.size, what);
    detail::check_dtype<T>(found, what, numbers);
    if (pattern) detail::check_shape(what, found.shape, *pattern);
    check_budget(found, sizeof(T), what);
    NpyArray<T> array{found.shape, detail::read_npy_numbers<T>(member.source, found, what, numbers)};
    finish(member, what);
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
    Member member = open(key);
    const NpyHeader found = detail::read_npy_header(member.source, member.size, what);
    if (!found.is_text()) throw IoError(what + " has dtype " + found.dtype + ", expected unicode text");
    check_budget(found, found.width + sizeof(std::string), what);
    const std::size_t count = detail::element_count(found.shape), length = found.width / 4;
    std::vector<std::uint32_t> codes(count * length);
    detail::read_exactly(member.source, codes.data(), codes.size() * 4, what);
    finish(member, what);
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < count; ++i) texts.push_back(detail::utf32_to_utf8(codes.data() + i * length, length));
    return texts;
}

} // namespace gsh
