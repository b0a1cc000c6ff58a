// SPDX-License-Identifier: Apache-2.0
/// @file  Version, the host/device marker, and the instruction set that the compiler targets.
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

/// Forces a function to be inlined. A remaining call would keep the loop of the caller from being vectorised.
#if defined(__GNUC__)
#define GSH_INLINE [[gnu::always_inline]] inline
#else
#define GSH_INLINE inline
#endif

/// Size in bytes of the widest vector register of the target machine.
#if defined(__AVX512F__)
#define GSH_VECTOR_BYTES 64
#elif defined(__AVX__)
#define GSH_VECTOR_BYTES 32
#else
#define GSH_VECTOR_BYTES 16
#endif

/// Name of the target instruction set, and of the inline namespace of all code that depends on it.
///
/// The layout and the rounding of lanes (Wide) and of the CPU backends' kernels depend on the instruction set:
/// registers are wider, rows are padded to whole registers, and a product and a sum become one instruction. Without the
/// namespace, two translation units compiled for two instruction sets would define the same functions in two ways, and
/// the linker would keep whichever definition comes first. With it each unit keeps its own definitions, and
/// gsh::cpu::Serial is a different type in each. Plain host data, such as vec3, Camera or Gaussians, has the same type
/// in both.
#if defined(__AVX512F__) && defined(__AMX_BF16__)
#define GSH_ISA avx512_amx
#elif defined(__AVX512F__) && defined(__AVX512BF16__)
#define GSH_ISA avx512_bf16
#elif defined(__AVX512F__)
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

/// The value of a macro as text: GSH_TEXT(GSH_ISA) is "avx2".
#define GSH_TEXT_OF(tokens) #tokens
#define GSH_TEXT(macro) GSH_TEXT_OF(macro)

/// The version as text: "0.1.0".
#define GSH_VERSION_TEXT GSH_TEXT(GSH_VERSION_MAJOR) "." GSH_TEXT(GSH_VERSION_MINOR) "." GSH_TEXT(GSH_VERSION_PATCH)
