// SPDX-License-Identifier: Apache-2.0
/// @file  Reads joint maps from JSON: which joint of a rig is which joint of SMPL-X.
#pragma once

#include <gsh/body/joint_map.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>

#include <string>

namespace gsh {

/// Reads {"Bip_LeftArm_01": "left_shoulder", "Bip_Prop": null}: the rig's names as they are in its file, and joints of
/// SMPL-X, or null for a joint that is to be left out. Joints that are not listed are found by known names.
///
/// Errors  IoError naming the file and the entry: a file that is not a JSON object, or a name that SMPL-X does not
///         have.
[[nodiscard]] inline JointMap read_joint_map(const InputFile& input) {
    const detail::OwnedJson owned(detail::read_json(input, "joint_map"));
    const detail::Json& json = *owned;
    if (!json.is_object())
        throw IoError(input.name() + ": is " + json.type_name() +
                      R"(, expected an object of names such as {"LeftArm": "left_shoulder"})");
    JointMap map;
    for (const auto& [name, joint] : json.items()) {
        if (!joint.is_null() && (!joint.is_string() || smplx_joint(joint.get<std::string>()) < 0))
            throw IoError(input.name() + ": " + detail::shortened(name) + " is " + detail::shortened(joint.dump()) +
                          ", expected a joint of SMPL-X such as \"left_shoulder\", or null");
        map.named[name] = joint.is_null() ? std::string() : joint.get<std::string>();
    }
    return map;
}

} // namespace gsh
