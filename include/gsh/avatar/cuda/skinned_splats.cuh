// SPDX-License-Identifier: Apache-2.0
/// @file  Posing Gaussians on the GPU, one Gaussian per thread, and sums of gradients over bones without atomics.
#pragma once

#include <gsh/avatar/cuda/bone_sums.cuh>
#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

template <std::floating_point T>
struct SkinnedSplatsScratch<cuda::Device, T> {
    // Each block's sums over the bones that its Gaussians follow; the rest of it is never written.
    cuda::Device::Buffer<T> bones;              // [blocks, J, 12 or 8 numbers of a bone]
    cuda::Device::Buffer<std::uint64_t> follow; // [J / 64, blocks] a bit for each bone that the block has sums for
    cuda::Device::Buffer<T> center;             // [3, blocks]
};

namespace cuda {

namespace detail {

using gsh::detail::SkinnedSplatBackward;
using gsh::detail::SkinnedSplatForward;

/// Rows of SH coefficients, one per thread, on their way between global memory and registers. A thread that read its
/// own row of 27 numbers would load 32 distant sectors with each instruction of a warp. Here consecutive lanes move
/// consecutive numbers.
template <int Degree, class T>
struct ShRows {
    static constexpr unsigned length = 3 * sh_basis_count(Degree);
    static constexpr unsigned pitch = length | 1u; ///< odd, so that the lanes' rows start in different banks
    static constexpr unsigned block_size = sizeof(T) == 8 && Degree > 2 ? 64 : 128; ///< rows fit in shared memory
    static constexpr unsigned size = block_size * pitch;

    /// A number of a row of the block.
    struct Place {
        unsigned row, number;
        [[nodiscard]] __device__ unsigned in_shared() const { return row * pitch + number; }
        [[nodiscard]] __device__ std::size_t in(std::size_t stride) const {
            return 3 * (std::size_t(blockIdx.x) * block_size + row) * stride + number;
        }
    };

    /// read(at), then write(at, number) for each number of the rows of the warp whose bits are set. A lane reads a
    /// batch before it writes any of it, so that it waits for memory once a batch.
    template <class Read, class Write>
    __device__ static void move(unsigned rows, const Read& read, const Write& write) {
        constexpr unsigned batch = 3 * (Degree + 1); // of Degree + 1 batches
        const unsigned first = threadIdx.x / warp_size * warp_size; // row of the block
        for (unsigned begin = 0; begin < length; begin += batch) {
            T numbers[batch];
            const auto for_each = [&](const auto& body) {
                for (unsigned b = 0; b < batch; ++b) {
                    const unsigned n = (begin + b) * warp_size + threadIdx.x % warp_size, row = n / length;
                    if (rows >> row & 1u) body(Place{first + row, n % length}, numbers[b]);
                }
            };
            for_each([&](const Place& at, T& number) { number = read(at); });
            for_each([&](const Place& at, const T& number) { write(at, number); });
        }
    }
    /// Fills the warp's rows; `stride` is that of the vectors of `sh`.
    template <std::size_t Size>
    __device__ static void load(SharedArray<T, Size>& shared, unsigned rows, Span<const vec3<T>> sh,
                                std::size_t stride) {
        const Span<const T> numbers = view_as<const T>(sh);
        move(
            rows, [&](const Place& at) { return numbers[at.in(stride)]; },
            [&](const Place& at, T number) { shared[at.in_shared()] = number; });
    }
    /// Adds the warp's rows to `sh`.
    template <std::size_t Size>
    __device__ static void add(const SharedArray<T, Size>& shared, unsigned rows, Span<vec3<T>> sh,
                               std::size_t stride) {
        const Span<T> numbers = view_as<T>(sh);
        move(
            rows,
            [&](const Place& at) {
                const T number = shared[at.in_shared()];
                return numbers[at.in(stride)] + number;
            },
            [&](const Place& at, T number) { numbers[at.in(stride)] = number; });
    }
    /// The thread's own row.
    template <std::size_t Size>
    __device__ static void get(const SharedArray<T, Size>& shared, vec3<T>* sh) {
        for (unsigned k = 0; k < length / 3; ++k)
            for (int c = 0; c < 3; ++c) {
                const T value = shared[threadIdx.x * pitch + 3 * k + c];
                sh[k][c] = value;
            }
    }
    template <std::size_t Size>
    __device__ static void put(SharedArray<T, Size>& shared, const vec3<T>* sh) {
        for (unsigned k = 0; k < length / 3; ++k)
            for (int c = 0; c < 3; ++c) shared[threadIdx.x * pitch + 3 * k + c] = sh[k][c];
    }
};

template <int Degree, class T, class D>
struct PoseSkinned {
    using Rows = ShRows<Degree, T>;
    static constexpr unsigned block_size = Rows::block_size;
    struct Shared {
        SharedArray<T, Rows::size> sh;
    };
    SkinnedSplatForward<Degree, T, D> element;

    __device__ void operator()(Shared& shared) const {
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        const bool exists = i < element.input.gaussians.size();
        Rows::load(shared.sh, __ballot_sync(all_lanes, exists), element.input.gaussians.sh, element.input.sh_stride);
        __syncwarp();
        if (!exists) return;
        vec3<T> sh[sh_basis_count(Degree)];
        Rows::get(shared.sh, sh);
        element.splats.set(i, SkinnedGaussian<Degree, D>::forward(element.input.with_sh(i, sh), element.clamping));
    }
};

template <int Degree, class T, class D>
struct BackwardSkinned {
    using Rows = ShRows<Degree, T>;
    using Bone = typename D::template Bone<T>;
    static constexpr unsigned block_size = Rows::block_size, warps = block_size / warp_size;
    using Sums = BoneSums<T, Bone, block_size>;
    struct Shared {
        SharedArray<T, (Rows::size > Sums::size ? Rows::size : Sums::size)> rows_then_sums;
        SharedArray<std::uint64_t, warps> follow;
        SharedArray<T, 3 * warps> center;
    };
    SkinnedSplatBackward<Degree, T, D> element;
    Span<T> bones;              // [blocks, J, numbers]
    Span<std::uint64_t> follow; // [pages, blocks], empty if no bones are wanted
    Span<T> center;             // [3, blocks] or empty

    __device__ void operator()(Shared& shared) const {
        const auto& in = element.input;
        const std::size_t i = std::size_t(blockIdx.x) * block_size + threadIdx.x;
        const bool seen = i < in.gaussians.size() && !element.unseen(i);
        Bone dL_dblend = Bone::zero();
        vec3<T> dL_dcenter(T(0));
        if (const unsigned rows = __ballot_sync(all_lanes, seen)) {
            Rows::load(shared.rows_then_sums, rows, in.gaussians.sh, in.sh_stride);
            __syncwarp();
            if (seen) adjoint(shared, i, dL_dblend, dL_dcenter);
            __syncwarp();
            if (!element.dL_dgaussians.sh.empty())
                Rows::add(shared.rows_then_sums, rows, element.dL_dgaussians.sh, element.dL_dsh_stride);
        }
        if (!center.empty()) sum_center(shared, dL_dcenter);
        for (std::size_t page = 0; page * gridDim.x < follow.size(); ++page) {
            __syncthreads(); // the rows, or the sums of the page before, have been read
            sum_bones(shared, i, seen, dL_dblend, page);
        }
    }

private:
    __device__ void adjoint(Shared& shared, std::size_t i, Bone& dL_dblend, vec3<T>& dL_dcenter) const {
        using Gaussian = SkinnedGaussian<Degree, D>;
        vec3<T> sh[Gaussian::basis_count], dL_dsh[Gaussian::basis_count];
        Rows::get(shared.rows_then_sums, sh);
        for (vec3<T>& value : dL_dsh) value = vec3<T>(T(0));
        typename Gaussian::template Gradient<T> gradient;
        gradient.sh = dL_dsh;
        Gaussian::backward(element.input.with_sh(i, sh), element.clamping, element.dL_dsplats[i], gradient);
        Rows::put(shared.rows_then_sums, dL_dsh);
        element.add(i, gradient);
        dL_dblend = gradient.blend;
        dL_dcenter = gradient.center;
    }

    __device__ void sum_center(Shared& shared, const vec3<T>& dL_dcenter) const {
        const T numbers[3] = {dL_dcenter.x, dL_dcenter.y, dL_dcenter.z};
        const unsigned warp = threadIdx.x / warp_size;
        sum_lanes(numbers, [&](unsigned c, T sum) { shared.center[3 * warp + c] = sum; });
        __syncthreads();
        if (threadIdx.x >= 3) return;
        T total(0);
        for (unsigned w = 0; w < warps; ++w) {
            const T sum = shared.center[3 * w + threadIdx.x];
            total += sum;
        }
        center[threadIdx.x * std::size_t(gridDim.x) + blockIdx.x] = total;
    }

    __device__ void sum_bones(Shared& shared, std::size_t i, bool seen, const Bone& dL_dblend, std::size_t page) const {
        const auto& in = element.input;
        const std::size_t first_bone = page * Sums::page, J = in.bones.size();
        const std::uint64_t of_warp =
            Sums::of_warp(shared.rows_then_sums, in.gaussians.weights, in.bones, i, seen, dL_dblend, first_bone);
        if (threadIdx.x % warp_size == 0) shared.follow[threadIdx.x / warp_size] = of_warp;
        __syncthreads();
        std::uint64_t have[warps], any = 0;
        for (unsigned w = 0; w < warps; ++w) {
            const std::uint64_t bits = shared.follow[w];
            have[w] = bits, any |= bits;
        }
        if (threadIdx.x == 0) follow[page * gridDim.x + blockIdx.x] = any;
        const std::size_t count = (J - first_bone < Sums::page ? J - first_bone : Sums::page) * Sums::numbers;
        for (unsigned n = threadIdx.x; n < count; n += block_size) {
            const unsigned bone = n / Sums::numbers;
            if (!(any >> bone & 1u)) continue;
            T sum(0);
            for (unsigned w = 0; w < warps; ++w)
                if (have[w] >> bone & 1u) {
                    const T value = shared.rows_then_sums[w * Sums::page * Sums::numbers + n];
                    sum += value;
                }
            bones[(blockIdx.x * J + first_bone) * Sums::numbers + n] = sum;
        }
    }
};

} // namespace detail

template <int Degree, class T, class D>
void skinned_splats_pose(Device& device, const gsh::detail::SkinnedSplatForward<Degree, T, D>& element) {
    using Kernel = detail::PoseSkinned<Degree, T, D>;
    device.launch(chunk_count(element.input.gaussians.size(), Kernel::block_size), Kernel{element});
}

/// Adds the adjoints of all Gaussians with a gradient. One kernel computes them and sums over bones block by block; a
/// second one adds the blocks, in fixed order.
template <int Degree, class T, class D>
void skinned_splats_accumulate(Device& device, const gsh::detail::SkinnedSplatBackward<Degree, T, D>& element,
                               Span<typename D::template Bone<T>> dL_dbones, Span<vec3<T>> dL_dcenter,
                               SkinnedSplatsScratch<Device, T>& scratch) {
    using Kernel = detail::BackwardSkinned<Degree, T, D>;
    using Bone = typename D::template Bone<T>;
    const std::size_t blocks = chunk_count(element.input.gaussians.size(), Kernel::block_size), J = dL_dbones.size();
    if (blocks == 0) return;
    scratch.bones.resize(blocks * J * Kernel::Sums::numbers);
    scratch.follow.resize(chunk_count(J, Kernel::Sums::page) * blocks);
    scratch.center.resize(dL_dcenter.empty() ? 0 : 3 * blocks);
    device.launch(blocks, Kernel{element, scratch.bones, scratch.follow, scratch.center});
    device.launch(J + dL_dcenter.size(), detail::JoinBones<T, Bone>{scratch.bones, scratch.follow, scratch.center,
                                                                    blocks, dL_dbones, dL_dcenter});
}

} // namespace cuda

} // namespace gsh
