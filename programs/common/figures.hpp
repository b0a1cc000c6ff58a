// SPDX-License-Identifier: Apache-2.0
/// @file  Figures as text and as JSON.
#pragma once

#include "common/backend_option.hpp"

#include <gsh/core/message.hpp>
#include <gsh/train/evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::programs {

class Machine;

using Json = nlohmann::ordered_json;

/// Names of the regions with figures of their own, in the order of ImageScore::regions.
std::vector<std::string> region_names();

/// The number, or null for infinity (the PSNR of equal images) and NaN (a mean without images), which JSON lacks.
Json number_or_null(double value);

using gsh::detail::fixed;
using gsh::detail::frames_text;

/// Figures of one of several people: of one image, or their mean.
template <class Score>
Json person_json(const Score& whole, const std::vector<Score>& regions) {
    Json json{{"psnr_person", number_or_null(whole.psnr)}, {"ssim_person", number_or_null(whole.ssim)}};
    for (std::size_t r = 0; r < regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(regions[r].psnr);
    return json;
}

/// "812 MiB".
std::string mebibytes(std::uint64_t bytes);

/// Adds `peak_memory_bytes` and, for a GPU, `device_peak_memory_bytes`.
void add_memory(Json& json, const Machine& machine);

/// Adds `threads`, `backend`, `precision`, `instruction_set` if it is known and, for a GPU, `device`.
void add_machine(Json& json, const ComputedOn& computed_on);

/// Figures of one image.
Json score_json(const ImageScore& score);

/// Means over the test images that show one kind of motion.
struct MotionFigures {
    std::size_t images = 0;
    ImageScore mean = {};
    std::vector<double> regions = {}; ///< mean PSNR in the order of region_names(), dB; NaN where no image shows one
};

/// Figures of a run with --hold-out-motion: of motion that was trained on, and of motion that was not.
struct SeenAndNew {
    MotionFigures seen, unseen;
};

/// Means of the two kinds of motion. `scores` are those of all test photographs, in their order.
SeenAndNew seen_and_new(const std::vector<ImageScore>& scores, const MotionSplit& split);

/// The kind of motion that a test photograph shows: "seen", "new", or "neither".
std::string motion_word(const MotionSplit& split, std::size_t photo);

Json motion_json(const MotionFigures& figures);

/// The headings of a table with means in it, and a row's cells. All figures but SSIM and LPIPS are in dB.
std::vector<std::string> figure_headings(bool lpips);
std::vector<std::string> figure_cells(const ImageScore& mean, const std::vector<double>& regions, bool lpips);

/// Two rows, seen motion and new motion, below their heading.
std::vector<std::vector<std::string>> motion_rows(const SeenAndNew& figures);

/// Writes JSON to a file. Bytes that are not UTF-8, as in names of files and folders, are replaced.
void write_json(const std::filesystem::path& path, const Json& json);

} // namespace gsh::programs
