// SPDX-License-Identifier: Apache-2.0
#include "support/figures.hpp"

#include <gsh/io/file/atomic_file.hpp>

#include <cmath>
#include <cstdio>

namespace gsh::examples {

std::vector<std::string> region_names() { return {"face", "hands", "body"}; }

Json number_or_null(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

std::string fixed(double value, int digits) {
    if (std::isnan(value)) return "none";
    char text[32];
    std::snprintf(text, sizeof text, "%.*f", digits, value);
    return text;
}

Json score_json(const ImageScore& score) {
    Json json{{"name", score.name},
              {"psnr", number_or_null(score.psnr)},
              {"ssim", number_or_null(score.ssim)},
              {"psnr_person", number_or_null(score.psnr_person)}};
    for (std::size_t r = 0; r < score.regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(score.regions[r].psnr);
    if (score.lpips) json["lpips"] = number_or_null(*score.lpips);
    for (const PersonScore& person : score.people) json["people"].push_back(person_json(person.whole, person.regions));
    return json;
}

void write_json(const std::filesystem::path& path, const Json& json) {
    write_file(path, json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

} // namespace gsh::examples
