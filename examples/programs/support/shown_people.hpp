// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars with a motion each, from files: what gsh-animate and gsh-render show together.
#pragma once

#include "support/renderer.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/motion.hpp>

#include <cstddef>
#include <deque>
#include <filesystem>
#include <vector>

namespace gsh::examples {

/// Avatars, and a motion for each of them.
struct ShownPeople {
    std::vector<AvatarData> data;
    std::vector<Motion> motions;

    /// A file or folder of poses per avatar, in their order; none at all leaves everybody in the canonical pose.
    /// `upright` turns each motion's world so that the body stands along +y.
    /// Errors  ValueError for numbers that do not match; else those of the files.
    ShownPeople(const std::vector<std::filesystem::path>& avatars, const std::vector<std::filesystem::path>& poses,
                bool upright = false);

    /// Frames that every motion has.
    [[nodiscard]] std::size_t frame_count() const;
    [[nodiscard]] PixelFilter filter() const { return common_filter(data); }
};

/// The same on a backend, ready to be drawn. `people` must outlive it.
class Ensemble {
public:
    Ensemble(cpu::Threads& backend, const ShownPeople& people);
    ~Ensemble();

    /// Everybody at a frame.
    [[nodiscard]] std::vector<Pose> at(std::size_t frame) const;

private:
    const ShownPeople* people_;
    std::deque<Avatar<cpu::Threads>> avatars_;
};

} // namespace gsh::examples
