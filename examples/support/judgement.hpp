// SPDX-License-Identifier: Apache-2.0
/// @file  Judging an avatar on test photographs: full image, person, regions, and LPIPS where there are weights.
#pragma once

#include "support/reconstruction.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/io/lpips_file.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/region_labels.hpp>

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
/// the photograph's person.
class Judge {
public:
    Judge(cpu::Threads& backend, const Source& source, const std::filesystem::path& lpips_weights = {})
        : backend_(backend), source_(source) {
        BodyRegions regions = body_regions(source.body, source.regions);
        regions_ = {{"face", regions.face}, {"hands", regions.left_hand}};
        regions_[1].vertices.insert(regions_[1].vertices.end(), regions.right_hand.begin(), regions.right_hand.end());
        if (!lpips_weights.empty()) lpips_.emplace(backend, read_lpips(lpips_weights), LpipsScaling::correct);
    }

    template <class TrainerType>
    [[nodiscard]] auto judge(TrainerType& trainer, const Photo& photo) {
        auto comparison = compare(trainer, photo);
        const auto render = std::as_const(comparison.render).view(), truth = std::as_const(comparison.truth).view();
        const RegionLabels labels = labels_of(photo);
        const auto add = [&](const Image<std::uint8_t>& mask) {
            comparison.score.regions.push_back(score_region(render, truth, mask.view()));
        };
        for (std::size_t r = 0; r < regions_.size(); ++r) add(labels.mask(static_cast<int>(r)));
        add(labels.remainder(std::as_const(comparison.mask).view()));
        if (lpips_) comparison.score.lpips = lpips_->distance(render, truth);
        return comparison;
    }

    /// Which part of the body each pixel shows, in the pose that the capture gives.
    [[nodiscard]] RegionLabels labels_of(const Photo& photo) {
        const Motion& motion = source_.capture.motion;
        const PosedBody posed = pose_body(source_.body, motion.pose_at(photo.frame), motion.transl[photo.frame], motion.betas,
                                          motion.expression_at(photo.frame));
        return region_labels(backend_, posed.vertices, source_.body.faces, photo.camera, regions_);
    }
    /// How LPIPS was computed, for a protocol; empty without weights.
    [[nodiscard]] std::string lpips_protocol() const { return lpips_ ? " LPIPS " + lpips_->protocol() + "." : ""; }

private:
    cpu::Threads& backend_;
    const Source& source_;
    std::vector<MeshRegion> regions_;
    std::optional<Lpips<cpu::Threads>> lpips_;
};

} // namespace gsh::examples
