// SPDX-License-Identifier: Apache-2.0
#include "common/figures.hpp"

#include "common/machine.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/reconstruct/judge.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

namespace gsh::programs {

std::vector<std::string> region_names() {
    return {judged_regions.begin(), judged_regions.end()};
}

Json number_or_null(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

std::string mebibytes(std::uint64_t bytes) {
    return fixed(static_cast<double>(bytes) / (1 << 20), 0) + " MiB";
}

void add_memory(Json& json, const Machine& machine) {
    json["peak_memory_bytes"] = peak_memory_bytes();
    if (const auto on_gpu = machine.peak_gpu_memory()) json["device_peak_memory_bytes"] = *on_gpu;
}

void add_machine(Json& json, const ComputedOn& computed_on) {
    json["threads"] = computed_on.threads;
    json["backend"] = computed_on.backend;
    json["precision"] = computed_on.precision;
    if (!computed_on.instruction_set.empty()) json["instruction_set"] = computed_on.instruction_set;
    if (!computed_on.device.empty()) json["device"] = computed_on.device;
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

SeenAndNew seen_and_new(const std::vector<ImageScore>& scores, const MotionSplit& split) {
    const auto figures_of = [&](const std::vector<std::size_t>& photos) {
        std::vector<ImageScore> chosen;
        for (const std::size_t photo : photos) chosen.push_back(scores[photo]);
        MotionFigures figures{.images = chosen.size(), .mean = mean_score(chosen)};
        for (const RegionMean& region : mean_regions(chosen)) figures.regions.push_back(region.psnr);
        figures.regions.resize(region_names().size(), std::numeric_limits<double>::quiet_NaN()); // without images
        return figures;
    };
    return {figures_of(split.seen), figures_of(split.unseen)};
}

std::string motion_word(const MotionSplit& split, std::size_t photo) {
    const auto has = [&](const std::vector<std::size_t>& photos) {
        return std::find(photos.begin(), photos.end(), photo) != photos.end();
    };
    return has(split.seen) ? "seen" : has(split.unseen) ? "new" : "neither";
}

Json motion_json(const MotionFigures& figures) {
    Json json{{"images", figures.images},
              {"psnr", number_or_null(figures.mean.psnr)},
              {"ssim", number_or_null(figures.mean.ssim)},
              {"psnr_person", number_or_null(figures.mean.psnr_person)}};
    for (std::size_t r = 0; r < figures.regions.size(); ++r)
        json["psnr_regions"][region_names()[r]] = number_or_null(figures.regions[r]);
    if (figures.mean.lpips) json["lpips"] = number_or_null(*figures.mean.lpips);
    return json;
}

std::vector<std::string> figure_headings(bool lpips) {
    std::vector<std::string> headings{"PSNR", "SSIM"};
    if (lpips) headings.push_back("LPIPS");
    headings.push_back("person");
    for (const std::string& region : region_names()) headings.push_back(region);
    return headings;
}

std::vector<std::string> figure_cells(const ImageScore& mean, const std::vector<double>& regions, bool lpips) {
    std::vector<std::string> cells{fixed(mean.psnr, 2), fixed(mean.ssim, 4)};
    if (lpips) cells.push_back(fixed(mean.lpips.value_or(std::nan("")), 4));
    cells.push_back(fixed(mean.psnr_person, 2));
    for (const double psnr : regions) cells.push_back(fixed(psnr, 2));
    return cells;
}

std::vector<std::vector<std::string>> motion_rows(const SeenAndNew& figures) {
    const bool lpips = figures.seen.mean.lpips || figures.unseen.mean.lpips;
    std::vector<std::vector<std::string>> rows{{"motion"}, {"seen"}, {"new"}};
    const auto add = [&](std::size_t row, const std::vector<std::string>& cells, const std::string& images) {
        rows[row].insert(rows[row].end(), cells.begin(), cells.end());
        rows[row].push_back(images);
    };
    add(0, figure_headings(lpips), "images");
    add(1, figure_cells(figures.seen.mean, figures.seen.regions, lpips), std::to_string(figures.seen.images));
    add(2, figure_cells(figures.unseen.mean, figures.unseen.regions, lpips), std::to_string(figures.unseen.images));
    return rows;
}

void write_json(const std::filesystem::path& path, const Json& json) {
    write_file(path, json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

} // namespace gsh::programs
