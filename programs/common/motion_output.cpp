// SPDX-License-Identifier: Apache-2.0
#include "common/motion_output.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/motion/bvh_export.hpp>
#include <gsh/io/motion/gltf_export.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <string_view>

namespace gsh::programs {

void check_motion_output(const std::string& option, const std::filesystem::path& path) {
    const auto ending = path.extension();
    check_value(ending == ".npz" || ending == ".bvh" || ending == ".glb", option + " " + path.string(),
                "has the ending '" + ending.string() + "', expected .npz, .bvh or .glb");
}

void write_motion(const std::filesystem::path& path, const Motion& motion, const BodyModel& body,
                  std::vector<std::string>& warnings) {
    if (path.extension() != ".bvh" && path.extension() != ".glb") return save_motion(path, motion);
    const auto moves = [](double x) { return x != 0; };
    if (std::any_of(motion.expression.begin(), motion.expression.end(), moves))
        warnings.push_back(path.string() + ": expressions are left out, because bones cannot show them");
    const RigMotion rig = rig_of_motion(body, motion);
    if (path.extension() == ".bvh")
        save_bvh(path, rig, &warnings);
    else
        save_gltf_motion(path, rig, path.stem().string());
}

} // namespace gsh::programs
