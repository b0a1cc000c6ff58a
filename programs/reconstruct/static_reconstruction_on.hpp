// SPDX-License-Identifier: Apache-2.0
/// @file  A static scene in training on a backend. A file that includes it also includes the backend's overloads.
#pragma once

#include "reconstruct/static_reconstruction.hpp"

#include <gsh/backend/backend.hpp>
#include <gsh/setup/static_configuration.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/trainer.hpp>

#include <cstddef>
#include <cstdint>
#include <utility>

namespace gsh::programs {

template <Backend B>
class StaticReconstructionOn final : public StaticReconstruction {
public:
    /// `backend` must outlive this object.
    StaticReconstructionOn(B& backend, StaticSetup setup)
        : StaticReconstruction(static_cast<std::uint64_t>(setup.config.steps)),
          scene_(backend, setup.start, setup.extent, setup.seed, setup.config),
          trainer_(backend, scene_, std::move(setup.photos), static_order_seed(setup.seed),
                   train_config_of(setup.config)) {}

    std::uint64_t step_count() const override { return trainer_.step_count(); }
    std::size_t size() const override { return scene_.size(); }
    DensityChange total_change() const override { return scene_.total_change(); }
    GaussianCloud<float> cloud() override { return scene_.cloud(); }
    Comparison<float> compare(const Photo& photo) override { return gsh::compare(trainer_, photo); }

private:
    void step() override { trainer_.step(); }
    void settle() override { trainer_.settle(); }

    StaticModel<B> scene_;
    Trainer<B, StaticModel<B>> trainer_;
};

} // namespace gsh::programs
