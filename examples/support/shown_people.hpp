// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars with a motion each, from files: what gsh-animate and gsh-render show together.
#pragma once

#include "support/program.hpp"
#include "support/renderer.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/avatar_file.hpp>
#include <gsh/io/motion_file.hpp>

#include <algorithm>
#include <cstddef>
#include <deque>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh::examples {

/// Avatars, and a motion for each of them.
struct ShownPeople {
    std::vector<AvatarData> data;
    std::vector<Motion> motions;

    /// One pose file per avatar, in their order; none at all leaves everybody in the canonical pose.
    /// Errors  ValueError for numbers that do not match; else those of the files.
    ShownPeople(const std::vector<std::filesystem::path>& avatars, const std::vector<std::filesystem::path>& poses) {
        check_value(poses.empty() || poses.size() == avatars.size(), "--poses",
                    "names " + std::to_string(poses.size()) + " motions for " + std::to_string(avatars.size()) +
                        " avatars; give one for each, in their order");
        std::vector<std::string> warnings;
        for (std::size_t p = 0; p < avatars.size(); ++p) {
            data.push_back(load_avatar(avatars[p]));
            motions.push_back(poses.empty() ? rest_motion(data[p].rig) : load_motion(poses[p], data[p].rig.body, {}, &warnings));
        }
        for (const std::string& warning : warnings) warn(warning);
    }
    /// Frames that every motion has.
    [[nodiscard]] std::size_t frame_count() const {
        std::size_t count = motions[0].frame_count();
        for (const Motion& motion : motions) count = std::min(count, motion.frame_count());
        return count;
    }
    [[nodiscard]] PixelFilter filter() const { return common_filter(data); }
};

/// The same on a backend, ready to be drawn. `people` must outlive it.
class Ensemble {
public:
    Ensemble(cpu::Threads& backend, const ShownPeople& people) : people_(&people) {
        for (const AvatarData& avatar : people.data) avatars_.emplace_back(backend, avatar);
    }
    /// Everybody at a frame.
    [[nodiscard]] std::vector<Pose> at(std::size_t frame) const {
        std::vector<Pose> poses;
        for (std::size_t p = 0; p < avatars_.size(); ++p) poses.push_back({&avatars_[p], &people_->motions[p], frame});
        return poses;
    }

private:
    const ShownPeople* people_;
    std::deque<Avatar<cpu::Threads>> avatars_;
};

} // namespace gsh::examples
