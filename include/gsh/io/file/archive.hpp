// SPDX-License-Identifier: Apache-2.0
/// @file  The library's own .npz archives, which store their kind and format version.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/format_version.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>

#include <cstddef>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Writes an archive of a kind ("avatar", "checkpoint") and version. NumPy opens it like any .npz. The member
/// gsh_format holds "KIND VERSION". The file appears on commit.
class ArchiveWriter : public NpzWriter {
public:
    ArchiveWriter(std::filesystem::path path, std::string_view kind, int version, Packing packing = Packing::stored)
        : NpzWriter(std::move(path), packing) {
        add_text(detail::format_member, std::string(kind) + " " + std::to_string(version));
    }

    /// Adds structs that consist only of T, such as vectors and quaternions, as an array [rows, numbers per row].
    template <class T, class Row>
        requires std::is_trivially_copyable_v<Row> && (sizeof(Row) % sizeof(T) == 0)
    void add_rows(std::string_view key, Span<const Row> rows) {
        constexpr std::size_t width = sizeof(Row) / sizeof(T);
        add<T>(key, Span<const T>(reinterpret_cast<const T*>(rows.data()), rows.size() * width), {rows.size(), width});
    }
    template <class T, class Row>
    void add_rows(std::string_view key, const std::vector<Row>& rows) {
        add_rows<T>(key, Span<const Row>(rows));
    }
};

/// Reads an ArchiveWriter's file, bit for bit: an array is returned in the type in which it was written, including NaN.
///
/// Errors  IoError, naming the file, for a file without gsh_format, of another kind or of another version; those of
///         NpzReader.
class ArchiveReader {
public:
    /// `oldest` is the first version that is read, or 0 for `version` alone.
    ArchiveReader(InputFile input, std::string_view kind, int version, int oldest = 0);

    [[nodiscard]] bool has(std::string_view key) const { return file_.has(key); }
    /// The archive as a plain .npz, for functions that read parts of it.
    [[nodiscard]] const NpzReader& file() const { return file_; }

    template <class T>
    [[nodiscard]] NpyArray<T> read(std::string_view key) const {
        return file_.read<T>(key, Numbers::exact);
    }
    template <class T>
    [[nodiscard]] T read_number(std::string_view key) const {
        return file_.read_number<T>(key, Numbers::exact);
    }
    [[nodiscard]] std::string read_text(std::string_view key) const {
        const auto texts = file_.read_texts(key);
        if (texts.size() != 1)
            throw ShapeError(file_.name_of(key) + " holds " + std::to_string(texts.size()) + " texts, expected one");
        return texts[0];
    }
    /// Reads an array written by add_rows.
    template <class T, class Row>
        requires std::is_trivially_copyable_v<Row> && (sizeof(Row) % sizeof(T) == 0)
    [[nodiscard]] std::vector<Row> read_rows(std::string_view key) const {
        constexpr std::size_t width = sizeof(Row) / sizeof(T);
        const auto array = file_.read<T>(key, {-1, static_cast<std::int64_t>(width)}, Numbers::exact);
        std::vector<Row> rows(array.dim(0));
        if (!rows.empty()) std::memcpy(static_cast<void*>(rows.data()), array.data.data(), rows.size() * sizeof(Row));
        return rows;
    }

private:
    NpzReader file_;
};

/// The kind of an archive ("avatar"); empty for a file that is not an archive of this library.
[[nodiscard]] inline std::string archive_kind(const InputFile& input);

// -------------------------------------------------------------------------------------------------------------

namespace detail {
/// The text of gsh_format, or empty.
inline std::string archive_format(const NpzReader& file) {
    if (!file.has(format_member) || !file.header(format_member).is_text()) return {};
    const auto texts = file.read_texts(format_member);
    return texts.size() == 1 ? texts[0] : std::string();
}

/// Throws unless a file in a layout of SMPL-X programs, which states no kind, is of version 1 (format_member).
inline void check_first_version(const NpzReader& file, std::string_view kind) {
    if (const std::string format = archive_format(file); !format.empty())
        check_format(file.path().string(), format, kind, 1, 1);
}
} // namespace detail

inline ArchiveReader::ArchiveReader(InputFile input, std::string_view kind, int version, int oldest)
    : file_(std::move(input)) {
    const std::string name = file_.path().string(), format = detail::archive_format(file_);
    if (format.empty())
        throw IoError(name + ": is not a gsh file: gsh_format is missing, expected '" + std::string(kind) + " " +
                      std::to_string(version) + "'");
    detail::check_format(name, format, kind, version, oldest ? oldest : version);
}

inline std::string archive_kind(const InputFile& input) {
    const std::string format = detail::archive_format(NpzReader(input));
    return format.substr(0, format.find(' '));
}

} // namespace gsh
