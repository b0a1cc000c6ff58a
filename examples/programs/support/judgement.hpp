// SPDX-License-Identifier: Apache-2.0
/// @file  Evaluates an avatar on test photographs: full image, person, regions, and LPIPS if weights are given.
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

/// Reads LPIPS weights and discards them, so that errors in the file are reported before training.
/// Errors  those of read_lpips.
void check_lpips(const std::filesystem::path& weights);

/// Evaluates photographs of one source. The regions face and hands are the pixels that show them on the posed body. The
/// region body is the remaining pixels of the person. Several people are evaluated together, and each one separately:
/// on the pixels of the person's mask if the capture has one, otherwise on those where the person is in front.
class Judge {
public:
    Judge(cpu::Threads& backend, const Source& source, const ReconstructOptions& o);
    ~Judge();

    /// Adds the figures of regions and people, and LPIPS, to the comparison of a photograph.
    [[nodiscard]] Comparison<float> judge(Comparison<float> comparison, const Photo& photo);

    /// For each person, the part that each pixel shows, in the poses of the capture.
    [[nodiscard]] std::vector<RegionLabels> labels_of(const Photo& photo);
    /// The protocol's sentence on how LPIPS was computed; empty without weights.
    [[nodiscard]] std::string lpips_protocol() const;

private:
    cpu::Threads& backend_;
    const Source& source_;
    std::vector<std::vector<MeshRegion>> regions_; ///< of each person
    std::optional<Lpips<cpu::Threads>> lpips_;
};

} // namespace gsh::examples
