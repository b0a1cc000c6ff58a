// SPDX-License-Identifier: Apache-2.0
#include "show/light_option.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/avatar/light_place.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/image/environment_file.hpp>
#include <gsh/light/environment.hpp>
#include <gsh/light/light.hpp>

#include <cstddef>
#include <numbers>
#include <optional>
#include <utility>

namespace gsh::programs {

namespace {

/// The light that replaces the avatars' own, if one does.
std::optional<LightData> replacement(const LightOption& option) {
    if (option.light == "estimated") return std::nullopt;
    if (option.light == "even") return even_light(0, EnvironmentParams().directions, {0, 0, 0}, 1);
    const Image<float> image = read_environment(option.light);
    return environment_light(image.view(), {.turn = option.turn * std::numbers::pi / 180});
}

} // namespace

void relight(std::vector<AvatarData>& avatars, const std::vector<std::filesystem::path>& files,
             const std::vector<Motion>& motions, const LightOption& option) {
    check_value(option.turn == 0 || (option.light != "estimated" && option.light != "even"), "--light-turn",
                "needs the light of an image, --light FILE");
    for (std::size_t p = 0; p < avatars.size(); ++p)
        check_value(avatars[p].light.has_value() || option.is_default(), files[p].string(),
                    "was trained without a light, so that its colours contain that of the capture and --light and "
                    "--exposure cannot change it; train it with gsh-reconstruct --config light");
    const std::optional<LightData> other = replacement(option);
    for (std::size_t p = 0; p < avatars.size(); ++p) {
        AvatarData& avatar = avatars[p];
        if (!avatar.light) continue;
        LightData& light = *avatar.light;
        MotionPlace from = avatar.light_place;
        const MotionPlace to = place_of(motions[p], avatar.rig.joints[0]);
        if (other) {
            std::vector<double> gloss = std::move(light.gloss);
            light = *other;
            light.gloss = std::move(gloss);
            const mat3<double> upright = to.upright.value_or(mat3<double>(1.0));
            from = {mat3<double>(1.0), upright * to.low, upright * to.high}; // y is up, and the place is the motion's
        }
        light = light_at(std::move(light), from, to);
        for (double& intensity : light.log_intensities) intensity += option.exposure * std::numbers::ln2;
    }
}

} // namespace gsh::programs
