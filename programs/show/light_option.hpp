// SPDX-License-Identifier: Apache-2.0
/// @file  The light in which gsh-render and gsh-animate show avatars: their own, even light, or that of an image.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gsh {
struct AvatarData;
struct Motion;
} // namespace gsh

namespace gsh::programs {

struct LightOption {
    std::string light = "estimated"; ///< "estimated" (each avatar's own), "even", or the path of an environment image
    double exposure = 0;             ///< stops; every light is multiplied by 2^exposure
    double turn = 0;                 ///< degrees; turns the light of an image about +y

    [[nodiscard]] bool is_default() const { return light == "estimated" && exposure == 0 && turn == 0; }
};

/// Puts avatars, which were read from the given files and are shown in the given motions, in the light of an option.
/// The light of a capture follows a motion to another world frame or place (light_at). The light of an image comes from
/// above where a motion's body stands up. The numbers of the gloss stay.
/// Errors  ValueError for an avatar that was trained without a light, unless the option is the default; those of
///         read_environment.
void relight(std::vector<AvatarData>& avatars, const std::vector<std::filesystem::path>& files,
             const std::vector<Motion>& motions, const LightOption& option);

} // namespace gsh::programs
