// SPDX-License-Identifier: Apache-2.0
/// @file  Includes Eigen's sparse matrices and their solvers, without its compiler warnings.
#pragma once

#include <gsh/math/linalg.hpp>

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Warray-bounds" // see math/linalg.hpp
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif
