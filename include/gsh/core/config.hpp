// SPDX-License-Identifier: Apache-2.0
/// @file  Version and the one host/device marker; libraries' doors (GLM, Eigen, xsimd) ask for the compiler, too.
#pragma once

#define GSH_VERSION_MAJOR 0
#define GSH_VERSION_MINOR 1
#define GSH_VERSION_PATCH 0

/// Marks a function that runs on the host and, under nvcc, on the device too.
#if defined(__CUDACC__)
#define GSH_HD __host__ __device__
#else
#define GSH_HD
#endif

/// Marks a function that must melt into its caller: a call would keep the caller's loop from becoming vector code.
#if defined(__GNUC__)
#define GSH_INLINE [[gnu::always_inline]] inline
#else
#define GSH_INLINE inline
#endif

/// Bytes of the widest vector register of the machine that the compiler writes code for.
#if defined(__AVX512F__)
#define GSH_VECTOR_BYTES 64
#elif defined(__AVX__)
#define GSH_VECTOR_BYTES 32
#else
#define GSH_VECTOR_BYTES 16
#endif
