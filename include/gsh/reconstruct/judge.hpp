// SPDX-License-Identifier: Apache-2.0
/// @file  Judges avatars on test photographs: full image, person, regions, and LPIPS if weights are given.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/setup/region_labels.hpp>
#include <gsh/train/evaluation.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// Names of the regions that a Judge scores, in the order of ImageScore::regions.
inline constexpr std::array<std::string_view, 3> judged_regions{"face", "hands", "body"};

/// Judges photographs of one input. The regions face and hands are the pixels that show them on the posed body. The
/// region body is the remaining pixels of the person. Several people are judged together, and each one separately: on
/// the pixels of the person's mask if the capture has one, otherwise on those where the person is in front.
template <CpuBackend B>
class Judge {
public:
    /// Backend and input must outlive this object; with registered motions, regions are where these show them.
    Judge(B& backend, const ReconstructionInput& input, std::optional<LpipsNetwork> lpips = {},
          LpipsScaling scaling = LpipsScaling::correct)
        : backend_(&backend), input_(&input) {
        for (std::size_t p = 0; p < input.people.size(); ++p) {
            const BodyRegions regions = input.body_regions_of(p);
            regions_.push_back({{std::string(judged_regions[0]), regions.face},
                                {std::string(judged_regions[1]), regions.left_hand}});
            auto& hands = regions_.back()[1].vertices;
            hands.insert(hands.end(), regions.right_hand.begin(), regions.right_hand.end());
        }
        if (lpips) lpips_.emplace(backend, std::move(*lpips), scaling);
    }

    /// Adds the figures of regions and people, and LPIPS, to the comparison of a photograph
    /// (AnyReconstruction::compare).
    [[nodiscard]] Comparison<float> judge(Comparison<float> comparison, const Photo& photo);

    /// For each person, the part that each pixel shows, in the poses of the input.
    [[nodiscard]] std::vector<RegionLabels> labels_of(const Photo& photo);
    /// A sentence on how LPIPS was computed; empty without weights.
    [[nodiscard]] std::string lpips_protocol() const {
        return lpips_ ? " LPIPS " + lpips_->protocol() + "." : std::string();
    }

private:
    B* backend_;
    const ReconstructionInput* input_;
    std::vector<std::vector<MeshRegion>> regions_; ///< of each person
    std::optional<Lpips<B>> lpips_;
};

// -------------------------------------------------------------------------------------------------------------

template <CpuBackend B>
Comparison<float> Judge<B>::judge(Comparison<float> comparison, const Photo& photo) {
    const auto render = std::as_const(comparison.render).view(), truth = std::as_const(comparison.truth).view();
    std::vector<RegionLabels> labels = labels_of(photo);
    const HeldPhoto held(photo);
    for (RegionLabels& person : labels)
        for (const UnknownPixel& pixel : held->unknown)
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
            if (const auto* given = input_->people[p].mask({photo.camera_index, photo.frame})) masks[p] = *given;
            comparison.score.people.push_back(
                {score(masks[p]), score_regions(labels[p], std::as_const(masks[p]).view())});
        }
    }
    if (lpips_) comparison.score.lpips = lpips_->distance(render, truth);
    return comparison;
}

template <CpuBackend B>
std::vector<RegionLabels> Judge<B>::labels_of(const Photo& photo) {
    std::vector<std::vector<vec3<double>>> vertices;
    std::vector<LabelledBody> people;
    for (std::size_t p = 0; p < input_->people.size(); ++p) vertices.push_back(input_->posed(p, photo.frame).vertices);
    for (std::size_t p = 0; p < vertices.size(); ++p)
        people.push_back({vertices[p], input_->body(p).faces, regions_[p]});
    return people_labels(*backend_, Span<const LabelledBody>(people), photo.camera);
}

} // namespace gsh
