// SPDX-License-Identifier: Apache-2.0
#include "show/shown_people.hpp"

#include "common/input_files.hpp"
#include "common/messages.hpp"

#include <gsh/avatar/rig.hpp>
#include <gsh/body/resampled_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <string>

namespace gsh::programs {

ShownPeople::ShownPeople(const std::vector<std::filesystem::path>& avatars,
                         const std::vector<std::filesystem::path>& poses, const LightOption& light, bool upright,
                         const RigOption& rig_option) {
    check_value(poses.empty() || poses.size() == avatars.size(), "--poses",
                "has " + std::to_string(poses.size()) + " motions for " + std::to_string(avatars.size()) +
                    " avatars; give one for each, in the same order");
    rig_option.check_rates(poses.size());
    std::vector<std::string> warnings;
    for (std::size_t p = 0; p < avatars.size(); ++p) {
        check_value(avatars[p].extension() == ".gsh", avatars[p].string(), "is not an avatar (.gsh)");
        data.push_back(avatar_of_file(avatars[p]));
        const RigData& rig = data[p].rig;
        motions.push_back(poses.empty()
                              ? rest_motion(rig)
                              : motion_of_file(poses[p], rig.body, warnings, upright, rig.betas, rig_option, p));
    }
    relight(data, avatars, motions, light);
    for (const std::string& warning : warnings) warn(warning);
}

void ShownPeople::share_clock() {
    if (const double rate = share_frame_times(motions); rate > 0)
        warn("--poses: the motions have different frame rates; all are shown by time, at " +
             gsh::detail::number_text(rate) + " frames per second");
}

std::size_t ShownPeople::frame_count() const {
    std::size_t count = motions[0].frame_count();
    for (const Motion& motion : motions) count = std::min(count, motion.frame_count());
    return count;
}

PixelFilter ShownPeople::filter() const {
    for (const AvatarData& avatar : data)
        check_value(
            avatar.filter.dilation == data[0].filter.dilation &&
                avatar.filter.compensate_opacity == data[0].filter.compensate_opacity,
            "avatars",
            "were trained with different pixel filters (filter.dilation, filter.compensate), so that one picture "
            "cannot be correct for all of them; train them with the same filter");
    return data[0].filter;
}

} // namespace gsh::programs
