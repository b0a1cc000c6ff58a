// SPDX-License-Identifier: Apache-2.0
/// @file  The list of good files of every kind that is read. A test damages them. They are also the seeds of the fuzz
///        targets; this writes them anew, folders as zip archives:
///
///            GSH_WRITE_SEEDS=tests/fuzz/corpus build/release/bin/test_io_all_readers --test-case='*seeds*'
#pragma once

#include "support/digest.hpp"

#include <gsh/io/file/input_file.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// A file, or a folder of files, and a reader that accepts it.
struct Sample {
    std::string target;              ///< the fuzz target of the reader
    std::filesystem::path place;     ///< the file or the folder
    std::vector<std::string> damage; ///< of a folder: its files that are damaged one at a time
    /// Reads it, and returns a digest of what was read.
    std::function<std::string(const std::filesystem::path& place)> read;
    bool whole = true; ///< whether the reader accepts it; a network's weights are too large for that
};

/// Samples in a folder, each at TARGET/NAME.
class Samples {
public:
    explicit Samples(std::filesystem::path folder) : folder_(std::move(folder)) {}

    template <class Read>
    std::filesystem::path file(const std::string& target, const std::string& name, Read read, bool whole = true) {
        std::filesystem::create_directories(folder_ / target);
        all.push_back({target, folder_ / target / name, {}, digested(std::move(read)), whole});
        return all.back().place;
    }
    template <class Read>
    std::filesystem::path folder(const std::string& target, const std::string& name, std::vector<std::string> damage,
                                 Read read) {
        std::filesystem::create_directories(folder_ / target / name);
        all.push_back({target, folder_ / target / name, std::move(damage), digested(std::move(read))});
        return all.back().place;
    }
    std::vector<Sample> all;

private:
    std::filesystem::path folder_;

    template <class Read>
    static auto digested(Read read) {
        return [read = std::move(read)](const std::filesystem::path& place) { return Digest::of(read(place)); };
    }
};

/// A file of tests/data/0.1.
inline std::filesystem::path file_of_0_1(const std::string& name) {
    return std::filesystem::path(GSH_SOURCE_DIR) / "tests/data/0.1" / name;
}
inline void copy_of_0_1(const std::string& name, const std::filesystem::path& to) {
    std::filesystem::copy(file_of_0_1(name), to, std::filesystem::copy_options::recursive);
}

} // namespace gsh::test
