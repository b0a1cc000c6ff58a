// SPDX-License-Identifier: Apache-2.0
/// @file  The output files of gsh-evaluate: tables.md, tables.json, picture grids, and a page with all of them.
#pragma once

#include "evaluate/evaluation_pictures.hpp"
#include "evaluate/evaluation_result.hpp"

#include <gsh/photo/photo.hpp>

#include <string>
#include <vector>

namespace gsh::programs {

class EvaluationFolder;

/// Rewrites all output files from the results, of which there must be at least one: all of them or none.
void write_evaluation(const EvaluationFolder& folder, const std::string& capture, const std::vector<ShownView>& views,
                      const std::vector<Photo>& photos, const std::vector<RunResult>& results);

} // namespace gsh::programs
