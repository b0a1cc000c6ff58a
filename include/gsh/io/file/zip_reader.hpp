// SPDX-License-Identifier: Apache-2.0
/// @file  Reads members of zip archives, with bounds on the memory that they may ask for.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/claimed_size.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>

#include <zip.h>

#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Opens an archive, and inflates a member only when it is read.
///
/// Errors  IoError for a file that is missing, no zip archive, damaged or truncated, and for members that claim more
///         than the limits; std::bad_alloc where libzip has no memory.
class ZipReader {
public:
    struct Limits {
        std::size_t member_bytes = std::size_t(1) << 30; ///< per member, inflated
        std::size_t ratio = detail::most_inflation;      ///< inflated to deflated, for members above ratio_free_bytes
        std::size_t ratio_free_bytes = detail::unquestioned_memory;
    };
    /// What the file should be, for messages: "an .npz archive", and its family as in foreign_file.hpp.
    struct Kind {
        std::string name = "a zip archive", family = {};
    };

    /// A member that is being read. It must not outlive the archive.
    class Member {
    public:
        [[nodiscard]] std::size_t size() const { return size_; }
        /// Reads up to `size` bytes; 0 at the end.
        std::size_t read(void* data, std::size_t size) {
            const zip_int64_t count = zip_fread(file_.get(), data, size);
            if (count < 0) {
                if (zip_error_code_zip(zip_file_get_error(file_.get())) == ZIP_ER_MEMORY) throw std::bad_alloc();
                throw IoError(what_ + " is damaged: " + zip_file_strerror(file_.get()));
            }
            return static_cast<std::size_t>(count);
        }
        /// Checks that the member ends here; libzip then compares its checksum.
        void finish() {
            char more = 0;
            if (read(&more, 1) != 0) throw IoError(what_ + " is damaged: it is longer than it claims");
        }

    private:
        friend class ZipReader;
        struct Close {
            void operator()(zip_file_t* file) const { zip_fclose(file); }
        };
        std::unique_ptr<zip_file_t, Close> file_;
        std::size_t size_ = 0;
        std::string what_;
    };

    ZipReader(InputFile input, const Kind& kind, const Limits& limits);

    [[nodiscard]] const std::filesystem::path& path() const { return input_.path(); }
    [[nodiscard]] const InputFile& input() const { return input_; }
    /// Bytes of the archive.
    [[nodiscard]] std::size_t size() const { return size_; }
    /// All members in the order of the archive.
    [[nodiscard]] std::vector<std::string> names() const;
    /// The index of a member, or -1.
    [[nodiscard]] zip_int64_t locate(const std::string& name) const {
        const zip_int64_t index = zip_name_locate(archive_.get(), name.c_str(), 0);
        if (index < 0 && zip_error_code_zip(zip_get_error(archive_.get())) == ZIP_ER_MEMORY) throw std::bad_alloc();
        return index;
    }
    /// `what` names the member in messages.
    [[nodiscard]] Member open(zip_int64_t index, const std::string& what) const;

private:
    struct Discard {
        void operator()(zip_t* archive) const { zip_discard(archive); }
    };

    InputFile input_;
    Limits limits_;
    std::size_t size_ = 0;
    std::unique_ptr<zip_t, Discard> archive_;
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

/// Null if the archive cannot be opened; `code` is then libzip's.
inline zip_t* open_zip(const InputFile& input, int& code) {
    if (!input.contents()) return zip_open(input.path().c_str(), ZIP_RDONLY, &code);
    zip_error_t error;
    zip_error_init(&error);
    zip_source_t* source = zip_source_buffer_create(input.contents()->data(), input.contents()->size(), 0, &error);
    zip_t* const archive = source ? zip_open_from_source(source, ZIP_RDONLY, &error) : nullptr;
    if (!archive) {
        code = zip_error_code_zip(&error);
        zip_source_free(source);
    }
    zip_error_fini(&error);
    return archive;
}

} // namespace detail

inline ZipReader::ZipReader(InputFile input, const Kind& kind, const Limits& limits)
    : input_(std::move(input)), limits_(limits) {
    const std::string name = input_.name();
    if (input_.is_folder()) throw IoError(name + ": is a directory, expected " + kind.name);
    check_no_pipe(input_);
    int code = 0;
    errno = 0;
    archive_.reset(detail::open_zip(input_, code));
    if (!archive_) {
        if (code == ZIP_ER_MEMORY || errno == ENOMEM) throw std::bad_alloc(); // the file is not at fault
        const bool no_zip = code == ZIP_ER_NOZIP || code == ZIP_ER_INCONS;
        if (!no_zip) throw IoError(name + ": cannot be opened: " + detail::zip_error_text(code));
        throw IoError(name + ": " +
                      not_the_kind(input_, kind.name, kind.family,
                                   "cannot be opened: not " + kind.name + (kind.family.empty() ? "" : " (zip)") +
                                       ", or a truncated one"));
    }
    std::error_code error;
    const auto size = input_.contents() ? input_.contents()->size() : std::filesystem::file_size(input_.path(), error);
    size_ = error ? 0 : static_cast<std::size_t>(size);
}

inline std::vector<std::string> ZipReader::names() const {
    std::vector<std::string> names;
    const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
    for (zip_int64_t i = 0; i < count; ++i) {
        const char* name = zip_get_name(archive_.get(), static_cast<zip_uint64_t>(i), ZIP_FL_ENC_GUESS);
        names.emplace_back(name ? name : "");
    }
    return names;
}

inline ZipReader::Member ZipReader::open(zip_int64_t index, const std::string& what) const {
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
    member.what_ = what;
    member.size_ = stat.size;
    member.file_.reset(zip_fopen_index(archive_.get(), static_cast<zip_uint64_t>(index), 0));
    if (!member.file_) {
        if (zip_error_code_zip(zip_get_error(archive_.get())) == ZIP_ER_MEMORY) throw std::bad_alloc();
        throw IoError(what + " cannot be read: " + zip_strerror(archive_.get()));
    }
    return member;
}

} // namespace gsh
