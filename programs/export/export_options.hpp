// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-export is asked for: the options, and the frames of a motion that they name.
#pragma once

#include "common/rig_option.hpp"
#include "export/export_format.hpp"
#include "show/light_option.hpp"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

struct ExportOptions {
    std::filesystem::path input, to;
    std::vector<std::filesystem::path> poses; ///< several for .html, otherwise one at most
    std::optional<std::size_t> frame;
    std::string frames; ///< A:B or A:B:S; empty for a still file
    std::optional<int> sh_degree;
    std::optional<std::string> up;        ///< "y" or "-y", of the output
    std::string input_up;                 ///< of a scene; empty: what it states
    std::optional<std::size_t> largest;   ///< number of Gaussians to keep
    std::optional<std::size_t> gaussians; ///< number of Gaussians that are left after merging
    std::optional<int> spz_version, clusters;
    bool mesh = false, as_stored = false;
    LightOption light;
    RigOption rig;
    std::size_t threads = 0;

    [[nodiscard]] bool is_moving() const { return !frames.empty(); }
};

/// The frames A, A + S, … up to B, both ends included, of "A:B" or "A:B:S".
/// Errors  ValueError for another text, and for frames that a motion of `count` frames does not have.
std::vector<std::size_t> frames_of(const std::string& text, std::size_t count);

/// The frame of --frame, or the first one.
/// Errors  ValueError for a frame that the motion, of `count` frames, does not have.
std::size_t chosen_frame(const ExportOptions& options, std::size_t count);

/// Checks that options fit each other, the input and the format.
/// Errors  ValueError naming the option.
FormatTraits check_options(const ExportOptions& options);

} // namespace gsh::programs
