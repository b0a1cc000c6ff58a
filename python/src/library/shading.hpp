// SPDX-License-Identifier: Apache-2.0
/// @file  Spherical harmonics of arrays of directions, and covariances of quaternions and scales.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int spherical_harmonics(const ShSizes&, const void* dirs, const void* coeffs, const std::uint8_t* masks, void* colors);
int spherical_harmonics_backward(const ShSizes&, const void* dirs, const void* coeffs, const std::uint8_t* masks,
                                 const void* dL_dcolors, void* dL_ddirs, void* dL_dcoeffs);

} // namespace gsh_python
