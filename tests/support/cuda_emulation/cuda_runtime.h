// SPDX-License-Identifier: Apache-2.0
/// @file  Stands in for CUDA's header of this name: with this folder on the include path, any C++ compiler compiles
///        gsh's .cuh headers, and their kernels run on the host.
#pragma once

#include "support/cuda_emulation/block.hpp"
#include "support/cuda_emulation/intrinsics.hpp"
#include "support/cuda_emulation/runtime.hpp"
#include "support/cuda_emulation/shared_array.hpp"

#include <cmath>

#define GSH_CUDA_EMULATION 1

#define __global__
#define __device__
#define __host__
#define __forceinline__ inline
#define __grid_constant__
#define __launch_bounds__(...)
/// One block runs at a time, so its shared memory may be a static object.
#define __shared__ static
