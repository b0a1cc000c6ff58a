// SPDX-License-Identifier: Apache-2.0
/// @file  Projection of arrays of Gaussians, and its adjoint.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int project(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&, const ProjectedArrays&);
int project_backward(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&,
                     const std::int32_t* radii, const ProjectedGradients&, const SplatGradients&,
                     const CameraGradients&);

} // namespace gsh_python
