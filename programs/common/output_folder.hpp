// SPDX-License-Identifier: Apache-2.0
/// @file  An output folder in which either all results of a run appear or none.
#pragma once

#include "common/staged_results.hpp"

#include <gsh/io/file/folder_lock.hpp>

#include <filesystem>
#include <utility>

namespace gsh::programs {

/// A folder for results (StagedResults). Without a commit it is removed, if it was created here and is empty. Programs
/// create it before their work begins: a second one is refused then (LockedFolder).
/// Errors  IoError naming the path that cannot be created or moved, or the process that writes to the folder.
class OutputFolder : private LockedFolder, public StagedResults {
public:
    explicit OutputFolder(std::filesystem::path folder)
        : LockedFolder(std::move(folder)), StagedResults(LockedFolder::path()) {}
};

} // namespace gsh::programs
