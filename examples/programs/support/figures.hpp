// SPDX-License-Identifier: Apache-2.0
/// @file  Figures as text and as JSON.
#pragma once

#include <gsh/train/evaluation.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::examples {

using Json = nlohmann::ordered_json;

/// Names of the regions with figures of their own, in the order of ImageScore::regions.
std::vector<std::string> region_names();

/// The number, or null for infinity (the PSNR of equal images) and NaN (a mean without images), which JSON lacks.
Json number_or_null(double value);

/// "12.35" for 2 digits; "none" for NaN.
std::string fixed(double value, int digits);

/// Figures of one of several people: of one image, or their mean.
template <class Score>
Json person_json(const Score& whole, const std::vector<Score>& regions) {
    Json json{{"psnr_person", number_or_null(whole.psnr)}, {"ssim_person", number_or_null(whole.ssim)}};
    for (std::size_t r = 0; r < regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(regions[r].psnr);
    return json;
}

/// Figures of one image.
Json score_json(const ImageScore& score);

/// Writes JSON to a file. Bytes that are not UTF-8, as in names of files and folders, are replaced.
void write_json(const std::filesystem::path& path, const Json& json);

} // namespace gsh::examples
