// SPDX-License-Identifier: Apache-2.0
/// @file  Warnings of readers of motions that turn the world, or do not know which axis is up.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/rig_up.hpp>
#include <gsh/io/motion/motion_options.hpp>
#include <gsh/math/signed_axis.hpp>

#include <string>
#include <vector>

namespace gsh::detail {

/// "z is up, so the world is turned to y up"; empty if y is up beyond doubt.
[[nodiscard]] inline std::string up_warning(const RigUp& up) {
    const SignedAxis y{};
    std::string text = up.axis == y ? "" : up.axis.name() + " is up, so the world is turned to y up";
    if (up.doubt.empty()) return text;
    if (text.empty()) text = "y is taken as up";
    return text + "; that is uncertain: " + up.doubt;
}

} // namespace gsh::detail
