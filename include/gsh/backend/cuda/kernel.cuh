// SPDX-License-Identifier: Apache-2.0
/// @file  Kernels as function objects, and their shared memory.
///
/// A kernel of gsh is a struct with its arguments as members:
///
///     struct SumOfTiles {
///         static constexpr unsigned block_size = 256;     // threads of a block
///         struct Shared { SharedArray<float, 8> sums; };  // optional
///         Span<const float> values;
///         __device__ void operator()(Shared& shared) const;
///     };
///     device.launch(blocks, SumOfTiles{values});
///
/// One __global__ function runs all of them, so a kernel can be copied, compared and repeated with other arguments.
#pragma once

#include <gsh/backend/cuda/error.cuh>
#include <gsh/core/span.hpp>

#include <cuda_runtime.h>

#include <cxxabi.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <string>
#include <string_view>
#include <type_traits>
#include <typeinfo>

namespace gsh::cuda {

inline constexpr unsigned warp_size = 32;
inline constexpr unsigned all_lanes = 0xFFFFFFFFu;

#if defined(GSH_CUDA_EMULATION) // tests/support/cuda_emulation: accesses are checked
template <class T, std::size_t N>
using SharedArray = test::EmulatedSharedArray<T, N>;
#else
/// An array in the shared memory of a block. Elements are read and written as a whole, as in T x = array[i].
template <class T, std::size_t N>
    requires std::is_trivially_copyable_v<T>
struct SharedArray {
    T values[N];
    [[nodiscard]] __device__ T& operator[](std::size_t i) { return values[i]; }
    [[nodiscard]] __device__ const T& operator[](std::size_t i) const { return values[i]; }
    [[nodiscard]] static constexpr __host__ __device__ std::size_t size() { return N; }
};
#endif

/// The same number, as if the compiler did not know it: what follows from it is computed anew, and not kept in
/// registers from before.
[[nodiscard]] __device__ inline unsigned computed_anew(unsigned number) {
#if !defined(GSH_CUDA_EMULATION) && defined(__CUDA_ARCH__)
    asm volatile("" : "+r"(number));
#endif
    return number;
}

/// In front of a loop that must not be unrolled, because its copies would take too many registers.
#if defined(GSH_CUDA_EMULATION)
#define GSH_NO_UNROLL
#else
#define GSH_NO_UNROLL _Pragma("unroll 1")
#endif

namespace detail {

template <class Kernel>
concept HasSharedMemory = requires { typename Kernel::Shared; };

/// The least number of blocks that a multiprocessor must hold at once: limits the registers of a thread.
template <class Kernel>
constexpr unsigned least_blocks() {
    if constexpr (requires { Kernel::least_blocks; }) return Kernel::least_blocks;
    return 1;
}

template <class Kernel>
__global__ void __launch_bounds__(Kernel::block_size, least_blocks<Kernel>())
    run_kernel(const __grid_constant__ Kernel kernel) {
    if constexpr (HasSharedMemory<Kernel>) {
        __shared__ typename Kernel::Shared shared;
        kernel(shared);
    } else {
        kernel();
    }
}

/// Launches a kernel on a stream.
template <class Kernel>
void launch_on(cudaStream_t stream, unsigned blocks, const Kernel& kernel) {
    cudaLaunchConfig_t config{};
    config.gridDim = dim3(blocks);
    config.blockDim = dim3(Kernel::block_size);
    config.stream = stream;
    check(cudaLaunchKernelEx(&config, &run_kernel<Kernel>, kernel), "gsh::cuda::Device::launch");
}

/// body(i) for each index, one thread each.
template <class Body>
struct ForEach {
    static constexpr unsigned block_size = 256;
    Body body;
    std::size_t count;

    __device__ void operator()() const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        if (i < count) body(i);
    }
};

template <class T>
struct Fill {
    Span<T> values;
    T value;
    __device__ void operator()(std::size_t i) const { values[i] = value; }
};

template <class T>
struct Copy {
    Span<const T> from;
    Span<T> to;
    __device__ void operator()(std::size_t i) const { to[i] = from[i]; }
};

/// Bytes that travel as the argument of a kernel. Unlike a copy from host memory, they cannot change before the device
/// reads them, and a recorded step can replace them.
struct SmallUpload {
    static constexpr unsigned block_size = 256;
    static constexpr std::size_t capacity = 2048;
    unsigned char* to;
    unsigned count;
    unsigned char bytes[capacity];

    __device__ void operator()() const {
        for (unsigned i = threadIdx.x; i < count; i += block_size) to[i] = bytes[i];
    }
};

/// The name of a kernel's type without namespaces, "BlendBackward<float>", for reports. ForEach has its body's name.
template <class Kernel>
[[nodiscard]] std::string kernel_name() {
    int status = 0;
    const std::unique_ptr<char, void (*)(void*)> readable(
        abi::__cxa_demangle(typeid(Kernel).name(), nullptr, nullptr, &status), &std::free);
    std::string name = status == 0 ? readable.get() : typeid(Kernel).name();
    // Not std::string::replace, of which GCC 12 warns (-Wrestrict).
    const auto replace = [&name](std::string_view from, std::string_view to) {
        std::string result;
        std::size_t begin = 0;
        for (std::size_t at; (at = name.find(from, begin)) != std::string::npos; begin = at + from.size())
            result.append(name, begin, at - begin).append(to);
        name = result.append(name, begin);
    };
    for (const std::string_view space : {"gsh::", "cuda::", "detail::", "(anonymous namespace)::"}) replace(space, "");
    replace("glm::vec<3, float, (glm::qualifier)0>", "vec3<float>");
    replace("glm::vec<3, double, (glm::qualifier)0>", "vec3<double>");
    replace(" >", ">");
    constexpr std::string_view wrapper = "ForEach<";
    if (name.starts_with(wrapper) && name.ends_with('>'))
        name = name.substr(wrapper.size(), name.size() - wrapper.size() - 1);
    return name;
}

} // namespace detail

} // namespace gsh::cuda
