// SPDX-License-Identifier: Apache-2.0
/// @file  Posing Gaussians on the CPU, with one Gaussian in each lane of a vector register.
#pragma once

#include <gsh/avatar/skinned_gaussian.hpp>
#include <gsh/avatar/skinned_splats.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/skinning.hpp>
#include <gsh/core/config.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/cpu/gaussian_lanes.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/dual_quat.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_block.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <CpuBackend B, std::floating_point T>
struct SkinnedSplatsScratch<B, T> {
    typename B::template Buffer<Affine<T>> dL_dbones;          // [chunks, J]
    typename B::template Buffer<dual_quat<T>> dL_ddual_bones;  // [chunks, J], used if bones are dual quaternions
    typename B::template Buffer<vec3<T>> dL_dcenters;          // [chunks]

    /// The sums of each chunk over bones of the given type.
    [[nodiscard]] auto& chunk_bones(const Affine<T>*) { return dL_dbones; }
    [[nodiscard]] auto& chunk_bones(const dual_quat<T>*) { return dL_ddual_bones; }
};

namespace cpu::inline GSH_ISA {

namespace detail {

using gsh::detail::SkinnedInput;
using gsh::detail::SkinnedSplatBackward;
using gsh::detail::SkinnedSplatForward;

/// The numbers of a bone (twelve of an affine map, eight of a dual quaternion) as rows of four, so that sums over any
/// number of bones stay in registers. It is a Sum of blend_in and blend_backward_in, body/skinning.hpp.
template <class T, class Bone>
struct BoneRegisters {
    using Row = Wide<T, 4>;
    static constexpr std::size_t count = sizeof(Bone) / (4 * sizeof(T));
    static_assert(sizeof(Bone) == count * 4 * sizeof(T));
    Row rows[count];

    [[nodiscard]] GSH_INLINE static BoneRegisters zero() { return BoneRegisters(Bone::zero()); }
    GSH_INLINE explicit BoneRegisters(const Bone& bone) {
        for (std::size_t k = 0; k < count; ++k) rows[k] = Row::load(reinterpret_cast<const T*>(&bone) + 4 * k);
    }
    [[nodiscard]] GSH_INLINE explicit operator Bone() const {
        Bone bone;
        for (std::size_t k = 0; k < count; ++k) rows[k].store(reinterpret_cast<T*>(&bone) + 4 * k);
        return bone;
    }
    GSH_INLINE void add_scaled(const BoneRegisters& other, T scale) {
        for (std::size_t k = 0; k < count; ++k) rows[k] += other.rows[k] * scale;
    }
};

/// A loop over lanes reads all attributes of a few Gaussians. One loop per attribute takes 6% longer.
template <int Degree, class T, class D>
struct SkinnedBlock : WideBlock<T> {
    using typename WideBlock<T>::W;
    using WideBlock<T>::count, WideBlock<T>::index, WideBlock<T>::width;
    using Gaussian = SkinnedGaussian<Degree, D>;
    using Bone = typename D::template Bone<T>;
    using Registers = BoneRegisters<T, Bone>;

    void forward(const SkinnedSplatForward<Degree, T, D>& element) {
        if (!this->fill()) return;
        read(element.input);
        const auto out = Gaussian::forward(in_, element.clamping);
        for (std::size_t lane = 0; lane < count; ++lane) get_splat<T>(out, lane, element.splats, index[lane]);
        count = 0;
    }

    void backward(const SkinnedSplatBackward<Degree, T, D>& element, Span<Bone> dL_dbones, vec3<T>& dL_dcenter) {
        if (!this->fill()) return;
        read(element.input);
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>)
            put_splats<T>(dL_dout_, lane, index + lane, element.dL_dsplats);
        typename Gaussian::template Gradient<W> gradient;
        vec3<W> dL_dsh[Gaussian::basis_count];
        for (vec3<W>& value : dL_dsh) value = vec3<W>(W(T(0)));
        gradient.sh = dL_dsh;
        Gaussian::backward(in_, element.clamping, dL_dout_, gradient);

        const auto& out = element.dL_dgaussians;
        for (std::size_t lane = 0; lane < count; ++lane) {
            const std::size_t i = index[lane];
            add_attributes<T>(gradient, lane, out, i);
            if (!out.ao.empty()) add_lane<T>(gradient.ao, lane, out.ao[i]);
            if (!out.sh.empty())
                for (std::size_t k = 0; k < Gaussian::basis_count; ++k)
                    add_lane<T>(dL_dsh[k], lane, out.sh[i * element.dL_dsh_stride + k]);
            if (!dL_dbones.empty()) {
                Bone dL_dblend;
                get_lane<T>(gradient.blend, lane, dL_dblend);
                blend_backward_in<Registers>(element.input.gaussians.weights, i, element.input.bones, dL_dblend,
                                             dL_dbones);
            }
            add_lane<T>(gradient.center, lane, dL_dcenter);
        }
        count = 0;
    }

private:
    typename Gaussian::template Input<W> in_;
    typename Gaussian::template Output<W> dL_dout_;
    vec3<W> sh_[Gaussian::basis_count];

    void read(const SkinnedInput<Degree, T, D>& input) {
        const auto& from = input.gaussians;
        in_.sh = sh_;
        in_.ao = W(T(1));
        const vec3<T> center = input.center();
        in_.center = vec3<W>(W(center.x), W(center.y), W(center.z));
        for (std::size_t lane = 0; lane < width; lane += lanes_per_store<T>) {
            const std::size_t* i = index + lane;
            put_attributes<T>(in_, lane, i, from);
            if (!from.ao.empty()) put_lanes<T>(in_.ao, lane, [&](std::size_t j) -> auto& { return from.ao[i[j]]; });
            put_lanes<T>(sh_, lane, [&](std::size_t j) -> const vec3<T>(&)[Gaussian::basis_count] {
                return reinterpret_cast<const vec3<T>(&)[Gaussian::basis_count]>(from.sh[i[j] * input.sh_stride]);
            });
            Bone blends[lanes_per_store<T>];
            for (std::size_t j = 0; j < lanes_per_store<T>; ++j)
                blends[j] = blend_in<Registers>(from.weights, i[j], input.bones);
            put_lanes<T>(in_.blend, lane, [&](std::size_t j) -> auto& { return blends[j]; });
        }
    }
};

} // namespace detail

template <CpuBackend B, int Degree, class T, class D>
void skinned_splats_pose(B& backend, const gsh::detail::SkinnedSplatForward<Degree, T, D>& element) {
    detail::for_blocks<detail::SkinnedBlock<Degree, T, D>>(backend, element.input.gaussians.size(), element);
}

/// Adds the adjoints of all Gaussians with a gradient. Each fixed chunk sums its Gaussians, in order, into its own
/// bones and centre. The sums of the chunks are added in order, so the result does not depend on the assignment of
/// chunks to threads.
template <CpuBackend B, int Degree, class T, class D>
void skinned_splats_accumulate(B& backend, const gsh::detail::SkinnedSplatBackward<Degree, T, D>& element,
                               Span<typename D::template Bone<T>> dL_dbones, Span<vec3<T>> dL_dcenter,
                               SkinnedSplatsScratch<B, T>& scratch) {
    using Bone = typename D::template Bone<T>;
    constexpr std::size_t grain = 2048;
    const std::size_t count = element.input.gaussians.size(), chunks = chunk_count(count, grain);
    const std::size_t J = dL_dbones.size();
    auto& chunk_bones = scratch.chunk_bones(static_cast<const Bone*>(nullptr));
    chunk_bones.resize(chunks * J);
    scratch.dL_dcenters.resize(chunks);
    backend.for_chunks(count, grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
        const auto mine = element;
        const auto bones = Span<Bone>(chunk_bones).subspan(chunk * J, J);
        for (auto& bone : bones) bone = Bone::zero();
        vec3<T> center(T(0));
        detail::SkinnedBlock<Degree, T, D> block;
        for (std::size_t i = begin; i < end; ++i)
            if (!mine.unseen(i) && block.push(i)) block.backward(mine, bones, center);
        block.backward(mine, bones, center);
        scratch.dL_dcenters[chunk] = center;
    });
    for (std::size_t chunk = 0; chunk < chunks; ++chunk) {
        for (std::size_t j = 0; j < J; ++j) dL_dbones[j].add_scaled(chunk_bones[chunk * J + j], T(1));
        if (!dL_dcenter.empty()) dL_dcenter[0] += scratch.dL_dcenters[chunk];
    }
}

} // namespace cpu

} // namespace gsh
