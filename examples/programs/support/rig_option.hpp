// SPDX-License-Identifier: Apache-2.0
/// @file  The options of programs that read motions of other rigs: BVH, glTF, SAM 3D Body.
#pragma once

#include <filesystem>
#include <string>

namespace CLI {
class App;
}

namespace gsh::examples {

struct RigOption {
    std::filesystem::path joint_map; ///< JSON file with names of joints; empty: known names only
    std::string animation;           ///< of a glTF file with several; empty: the first

    [[nodiscard]] bool is_default() const { return joint_map.empty() && animation.empty(); }
};

/// The options --joint-map and --animation. CLI11 must be included before it is called.
template <class App = CLI::App>
void add_rig(App& app, RigOption& option) {
    app.add_option("--joint-map", option.joint_map,
                   "FILE.json: names of a rig's joints that gsh does not know, {\"LeftArm\": \"left_shoulder\", …}");
    app.add_option("--animation", option.animation,
                   "name of the animation in a glTF file that has several (default: the first)");
}

} // namespace gsh::examples
