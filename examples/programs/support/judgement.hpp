// SPDX-License-Identifier: Apache-2.0
/// @file  Judging an avatar on test photographs: full image, person, regions, and LPIPS where there are weights.
#pragma once

#include "support/reconstruct_options.hpp"
#include "support/source.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/loss/lpips.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/pipeline/photo.hpp>
#include <gsh/train/region_labels.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::examples {

/// Reads LPIPS weights and forgets them: what is wrong with them is better known before training.
/// Errors  those of read_lpips.
void check_lpips(const std::filesystem::path& weights);

/// Judges photographs of one source. Regions are where the posed body's face and hands are seen; the body is the rest
/// of the photograph's person. Several people are judged together and each apart: over the pixels of their mask if the
/// capture has one, else where they are the one in front.
class Judge {
public:
    Judge(cpu::Threads& backend, const Source& source, const ReconstructOptions& o);
    ~Judge();

    /// Adds to a photograph's comparison the figures of regions and people, and LPIPS.
    [[nodiscard]] Comparison<float> judge(Comparison<float> comparison, const Photo& photo);

    /// Which part of each person each pixel shows, in the poses that the capture gives.
    [[nodiscard]] std::vector<RegionLabels> labels_of(const Photo& photo);
    /// How LPIPS was computed, for a protocol; empty without weights.
    [[nodiscard]] std::string lpips_protocol() const;

private:
    cpu::Threads& backend_;
    const Source& source_;
    std::vector<std::vector<MeshRegion>> regions_; ///< of each person
    std::optional<Lpips<cpu::Threads>> lpips_;
};

} // namespace gsh::examples
