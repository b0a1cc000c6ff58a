// SPDX-License-Identifier: Apache-2.0
/// @file  The door to Eigen: host code that solves or multiplies large things includes this, and it keeps nvcc quiet.
#pragma once

#if defined(__CUDACC__) && !defined(EIGEN_NO_CUDA)
#define EIGEN_NO_CUDA // we solve on the host; Eigen's own device code does not pass nvcc without warnings
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Warray-bounds" // GCC 12 follows packet loops into arrays too short to have a packet
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <Eigen/Core>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif
