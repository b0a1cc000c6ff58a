// SPDX-License-Identifier: Apache-2.0
/// @file  What a reconstruction will train on, and the memory that it will take.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/reconstruct/input.hpp>
#include <gsh/reconstruct/recipe.hpp>
#include <gsh/reconstruct/setup.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// What a reconstruction will train on and take, known before it is made.
struct ReconstructionPlan {
    std::size_t people = 0, cameras = 0, frames = 0;
    std::size_t training_images = 0, test_images = 0;
    std::size_t gaussians = 0;     ///< of each person; fewer than in the recipe if its max_memory is short
    std::size_t pixels = 0;        ///< of a photograph for training, cropped to the people: the mean
    std::uint64_t image_bytes = 0; ///< the images of the capture that are held until they are cropped
    std::uint64_t memory = 0;      ///< bytes that training takes where it trains: training_memory
};

/// The plan of a reconstruction on the backend B; with `on_device`, of training on a device with memory of its own.
/// Neither places Gaussians nor trains.
///
/// Errors  ValueError without photographs for training, or if recipe.max_memory is too small; those of test_photos_of.
template <CpuBackend B, class Parts = AvatarParts>
[[nodiscard]] ReconstructionPlan plan_reconstruction(const ReconstructionInput& input, const Recipe& recipe,
                                                     bool on_device = false) {
    ReconstructionSetup setup;
    setup.configuration = recipe.configuration;
    detail::add_photographs(input, setup);
    ReconstructionPlan plan{.people = input.people.size(),
                            .cameras = input.capture.cameras.size(),
                            .frames = input.capture.frame_count(),
                            .training_images = setup.photos.size(),
                            .test_images = setup.test_photos.size()};
    plan.gaussians = detail::gaussians_within_memory<Parts, B>(input, recipe, on_device, setup);
    for (const Photo& photo : setup.photos) plan.pixels += detail::box_of_photo(input.capture, photo).size();
    const std::uint64_t photo_bytes = 4 * plan.pixels; // cropped
    plan.pixels /= setup.photos.size();
    for (const auto* images : {&input.capture.images, &input.capture.backgrounds})
        for (const auto& image : *images) plan.image_bytes += image.data.size();
    plan.memory = detail::memory_of_training<Parts, B>(input, setup, on_device).bytes(plan.gaussians);
    if (setup.stored && !on_device) plan.memory += std::min(photo_bytes, setup.stored->memory()); // that are kept
    return plan;
}

} // namespace gsh
