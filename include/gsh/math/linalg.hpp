// SPDX-License-Identifier: Apache-2.0
/// @file  Includes Eigen, without its compiler warnings, for host code that solves or multiplies large matrices.
#pragma once

#if defined(__CUDACC__) && !defined(EIGEN_NO_CUDA)
#define EIGEN_NO_CUDA // Eigen runs on the host only; its device code does not compile under nvcc without warnings
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Warray-bounds" // GCC 12 analyses packet loops over arrays shorter than a packet
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <Eigen/Core>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif
