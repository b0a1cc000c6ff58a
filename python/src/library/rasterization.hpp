// SPDX-License-Identifier: Apache-2.0
/// @file  Rasterization of arrays of Gaussians over batches and cameras, and its adjoint as far as the image plane.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int rasterize(const Sizes&, const SplatArrays&, const CameraArrays&, const ProjectionSettings&,
              const std::int32_t* radii, const ColorArrays&, int with_depth, void* render, void* alphas, void** pass);
int rasterize_backward(void* pass, int threads, const ImageGradients&, const ScreenGradients&);
void release(void* pass);
void release_memory();

} // namespace gsh_python
