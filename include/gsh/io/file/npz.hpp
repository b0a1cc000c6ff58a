// SPDX-License-Identifier: Apache-2.0
/// @file  NumPy's archives, .npz: named arrays in one zip file.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/crc32.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/file/utf.hpp>

#include <zip.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// Reads members by name; stored or deflated, C or Fortran order, .npy versions 1 to 3.
///
/// A member is inflated only when it is read, and memory is allocated only after its header agrees with its size. A
/// pickled member is an error only if its numbers are read.
///
/// Errors  those of read_npy; each message begins with the file and names the key.
class NpzReader {
public:
    /// Limits on allocation. Members of real body models stay below 200 MiB. Weights and regressors, sparse but stored
    /// densely, inflate 150 times and are small.
    struct Limits {
        std::size_t member_bytes = std::size_t(1) << 30; ///< per member, inflated, and again as read
        std::size_t ratio = 200;                         ///< inflated to deflated, for members above ratio_free_bytes
        std::size_t ratio_free_bytes = std::size_t(64) << 20;
    };

    explicit NpzReader(std::filesystem::path path) : NpzReader(std::move(path), Limits()) {}
    NpzReader(std::filesystem::path path, Limits limits);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
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
    [[nodiscard]] std::string name_of(std::string_view key) const { return path_.string() + ": " + std::string(key); }

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
    std::unique_ptr<zip_t, Discard> archive_;

    [[nodiscard]] zip_int64_t locate(std::string_view key) const;
    [[nodiscard]] Member open(std::string_view key) const;
    void finish(Member& member, const std::string& what) const;
    void check_budget(const NpyHeader& header, std::size_t width, const std::string& what) const;
    template <class T>
    NpyArray<T> read_checked(std::string_view key, const Span<const std::int64_t>* pattern, Numbers numbers) const;
};

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

    void commit();

private:
    AtomicFile file_;
    Packing packing_;
    std::string directory_; // central directory so far
    std::vector<std::string> names_;

    void add_member(std::string_view key, const std::string& header, const void* data, std::size_t size);
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

/// Appends integers in little-endian order.
template <class... Integers>
void append_bytes(std::string& out, Integers... values) {
    const auto append = [&](auto value) { out.append(reinterpret_cast<const char*>(&value), sizeof value); };
    (append(values), ...);
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
        throw IoError(name + ": cannot be opened: " +
                      (no_zip ? "not an .npz (zip) archive, or a truncated one" : detail::zip_error_text(code)));
    }
    if (zip_get_num_entries(archive_.get(), 0) <= 0)
        throw IoError(name + ": is empty, expected an .npz archive of arrays");
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
        std::string known;
        for (const auto& name : keys()) known += (known.empty() ? "" : ", ") + name;
        if (known.size() > 300) known = known.substr(0, 300) + " ...";
        throw IoError(what + " is missing; the file holds: " + (known.empty() ? "no arrays" : known));
    }
    zip_stat_t stat;
    constexpr zip_uint64_t wanted = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE;
    if (zip_stat_index(archive_.get(), static_cast<zip_uint64_t>(index), 0, &stat) != 0 ||
        (stat.valid & wanted) != wanted)
        throw IoError(what + " is damaged: its size is not known");
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
    const std::size_t count = detail::element_count(found.shape), length = found.width / 4;
    std::vector<std::uint32_t> codes(count * length);
    detail::read_exactly(member.source, codes.data(), codes.size() * 4, what);
    finish(member, what);
    std::vector<std::string> texts;
    for (std::size_t i = 0; i < count; ++i) texts.push_back(detail::utf32_to_utf8(codes.data() + i * length, length));
    return texts;
}

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

inline void NpzWriter::commit() {
    const auto offset = static_cast<std::uint32_t>(file_.size());
    const auto count = static_cast<std::uint16_t>(names_.size());
    std::string end("PK\x05\x06", 4);
    detail::append_bytes(end, std::uint16_t(0), std::uint16_t(0), count, count,
                         static_cast<std::uint32_t>(directory_.size()), offset, std::uint16_t(0));
    file_.write(directory_);
    file_.write(end);
    file_.commit();
}

} // namespace gsh
