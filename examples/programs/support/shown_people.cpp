// SPDX-License-Identifier: Apache-2.0
#include "support/shown_people.hpp"

#include "support/input_files.hpp"
#include "support/messages.hpp"

#include <gsh/avatar/rig.hpp>
#include <gsh/core/error.hpp>

#include <algorithm>
#include <string>

namespace gsh::examples {

ShownPeople::ShownPeople(const std::vector<std::filesystem::path>& avatars,
                         const std::vector<std::filesystem::path>& poses, const LightOption& light,
                         bool upright) {
    check_value(poses.empty() || poses.size() == avatars.size(), "--poses",
                "has " + std::to_string(poses.size()) + " motions for " + std::to_string(avatars.size()) +
                    " avatars; give one for each, in the same order");
    std::vector<std::string> warnings;
    for (std::size_t p = 0; p < avatars.size(); ++p) {
        check_value(avatars[p].extension() == ".gsh", avatars[p].string(), "is not an avatar (.gsh)");
        data.push_back(avatar_of_file(avatars[p]));
        const RigData& rig = data[p].rig;
        motions.push_back(poses.empty() ? rest_motion(rig) : motion_of_file(poses[p], rig.body, warnings, upright));
    }
    relight(data, avatars, motions, light);
    for (const std::string& warning : warnings) warn(warning);
}

std::size_t ShownPeople::frame_count() const {
    std::size_t count = motions[0].frame_count();
    for (const Motion& motion : motions) count = std::min(count, motion.frame_count());
    return count;
}

Ensemble::Ensemble(cpu::Threads& backend, const ShownPeople& people) : people_(&people) {
    for (const AvatarData& avatar : people.data) avatars_.emplace_back(backend, avatar);
}
Ensemble::~Ensemble() = default;

std::vector<Pose> Ensemble::at(std::size_t frame) const {
    std::vector<Pose> poses;
    for (std::size_t p = 0; p < avatars_.size(); ++p) poses.push_back({&avatars_[p], &people_->motions[p], frame});
    return poses;
}

} // namespace gsh::examples
