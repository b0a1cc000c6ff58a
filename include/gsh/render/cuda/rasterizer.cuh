// SPDX-License-Identifier: Apache-2.0
/// @file  The CUDA overloads of Rasterizer, for cuda::Device.
#pragma once

#include <gsh/render/cuda/composite.cuh>
#include <gsh/render/cuda/composite_backward.cuh>
#include <gsh/render/cuda/raster_scratch.cuh>
