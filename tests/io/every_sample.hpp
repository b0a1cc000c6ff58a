// SPDX-License-Identifier: Apache-2.0
/// @file  Good files of every kind that gsh reads, for tests that damage them or let reading fail.
#pragma once

#include "io/samples.hpp"
#include "io/samples_of_captures.hpp"
#include "io/samples_of_files.hpp"
#include "io/samples_of_motions.hpp"

#include <filesystem>
#include <vector>

namespace gsh::test {

/// Writes all samples.
inline std::vector<Sample> write_samples(const std::filesystem::path& folder) {
    Samples samples(folder);
    add_array_files(samples);
    add_image_files(samples);
    add_splat_files(samples);
    add_model_files(samples);
    add_motion_files(samples);
    add_camera_files(samples);
    add_reconstructions(samples);
    add_captures(samples);
    return samples.all;
}

} // namespace gsh::test
