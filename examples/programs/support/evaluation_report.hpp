// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-evaluate writes from its results: tables.md, tables.json, picture grids, a page that holds it all.
#pragma once

#include "support/evaluation_pictures.hpp"
#include "support/evaluation_result.hpp"

#include <gsh/pipeline/photo.hpp>

#include <string>
#include <vector>

namespace gsh::examples {

class EvaluationFolder;

/// Writes everything anew from the results, of which there must be some. Each file appears whole.
void write_evaluation(const EvaluationFolder& folder, const std::string& capture,
                      const std::vector<ShownView>& views, const std::vector<Photo>& photos,
                      const std::vector<RunResult>& results);

} // namespace gsh::examples
