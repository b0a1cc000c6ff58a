// SPDX-License-Identifier: Apache-2.0
/// @file  What a program does with what a reader accepted. Each use ends, and its results are finite.
#pragma once

#include "fuzz/scratch.hpp"
#include "fuzz/target.hpp"

#include <gsh/avatar/avatar.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/input_file.hpp>

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::fuzz {

/// Bodies of few vertices with the joints of SMPL-X and of SMPL.
[[nodiscard]] const BodyModel& small_smplx();
[[nodiscard]] const BodyModel& small_smpl();

/// Rasterizes a cloud at 64 × 64, from a camera that sees all of it.
void use(const GaussianCloud<float>& cloud);

/// Poses the mesh of a body, and a second time with every joint bent.
void use(const BodyModel& body);

/// Poses the joints of a body in the first and the last frame.
void use(const Motion& motion, const BodyModel& body);

/// Poses an avatar at rest and bent, and draws it at 64 × 64.
void use(const AvatarData& avatar);

/// Warnings are shown to users as they are: each is a short line of printable text.
void check_warnings(const std::vector<std::string>& warnings);

/// Writes a value, reads it, and writes it again: both files must have the same bytes. `name` has the ending.
template <class Value, class Write, class Read>
void must_come_back(std::string_view name, const Value& value, const Write& write, const Read& read) {
    const std::filesystem::path first = scratch() / ("1_" + std::string(name)),
                                second = scratch() / ("2_" + std::string(name));
    write(first, value);
    write(second, read(first));
    must(read_file(first) == read_file(second), "what is written again and read again differs");
}

} // namespace gsh::fuzz
