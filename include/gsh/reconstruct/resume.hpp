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
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>
#include <vector>

namespace gsh {

/// Writes a checkpoint: the state of the training, its record, and `words` of the caller, which checkpoint_words
/// returns. The file is complete or not there at all.
inline void save_checkpoint(const std::filesystem::path& path, AnyReconstruction& reconstruction,
                            const TrainingRecord& record, const std::string& words = {});

/// The words of the caller that wrote a checkpoint; empty if there are none.
/// Errors  IoError if there is no such file; those of the file.
[[nodiscard]] inline std::string checkpoint_words(const std::filesystem::path& path);

/// Checks that a checkpoint belongs to a run (run_text), except for the number of Gaussians, which is not known before
/// they are placed. `advice` is the end of the message.
/// Errors  as for load_checkpoint.
inline void check_checkpoint(const std::filesystem::path& path, const std::string& run, std::string_view advice = {});

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

/// A text with its settings ("rate.sh = 0.002") sorted at the end, because a run does not depend on the order in which
/// they are listed.
inline std::string with_sorted_settings(const std::string& text) {
    std::istringstream lines(text);
    std::string others, line;
    std::set<std::string> settings;
    while (std::getline(lines, line))
        if (line.find(" = ") == std::string::npos) others += line + "\n";
        else settings.insert(line);
    for (const std::string& setting : settings) others += setting + "\n";
    return others;
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

inline void check_run(const std::filesystem::path& path, const std::string& there, const std::string& here,
                      std::string_view advice) {
    const std::string of_file = with_sorted_settings(there), of_run = with_sorted_settings(here);
    check_value(of_file == of_run, path.string(),
                "belongs to a different run: " + difference(of_file, of_run) + std::string(advice));
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
    file.commit();
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

inline TrainingRecord load_checkpoint(const std::filesystem::path& path, AnyReconstruction& reconstruction,
                                      std::string_view advice) {
    const ArchiveReader file = detail::open_checkpoint(path);
    detail::check_run(path, file.read_text("configuration"), detail::checkpoint_text(reconstruction.setup), advice);
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
