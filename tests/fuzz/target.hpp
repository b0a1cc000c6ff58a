// SPDX-License-Identifier: Apache-2.0
/// @file  Fuzz targets: what reads foreign bytes, by name.
#pragma once

#include "fuzz/scratch.hpp"

#include <gsh/io/file/input_file.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace gsh::fuzz {

/// A reader of foreign bytes, and what uses its result. The bytes are a whole file, or an archive of a folder's files.
struct Target {
    /// Also of its corpus and its program: corpus/NAME, fuzz-NAME. Its words are in dictionaries/ENDING.dict, where
    /// ENDING is that of its seeds: npz, json, zip for folders.
    std::string_view name;
    std::string_view file; ///< the name that the bytes are given, whose ending some readers look at; or a folder: "x/"
    /// Returns, or throws gsh::Error whose message begins with the file. Everything else is a fault.
    void (*run)(const InputFile& file);
};

/// All targets in the order of their names.
[[nodiscard]] std::vector<Target>& targets();

/// Adds a target when the program starts.
struct Registered {
    Registered(std::string_view name, std::string_view file, void (*run)(const InputFile& file)) {
        targets().push_back({name, file, run});
    }
};

/// Ends the process, so that the fuzzer keeps the input, unless a property holds: what was accepted must be of use.
inline void must(bool holds, const char* what) {
    if (holds) return;
    std::fprintf(stderr, "fuzz: %s\n", what);
    std::abort();
}

/// Runs a target once on these bytes.
void run_once(const Target& target, std::string_view bytes);

} // namespace gsh::fuzz
