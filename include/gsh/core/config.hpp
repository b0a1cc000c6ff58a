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

/// Name of the instruction set that the compiler writes code for, and of the inline namespace of what depends on it.
///
/// Lanes (Wide) and the work of the CPU backends differ in layout and in rounding from one set to the next: registers
/// are wider, rows are padded to whole registers, a product and a sum become one instruction. Without the namespace,
/// two translation units compiled for two sets define the same functions in two ways, and the linker keeps one of each,
/// whichever comes first. With it each unit keeps its own, and gsh::cpu::Serial of one unit is another type than that
/// of the other. Plain data, such as vec3, Camera or Gaussians on the host, is the same in both.
#if defined(__AVX512F__)
#define GSH_ISA avx512
#elif defined(__AVX2__) && defined(__FMA__)
#define GSH_ISA avx2
#elif defined(__AVX__) && defined(__FMA__)
#define GSH_ISA avx_fma
#elif defined(__AVX__)
#define GSH_ISA avx
#elif defined(__SSE4_1__)
#define GSH_ISA sse4
#else
#define GSH_ISA baseline
#endif
