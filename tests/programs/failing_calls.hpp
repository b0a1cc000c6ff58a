// SPDX-License-Identifier: Apache-2.0
/// @file  Runs programs whose calls to the system fail (tests/failures/failing_calls.cpp), and looks at what they leave.
#pragma once

#include "programs/process.hpp"

#include <gsh/io/file/input_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace gsh::test {

/// Whether tests run in their long form: where the variable GSH_ALL_FAILURES is set.
inline bool all_failures() {
    return std::getenv("GSH_ALL_FAILURES") != nullptr;
}

/// A call to the system that fails.
struct FailingCall {
    std::string kind;       ///< "open", "read", "write", "fsync", "rename", "mkdir", "close", "thread", "memory", "clock"
    std::size_t at = 0;     ///< the n-th; 0: none
    int error = 0;          ///< errno; 0 for a write of one byte only; or one of those below
    bool and_later = false; ///< all after it, too

    // The call is made, but before it another process changes what it is about.
    static constexpr int file_is_cut = -1;     ///< the file loses the second half of its bytes
    static constexpr int file_is_changed = -2; ///< all of its bytes are others
    static constexpr int out_vanishes = -3;    ///< the folder out/ gets another name

    [[nodiscard]] std::string text() const {
        return kind + " " + std::to_string(at) + (and_later ? "+" : "") + " with error " + std::to_string(error);
    }
};

/// A call that was recorded.
struct RecordedCall {
    std::string kind, path, second;
    bool failed = false;
};

/// A program's outcome, and its calls about files below a folder.
struct CalledOutcome {
    Outcome outcome;
    std::vector<RecordedCall> calls;

    [[nodiscard]] bool one_failed() const {
        return std::any_of(calls.begin(), calls.end(), [](const RecordedCall& call) { return call.failed; });
    }
    /// With FailingCall::kind "memory": how many allocations the program made.
    [[nodiscard]] std::size_t allocations() const {
        for (const RecordedCall& call : calls)
            if (call.kind == "allocations") return std::stoul(call.path);
        return 0;
    }
    [[nodiscard]] std::size_t count(const std::string& kind) const {
        return static_cast<std::size_t>(
            std::count_if(calls.begin(), calls.end(), [&](const RecordedCall& call) { return call.kind == kind; }));
    }
};

/// Lets calls about files below `folder` fail in `program`, if it is started while this exists.
class FailingSystem {
public:
    FailingSystem(const std::string& program, const std::filesystem::path& folder, const FailingCall& failing)
        : under_("GSH_FAIL_UNDER", folder.string()), in_("GSH_FAIL_IN", program),
          log_("GSH_CALLS_LOG", (records_ / "calls").string()), call_("GSH_FAIL_CALL", failing.kind),
          at_("GSH_FAIL_AT", std::to_string(failing.at) + (failing.and_later ? "+" : "")),
          with_("GSH_FAIL_WITH", std::to_string(failing.error)) {}

    /// What was called so far.
    [[nodiscard]] std::vector<RecordedCall> calls() const {
        std::vector<RecordedCall> calls;
        if (!std::filesystem::exists(records_ / "calls")) return calls;
        std::istringstream lines(read_file(records_ / "calls"));
        for (std::string line; std::getline(lines, line);) {
            std::istringstream fields(line);
            RecordedCall recorded;
            std::getline(fields, recorded.kind, '\t');
            std::getline(fields, recorded.path, '\t');
            for (std::string field; std::getline(fields, field, '\t');)
                field == "!" ? void(recorded.failed = true) : void(recorded.second = field);
            calls.push_back(recorded);
        }
        return calls;
    }

private:
    Temporary records_;
    Variable library_{"LD_PRELOAD", GSH_FAILING_CALLS}, under_, in_, log_, call_, at_, with_;
};

/// Runs a program in which a call about a file below `folder` fails.
inline CalledOutcome run_failing(const std::vector<std::string>& words, const std::filesystem::path& folder,
                                 const FailingCall& failing) {
    const FailingSystem system(words[0], folder, failing);
    CalledOutcome result{run(words), {}};
    result.calls = system.calls();
    return result;
}

/// The files below a folder with their contents, and the folders, with a slash at the end and no content.
using FolderState = std::map<std::string, std::string>;
inline FolderState state_of(const std::filesystem::path& folder) {
    FolderState state;
    if (!std::filesystem::exists(folder)) return state;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
        const std::string name = std::filesystem::relative(entry.path(), folder).string();
        entry.is_directory() ? void(state[name + "/"]) : void(state[name] = read_file(entry.path()));
    }
    return state;
}
/// Makes a folder what it was.
inline void restore(const std::filesystem::path& folder, const FolderState& state) {
    std::filesystem::remove_all(folder);
    for (const auto& [name, content] : state) {
        const std::filesystem::path path = folder / name;
        std::filesystem::create_directories(name.ends_with("/") ? path : path.parent_path());
        if (!name.ends_with("/")) write_file(path, content, Sync::none);
    }
}

/// Breaks of the rules by which a power failure leaves old files or new ones, whole; empty if there are none.
///
/// - A file below the folder is renamed into place only when its contents are synced, and no byte is written after.
/// - After the last rename into a folder, that folder is synced.
/// - No file in place is opened for writing: only NAME.partial, files in NAME.partial/, and locks are.
/// Files in a folder *.partial/ may be renamed at will: nobody reads them there.
inline std::vector<std::string> order_faults(const std::vector<RecordedCall>& calls) {
    const auto in_partial = [](const std::string& path) { return path.find(".partial/") != std::string::npos; };
    std::set<std::string> unsynced, unsynced_folders;
    std::vector<std::string> faults;
    const auto parent = [](const std::string& path) { return std::filesystem::path(path).parent_path().string(); };
    for (const RecordedCall& call : calls) {
        if (call.kind == "write") {
            unsynced.insert(call.path);
            const bool temporary = call.path.ends_with(".partial") || in_partial(call.path) ||
                                   call.path.ends_with("-lock") || call.path.ends_with(".lock");
            if (!temporary) faults.push_back("written in place: " + call.path);
        }
        if (call.kind == "fsync") unsynced.erase(call.path), unsynced_folders.erase(call.path);
        if (call.kind != "rename" || call.failed) continue;
        if (in_partial(call.second)) { // the contents keep their state under the new name
            if (unsynced.erase(call.path) > 0) unsynced.insert(call.second);
            continue;
        }
        if (unsynced.erase(call.path) > 0) faults.push_back("renamed before it was synced: " + call.second);
        for (const std::string& path : unsynced) // a folder takes its files along
            if (path.starts_with(call.path + "/")) faults.push_back("renamed with its folder, not synced: " + path);
        unsynced_folders.insert(parent(call.second));
    }
    for (const std::string& folder : unsynced_folders) faults.push_back("a rename is not synced: " + folder);
    return faults;
}

} // namespace gsh::test
