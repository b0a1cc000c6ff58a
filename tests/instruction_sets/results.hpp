// SPDX-License-Identifier: Apache-2.0
/// @file  What one of two translation units computes that are compiled for two instruction sets and linked together.
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
