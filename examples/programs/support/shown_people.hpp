// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars and their motions, read from files, for gsh-animate and gsh-render.
#pragma once

#include "support/light_option.hpp"
#include "support/renderer.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/motion.hpp>

#include <cstddef>
#include <deque>
#include <filesystem>
#include <vector>

namespace gsh::examples {

/// Avatars, with one motion for each.
struct ShownPeople {
    std::vector<AvatarData> data;
    std::vector<Motion> motions;

    /// Takes one file or folder of poses per avatar, in the same order. Without poses, all are in the canonical pose.
    /// `upright` rotates the world of each motion so that the body stands along +y.
    /// Errors  ValueError if the numbers of avatars and motions differ; those of relight; else those of the files.
    ShownPeople(const std::vector<std::filesystem::path>& avatars, const std::vector<std::filesystem::path>& poses,
                const LightOption& light = {}, bool upright = false);

    /// The length of the shortest motion.
    [[nodiscard]] std::size_t frame_count() const;
    [[nodiscard]] PixelFilter filter() const { return common_filter(data); }
};

/// The same people in the memory of a backend, for rendering. `people` must outlive it.
class Ensemble {
public:
    Ensemble(cpu::Threads& backend, const ShownPeople& people);
    ~Ensemble();

    /// All people at a frame.
    [[nodiscard]] std::vector<Pose> at(std::size_t frame) const;

private:
    const ShownPeople* people_;
    std::deque<Avatar<cpu::Threads>> avatars_;
};

} // namespace gsh::examples
