// SPDX-License-Identifier: Apache-2.0
#include "support/judgement.hpp"

#include "support/input_files.hpp"

#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh::examples {

void check_lpips(const std::filesystem::path& weights) { (void)lpips_of_file(weights); }

Judge::Judge(cpu::Threads& backend, const Source& source, const ReconstructOptions& o)
    : backend_(backend), source_(source) {
    for (std::size_t p = 0; p < source.people.size(); ++p) {
        const BodyRegions regions = source.body_regions_of(p);
        regions_.push_back({{"face", regions.face}, {"hands", regions.left_hand}});
        auto& hands = regions_.back()[1].vertices;
        hands.insert(hands.end(), regions.right_hand.begin(), regions.right_hand.end());
    }
    if (!o.lpips.empty())
        lpips_.emplace(backend, lpips_of_file(o.lpips), o.lpips_table ? LpipsScaling::table : LpipsScaling::correct);
}

Judge::~Judge() = default;

Comparison<float> Judge::judge(Comparison<float> comparison, const Photo& photo) {
    const auto render = std::as_const(comparison.render).view(), truth = std::as_const(comparison.truth).view();
    std::vector<RegionLabels> labels = labels_of(photo);
    for (RegionLabels& person : labels)
        for (const UnknownPixel& pixel : photo.unknown)
            if (pixel.hidden) person.labels[pixel.index] = RegionLabels::nothing;
    const auto score = [&](const Image<std::uint8_t>& mask) { return score_region(render, truth, mask.view()); };
    const auto score_regions = [&](const RegionLabels& seen, const auto& person) {
        std::vector<RegionScore> scores;
        for (std::size_t r = 0; r < regions_[0].size(); ++r) scores.push_back(score(seen.mask(static_cast<int>(r))));
        scores.push_back(score(seen.remainder(person)));
        return scores;
    };
    RegionLabels all = labels[0]; // at most one person has a pixel
    for (const RegionLabels& person : labels)
        for (std::size_t i = 0; i < all.labels.size(); ++i) all.labels[i] = std::max(all.labels[i], person.labels[i]);
    const auto everybody = std::as_const(comparison.mask).view();
    comparison.score.regions = score_regions(all, everybody);
    if (labels.size() > 1) {
        // Over a plate every pixel counts as people, so pixels that no body covers belong to no person.
        std::vector<Image<std::uint8_t>> masks = people_masks(labels, everybody, photo.plate.empty());
        for (std::size_t p = 0; p < labels.size(); ++p) {
            if (const auto* given = source_.people[p].mask({photo.camera_index, photo.frame})) masks[p] = *given;
            comparison.score.people.push_back(
                {score(masks[p]), score_regions(labels[p], std::as_const(masks[p]).view())});
        }
    }
    if (lpips_) comparison.score.lpips = lpips_->distance(render, truth);
    return comparison;
}

std::vector<RegionLabels> Judge::labels_of(const Photo& photo) {
    std::vector<std::vector<vec3<double>>> vertices;
    std::vector<LabelledBody> people;
    for (std::size_t p = 0; p < source_.people.size(); ++p) vertices.push_back(source_.posed(p, photo.frame).vertices);
    for (std::size_t p = 0; p < vertices.size(); ++p)
        people.push_back({vertices[p], source_.body(p).faces, regions_[p]});
    return people_labels(backend_, Span<const LabelledBody>(people), photo.camera);
}

std::string Judge::lpips_protocol() const { return lpips_ ? " LPIPS " + lpips_->protocol() + "." : ""; }

} // namespace gsh::examples
