// SPDX-License-Identifier: Apache-2.0
/// @file  The options of gsh-render and gsh-animate for the light.
#pragma once

#include "common/program.hpp"
#include "show/light_option.hpp"

#include <cmath>
#include <string>

namespace gsh::programs {

/// The options --light, --light-turn and --exposure.
inline void add_light(CLI::App& app, LightOption& option) {
    const auto within = [](double limit) {
        return numbers([=](double value) { return std::abs(value) <= limit; },
                       "a number from -" + std::to_string(static_cast<int>(limit)) + " to " +
                           std::to_string(static_cast<int>(limit)));
    };
    app.add_option("--light", option.light,
                   "estimated (the light of the capture), even, or an equirectangular image: .hdr, .png, .jpg (default "
                   "estimated)");
    app.add_option("--light-turn", option.turn,
                   "degrees by which the image's light is turned about the vertical, from +z towards +x (default 0)")
        ->check(within(360));
    app.add_option("--exposure", option.exposure, "stops; the light is multiplied by 2^STOPS (default 0)")
        ->check(within(16));
}

} // namespace gsh::programs
