// SPDX-License-Identifier: Apache-2.0
/// @file  The results of a translation unit. Two such units for two instruction sets are linked into one program.
#pragma once

#include <cstddef>
#include <vector>

namespace gsh::test {

struct SetResults {
    const char* instruction_set;
    std::size_t vector_bytes;
    std::vector<double> posed;     ///< splats of skinned Gaussians and their adjoint: work over Wide
    std::vector<double> field;     ///< outputs of a hash field and its adjoint: rows padded to whole registers
    std::vector<double> rasterized; ///< a picture and the gradient of its splats
};

SetResults native_results();
SetResults baseline_results();

} // namespace gsh::test
