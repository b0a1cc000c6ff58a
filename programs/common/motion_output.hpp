// SPDX-License-Identifier: Apache-2.0
/// @file  Motions as output: files of gsh, BVH and GLB.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gsh {
struct BodyModel;
struct Motion;
} // namespace gsh

namespace gsh::programs {

/// Throws ValueError, which names the option, unless a path ends in .npz, .bvh or .glb.
void check_motion_output(const std::string& option, const std::filesystem::path& path);

/// Writes a motion, in the format that the path ends in: .bvh, .glb, else .npz. What the format cannot hold is added to `warnings`.
void write_motion(const std::filesystem::path& path, const Motion& motion, const BodyModel& body,
                  std::vector<std::string>& warnings);

} // namespace gsh::programs
