// SPDX-License-Identifier: Apache-2.0
/// @file  Judging an avatar on test photographs: full image, person, regions, and LPIPS where there are weights.
#pragma once

#include "support/reconstruction.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/io/lpips_file.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/region_labels.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

/// Names of what is judged apart, in the order of ImageScore::regions.
inline std::vector<std::string> region_names() { return {"face", "hands", "body"}; }

/// Judges photographs of one source. Regions are where the posed body's face and hands are seen; the body is the rest of
/// the photograph's person. Several people are judged together and each apart: over the pixels of their mask if the capture
/// has one, else where they are the one in front.
class Judge {
public:
    Judge(cpu::Threads& backend, const Source& source, const std::filesystem::path& lpips_weights = {})
        : backend_(backend), source_(source) {
        for (std::size_t p = 0; p < source.people.size(); ++p) {
            const BodyRegions regions = source.body_regions_of(p);
            regions_.push_back({{"face", regions.face}, {"hands", regions.left_hand}});
            auto& hands = regions_.back()[1].vertices;
            hands.insert(hands.end(), regions.right_hand.begin(), regions.right_hand.end());
        }
        if (!lpips_weights.empty()) lpips_.emplace(backend, read_lpips(lpips_weights), LpipsScaling::correct);
    }

    template <class TrainerType>
    [[nodiscard]] auto judge(TrainerType& trainer, const Photo& photo) {
        auto comparison = compare(trainer, photo);
        const auto render = std::as_const(comparison.render).view(), truth = std::as_const(comparison.truth).view();
        const std::vector<RegionLabels> labels = labels_of(photo);
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
            // Over a plate the whole photograph counts as the people: what no body covers is nobody's.
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

    /// Which part of each person each pixel shows, in the poses that the capture gives.
    [[nodiscard]] std::vector<RegionLabels> labels_of(const Photo& photo) {
        std::vector<std::vector<vec3<double>>> vertices;
        std::vector<LabelledBody> people;
        for (std::size_t p = 0; p < source_.people.size(); ++p) vertices.push_back(source_.posed(p, photo.frame).vertices);
        for (std::size_t p = 0; p < vertices.size(); ++p) people.push_back({vertices[p], source_.body(p).faces, regions_[p]});
        return people_labels(backend_, Span<const LabelledBody>(people), photo.camera);
    }
    /// How LPIPS was computed, for a protocol; empty without weights.
    [[nodiscard]] std::string lpips_protocol() const { return lpips_ ? " LPIPS " + lpips_->protocol() + "." : ""; }

private:
    cpu::Threads& backend_;
    const Source& source_;
    std::vector<std::vector<MeshRegion>> regions_; ///< of each person
    std::optional<Lpips<cpu::Threads>> lpips_;
};

} // namespace gsh::examples
