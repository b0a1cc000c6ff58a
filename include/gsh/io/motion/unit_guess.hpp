// SPDX-License-Identifier: Apache-2.0
/// @file  The warning of a reader of motions that guessed the unit of lengths.
#pragma once

#include <gsh/body/rest_pose.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <string>

namespace gsh::detail {

/// "the unit is guessed: the legs are 82 long, so lengths are taken as centimetres"
[[nodiscard]] inline std::string unit_warning(const LengthUnit& unit) {
    return "the unit is guessed: the legs are " + number_text(unit.leg) + " long, so lengths are taken as " +
           (unit.name.empty() ? "multiples of " + number_text(unit.metres) + " m, which makes the legs 0.82 m"
                              : std::string(unit.name));
}

} // namespace gsh::detail
