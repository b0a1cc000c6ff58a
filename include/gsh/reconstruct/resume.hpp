// SPDX-License-Identifier: Apache-2.0
/// @file  Stores a reconstruction in the middle of its training, and goes on from there with the same bits.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/reconstruct/any_reconstruction.hpp>
#include <gsh/reconstruct/training_record.hpp>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace gsh {

/// Writes a checkpoint: the state of the training, its record, and `words` of the caller, which checkpoint_words
/// returns. The file is complete or not there at all. The checkpoint that it replaces is kept at
/// checkpoint_before(path).
inline void save_checkpoint(const std::filesystem::path& path, AnyReconstruction& reconstruction,
                            const TrainingRecord& record, const std::string& words = {});

/// Where the checkpoint before the last one is: checkpoint.before.gsh beside checkpoint.gsh.
[[nodiscard]] inline std::filesystem::path checkpoint_before(const std::filesystem::path& path) {
    return path.parent_path() / (path.stem().string() + ".before" + path.extension().string());
}

/// Whether there is a checkpoint at `path`, or the one before it.
[[nodiscard]] inline bool has_checkpoint(const std::filesystem::path& path);

/// The checkpoint to go on from: `path`, or the one before it if that file is missing or damaged. `damage` becomes a
/// sentence about it then, and is empty otherwise. The checksums of the whole file are compared.
/// Errors  IoError about `path` if neither is whole.
[[nodiscard]] inline std::filesystem::path whole_checkpoint(const std::filesystem::path& path, std::string& damage);

/// Removes the checkpoint, and the one before it.
inline void remove_checkpoints(const std::filesystem::path& path);

/// The words of the caller that wrote a checkpoint; empty if there are none.
/// Errors  IoError if there is no such file; those of the file.
[[nodiscard]] inline std::string checkpoint_words(const std::filesystem::path& path);

/// Checks that a checkpoint belongs to a run (run_text), except for the number of Gaussians, which is not known before
/// they are placed. `advice` is the end of the message.
/// Errors  as for load_checkpoint.
inline void check_checkpoint(const std::filesystem::path& path, const std::string& run, std::string_view advice = {});

/// Checks that a checkpoint belongs to the run of a setup, with as many Gaussians. `advice` is the end of the message.
/// Errors  as for load_checkpoint.
inline void check_checkpoint(const std::filesystem::path& path, const ReconstructionSetup& setup,
                             std::string_view advice = {});

/// Brings a reconstruction that was made of the same input and recipe to the state of a checkpoint, of any backend, and
/// returns the record. `advice` is the end of the message about another run.
/// Errors  IoError if there is no such file; ValueError for a checkpoint of another recipe or of other people; else
///         those of the file.
[[nodiscard]] inline TrainingRecord load_checkpoint(const std::filesystem::path& path,
                                                    AnyReconstruction& reconstruction, std::string_view advice = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// What a checkpoint belongs to, one item per line: the run, and the number of Gaussians that it uses.
inline std::string checkpoint_text(const ReconstructionSetup& setup) {
    return setup.run + "gaussians = " + std::to_string(setup.gaussian_count()) + "\n";
}

/// `there` with its settings ("rate.sh = 0.002") in the order in which `here` lists them, because a run does not depend
/// on it.
inline std::string in_order_of(const std::string& here, const std::string& there) {
    const auto key_of = [](const std::string& line) { return line.substr(0, line.find(" = ")); };
    const auto is_setting = [&](const std::string& line) { return key_of(line) != line; };
    std::map<std::string, std::string> settings;
    std::deque<std::string> others;
    std::string line, result;
    for (std::istringstream lines(there); std::getline(lines, line);)
        if (is_setting(line)) settings[key_of(line)] = line;
        else others.push_back(line);
    for (std::istringstream lines(here); std::getline(lines, line);)
        if (!is_setting(line)) {
            if (others.empty()) continue;
            result += others.front() + "\n";
            others.pop_front();
        } else if (const auto same = settings.find(key_of(line)); same != settings.end()) {
            result += same->second + "\n";
            settings.erase(same);
        }
    for (const std::string& other : others) result += other + "\n";
    for (const auto& [key, setting] : settings) result += setting + "\n";
    return result;
}

/// A message with the first line in which two texts differ.
inline std::string difference(const std::string& there, const std::string& here) {
    std::istringstream a(there), b(here);
    std::string of_a, of_b;
    do {
        if (!std::getline(a, of_a)) of_a = "nothing";
        if (!std::getline(b, of_b)) of_b = "nothing";
    } while (of_a == of_b && (a || b));
    return "it has '" + of_a + "' where this run has '" + of_b + "'";
}

inline ArchiveReader open_checkpoint(const std::filesystem::path& path) {
    std::error_code ignored;
    if (!std::filesystem::exists(path, ignored))
        throw IoError(path.string() + ": there is no checkpoint to go on from");
    return ArchiveReader(path, "checkpoint", checkpoint_version);
}

/// Errors  IoError for a file that is not a whole checkpoint.
inline void check_whole(const std::filesystem::path& path) {
    open_checkpoint(path).file().check_all();
}

inline void check_run(const std::filesystem::path& path, const std::string& there, const std::string& here,
                      std::string_view advice) {
    const std::string ordered = in_order_of(here, there);
    check_value(ordered == here, path.string(),
                "belongs to a different run: " + difference(ordered, here) + std::string(advice));
}

} // namespace detail

inline void save_checkpoint(const std::filesystem::path& path, AnyReconstruction& reconstruction,
                            const TrainingRecord& record, const std::string& words) {
    ArchiveWriter file(path, "checkpoint", checkpoint_version);
    reconstruction.save(file);
    file.add_text("configuration", detail::checkpoint_text(reconstruction.setup));
    if (!words.empty()) file.add_text("options", words);
    file.add("seconds", record.seconds);
    file.add("interval", record.interval);
    const auto add_curve = [&](const char* key, const auto& curve) {
        std::vector<double> numbers;
        for (const auto& [step, value] : curve) numbers.insert(numbers.end(), {step, value});
        file.add(key, numbers, {curve.size(), 2});
    };
    add_curve("loss", record.loss);
    add_curve("psnr", record.psnr);
    file.add("stage_seconds", std::vector<double>(record.stage_seconds.begin(), record.stage_seconds.end()));
    file.add("timed_steps", record.timed_steps);
    file.commit(checkpoint_before(path));
}

inline bool has_checkpoint(const std::filesystem::path& path) {
    std::error_code ignored;
    return std::filesystem::exists(path, ignored) || std::filesystem::exists(checkpoint_before(path), ignored);
}

inline std::filesystem::path whole_checkpoint(const std::filesystem::path& path, std::string& damage) {
    damage.clear();
    try {
        detail::check_whole(path);
        return path;
    } catch (const IoError& error) {
        const std::filesystem::path before = checkpoint_before(path);
        try {
            detail::check_whole(before);
        } catch (const IoError&) {
            throw error;
        }
        damage = std::string(error.what()) + "; the run goes on from the checkpoint before it, " +
                 before.filename().string();
        return before;
    }
}

inline void remove_checkpoints(const std::filesystem::path& path) {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
    std::filesystem::remove(checkpoint_before(path), ignored);
}

inline std::string checkpoint_words(const std::filesystem::path& path) {
    const ArchiveReader file = detail::open_checkpoint(path);
    return file.has("options") ? file.read_text("options") : std::string();
}

inline void check_checkpoint(const std::filesystem::path& path, const std::string& run, std::string_view advice) {
    std::string there = detail::open_checkpoint(path).read_text("configuration");
    if (const std::size_t line = there.rfind("gaussians = "); line != std::string::npos) there.resize(line);
    detail::check_run(path, there, run, advice);
}

inline void check_checkpoint(const std::filesystem::path& path, const ReconstructionSetup& setup,
                             std::string_view advice) {
    detail::check_run(path, detail::open_checkpoint(path).read_text("configuration"), detail::checkpoint_text(setup),
                      advice);
}

inline TrainingRecord load_checkpoint(const std::filesystem::path& path, AnyReconstruction& reconstruction,
                                      std::string_view advice) {
    check_checkpoint(path, reconstruction.setup, advice);
    const ArchiveReader file = detail::open_checkpoint(path);
    reconstruction.load(file);
    TrainingRecord record;
    record.steps = reconstruction.step_count();
    record.seconds = file.read_number<double>("seconds");
    record.interval = file.read_number<std::uint64_t>("interval");
    const auto read_curve = [&](const char* key, auto& curve) {
        const auto numbers = file.read<double>(key);
        for (std::size_t i = 0; i + 1 < numbers.size(); i += 2) curve.emplace_back(numbers[i], numbers[i + 1]);
    };
    read_curve("loss", record.loss);
    read_curve("psnr", record.psnr);
    if (!file.has("stage_seconds")) return record; // a file of an older version
    const auto stages = file.read<double>("stage_seconds");
    check_size(path.string(), "stage_seconds", stages.size(), record.stage_seconds.size());
    for (std::size_t s = 0; s < stages.size(); ++s) record.stage_seconds[s] = stages[s];
    record.timed_steps = file.read_number<std::uint64_t>("timed_steps");
    return record;
}

} // namespace gsh
