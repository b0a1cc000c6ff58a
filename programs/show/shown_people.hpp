// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars and their motions, read from files, for gsh-animate and gsh-render.
#pragma once

#include "common/rig_option.hpp"
#include "show/light_option.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/motion.hpp>

#include <cstddef>
#include <filesystem>
#include <utility>
#include <vector>

namespace gsh::programs {

/// Avatars, with one motion for each.
struct ShownPeople {
    std::vector<AvatarData> data;
    std::vector<Motion> motions;

    /// Takes one file or folder of poses per avatar, in the same order. Without poses, all are in the canonical pose.
    /// `upright` rotates the world of each motion so that the body stands along +y. Motions of other rigs take the
    /// avatar's shape.
    /// Errors  ValueError if the numbers of avatars and motions differ; those of relight; else those of the files.
    ShownPeople(const std::vector<std::filesystem::path>& avatars, const std::vector<std::filesystem::path>& poses,
                const LightOption& light = {}, bool upright = false, const RigOption& rig = {});

    /// Avatars in motions of the world that they were trained in.
    ShownPeople(std::vector<AvatarData> avatars, std::vector<Motion> own_motions)
        : data(std::move(avatars)), motions(std::move(own_motions)) {}

    /// Makes frame t of all motions the same moment, with a warning if motions of different rates are resampled.
    void share_clock();
    /// The length of the shortest motion.
    [[nodiscard]] std::size_t frame_count() const;
    /// The pixel filter that all avatars were trained with.
    /// Errors  ValueError if they were trained with different filters.
    [[nodiscard]] PixelFilter filter() const;
};

} // namespace gsh::programs
