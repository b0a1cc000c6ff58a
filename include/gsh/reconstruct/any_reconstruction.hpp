// SPDX-License-Identifier: Apache-2.0
/// @file  The models of people with their trainer, on whichever backend.
#pragma once

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/reconstruct/any_training.hpp>
#include <gsh/reconstruct/observer.hpp>
#include <gsh/reconstruct/setup.hpp>
#include <gsh/train/evaluation.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh {

class ArchiveReader;
class ArchiveWriter;

/// Table rows of all people's fields.
struct TableCounts {
    std::size_t lookups = 0;              ///< that the fields of colour and displacement read in one pass
    std::size_t entries = 0, touched = 0; ///< of these fields' tables; touched: read by at least one Gaussian
    std::size_t ao_entries = 0, ao_touched = 0;
};

/// The models and their trainer on a backend that is chosen at run time: Reconstruction<B> is the one on B. Call
/// settle() before the calls below.
class AnyReconstruction : public AnyTraining {
public:
    const ReconstructionSetup setup;

    explicit AnyReconstruction(ReconstructionSetup made) : setup(std::move(made)) {}

    /// Trainer::release_memory, at the end of the training.
    virtual void release_memory() = 0;

    /// gsh::compare: a photograph and its render.
    [[nodiscard]] virtual Comparison<float> compare(const Photo& photo) = 0;

    /// The avatars in their present state, for files. An avatar's body may have fewer joints than that of the capture.
    [[nodiscard]] virtual std::vector<AvatarData> avatars() = 0;
    /// The present gain of each training photograph on red, green and blue, in linear light; 1 where none is learned.
    [[nodiscard]] virtual std::vector<std::array<double, 3>> photo_gains() const = 0;
    /// A person's present motion.
    /// Errors  ValueError without Recipe::refine.
    [[nodiscard]] virtual Motion refined_motion(std::size_t person) const = 0;

    /// Fills the Gaussians that no photograph saw, if the configuration says so, and returns their number for each
    /// person. Training cannot continue before end_fill.
    virtual std::vector<std::size_t> fill_unseen() = 0;
    virtual void end_fill() = 0;

    /// Fits the poses of the test frames to the test photographs. The avatars do not change. Several people are fitted
    /// in turns. Later figures are figures of test-time refinement. Returns false if the observer stopped it.
    /// Errors  ValueError without Recipe::refine.
    virtual bool refine_test_poses(const Observer& observer = {}) = 0;
    /// Restores the poses of training.
    /// Errors  ValueError without Recipe::refine.
    virtual void end_test_refinement() = 0;

    /// The state of the training, for checkpoints. It does not depend on the backend.
    virtual void save(ArchiveWriter& file) = 0;
    /// Errors  those of load_trainer and load_refinement.
    virtual void load(const ArchiveReader& file) = 0;

    [[nodiscard]] virtual TableCounts table_counts() = 0;
};

} // namespace gsh
