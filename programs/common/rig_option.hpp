// SPDX-License-Identifier: Apache-2.0
/// @file  The options of programs that read motions: names of other rigs (BVH, glTF, SAM 3D Body), and the frame rate.
#pragma once

#include <filesystem>
#include <gsh/core/error.hpp>

#include <cstddef>
#include <cstdlib>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace gsh::programs {

struct RigOption {
    std::filesystem::path joint_map; ///< JSON file with names of joints; empty: known names only
    std::string animation;           ///< of a glTF file with several; empty: the first
    std::vector<double> input_fps;   ///< one rate for all motions, or one for each; 0: as the file states

    [[nodiscard]] bool is_default() const { return joint_map.empty() && animation.empty() && input_fps.empty(); }
    /// Throws ValueError unless there is one rate for all of so many motions, or one for each.
    void check_rates(std::size_t motions) const {
        const std::size_t rates = input_fps.size();
        check_value(rates <= 1 || rates == motions, "--input-fps",
                    "has " + std::to_string(rates) + " rates for " + std::to_string(motions) +
                        (motions == 1 ? " motion" : " motions; give one for all, or one for each, in the same order"));
    }
    /// The rate that is stated for one of several motions; 0: none.
    [[nodiscard]] double input_fps_of(std::size_t motion) const {
        if (input_fps.size() == 1) return input_fps[0];
        return motion < input_fps.size() ? input_fps[motion] : 0;
    }
};

/// The options --joint-map, --animation and --input-fps. CLI11 must be included before it is called.
template <class App = CLI::App>
void add_rig(App& app, RigOption& option) {
    app.add_option("--joint-map", option.joint_map,
                   "FILE.json: names of a rig's joints that gsh does not know, {\"LeftArm\": \"left_shoulder\", …}");
    app.add_option("--animation", option.animation,
                   "name of the animation in a glTF file that has several (default: the first)");
    const auto complaint = [](const std::string& text) {
        char* end = nullptr;
        const double rate = std::strtod(text.c_str(), &end);
        const bool good = end != text.c_str() && *end == '\0' && rate >= 0 && rate <= 1e5;
        return good ? std::string() : "'" + text + "' is not a rate, 0 or more frames per second";
    };
    app.add_option("--input-fps", option.input_fps,
                   "frames per second of the motion, whatever its file states; for several motions one for all, or one "
                   "for each: 30,120 (0: as the file states; a file that states none has 30)")
        ->delimiter(',')
        ->allow_extra_args(false)
        ->check(complaint);
}

} // namespace gsh::programs
