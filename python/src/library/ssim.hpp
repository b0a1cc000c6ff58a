// SPDX-License-Identifier: Apache-2.0
/// @file  The structural similarity of images, with its gradient.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int ssim(const SsimSizes&, const void* a, const void* b, double* value, void* da);

} // namespace gsh_python
