// SPDX-License-Identifier: Apache-2.0
/// @file  Forward kinematics on the GPU: one block, a thread per joint, joints of the same depth at the same time.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>

namespace gsh::cuda {

namespace detail {

/// As many joints as a block has threads. SMPL-X has 55; a chain of more is run by one thread.
inline constexpr unsigned most_chain_joints = 128;

/// An affine map for each joint, number by number, so that neighbouring joints lie in different banks.
template <class T>
struct SharedAffines {
    SharedArray<T, 12 * most_chain_joints> numbers;

    [[nodiscard]] __device__ Affine<T> get(unsigned joint) const {
        Affine<T> map;
        for (int c = 0; c < 4; ++c)
            for (int r = 0; r < 3; ++r) {
                const T value = numbers[static_cast<unsigned>(3 * c + r) * most_chain_joints + joint];
                (c < 3 ? map.linear[c] : map.translation)[r] = value;
            }
        return map;
    }
    __device__ void set(unsigned joint, const Affine<T>& map) {
        for (int c = 0; c < 4; ++c)
            for (int r = 0; r < 3; ++r)
                numbers[static_cast<unsigned>(3 * c + r) * most_chain_joints + joint] =
                    (c < 3 ? map.linear[c] : map.translation)[r];
    }
};

/// R (x - J) + J.
template <class T>
[[nodiscard]] __device__ Affine<T> about_joint(const mat3<T>& rotation, const vec3<T>& joint) {
    return {rotation, joint - rotation * joint};
}

/// The number of ancestors of joint j, whose parent is given.
template <std::size_t Size>
[[nodiscard]] __device__ int joint_depth(const SharedArray<int, Size>& parents, int parent) {
    int depth = 0;
    while (parent >= 0) {
        ++depth;
        const int above = parents[static_cast<unsigned>(parent)];
        parent = above;
    }
    return depth;
}

/// bone_transforms: the same operations for each joint, level by level from the root.
template <class T>
struct BoneChain {
    static constexpr unsigned block_size = most_chain_joints;
    struct Shared {
        SharedArray<int, block_size> parents;
        SharedAffines<T> bones;
    };
    gsh::detail::BoneTransforms<T> chain;

    __device__ void operator()(Shared& shared) const {
        const unsigned j = threadIdx.x;
        const bool exists = j < chain.parents.size();
        const int parent = exists ? chain.parents[j] : -1;
        Affine<T> bone;
        if (exists) bone = about_joint(chain.rotations[j], chain.joints[j]);
        shared.parents[j] = parent;
        __syncthreads();
        const int depth = exists ? joint_depth(shared.parents, parent) : -1;
        for (int level = 0; __syncthreads_or(depth >= level); ++level) {
            if (depth != level) continue;
            if (parent < 0)
                bone.translation = bone.translation + chain.transl[0];
            else
                bone = shared.bones.get(static_cast<unsigned>(parent)) * bone;
            shared.bones.set(j, bone);
        }
        if (exists) chain.bones[j] = bone;
    }
};

/// bone_transforms_backward: the same operations for each joint, level by level towards the root. A parent adds what
/// its children pass to it in the order of the loop on the host, the last child first.
template <class T>
struct BoneChainBackward {
    static constexpr unsigned block_size = most_chain_joints;
    struct Shared {
        SharedArray<int, block_size> parents, next_siblings; // the next smaller child of the same parent, or -1
        SharedAffines<T> to_parents;
    };
    gsh::detail::BoneTransformsBackward<T> chain;

    __device__ void operator()(Shared& shared) const {
        const unsigned j = threadIdx.x;
        const bool exists = j < chain.parents.size();
        const int parent = exists ? chain.parents[j] : -1;
        Affine<T> dL_dbone, about, bone_of_parent;
        if (exists) {
            dL_dbone = chain.dL_dbones[j];
            about = about_joint(chain.rotations[j], chain.joints[j]);
            if (parent >= 0) bone_of_parent = chain.bones[static_cast<unsigned>(parent)];
        }
        shared.parents[j] = parent;
        __syncthreads();
        const int depth = exists ? joint_depth(shared.parents, parent) : -1;
        const int last_child = link(shared, j, parent);
        int level = 0;
        while (__syncthreads_or(depth >= level)) ++level;
        for (--level; level >= 0; --level) {
            if (depth == level) {
                Affine<T> dL_dabout = Affine<T>::zero();
                for (int child = last_child; child >= 0;) {
                    dL_dbone.add_scaled(shared.to_parents.get(static_cast<unsigned>(child)), T(1));
                    const int next = shared.next_siblings[static_cast<unsigned>(child)];
                    child = next;
                }
                if (parent < 0) {
                    dL_dabout = dL_dbone;
                    chain.dL_dtransl[0] += dL_dbone.translation; // a skeleton has one root
                } else {
                    Affine<T> dL_dparent = Affine<T>::zero();
                    product_backward(bone_of_parent, about, dL_dbone, dL_dparent, dL_dabout);
                    shared.to_parents.set(j, dL_dparent);
                }
                chain.dL_drotations[j] += dL_dabout.linear - outer(dL_dabout.translation, chain.joints[j]);
                chain.dL_djoints[j] += dL_dabout.translation - transposed_times(about.linear, dL_dabout.translation);
            }
            __syncthreads();
        }
    }

private:
    /// Writes the joint's next sibling and returns its last child.
    __device__ int link(Shared& shared, unsigned j, int parent) const {
        int last_child = -1, sibling = -1;
        for (int other = 0; other < static_cast<int>(chain.parents.size()); ++other) {
            const int of_other = shared.parents[static_cast<unsigned>(other)];
            if (of_other == static_cast<int>(j)) last_child = other;
            if (of_other == parent && other < static_cast<int>(j)) sibling = other;
        }
        shared.next_siblings[j] = parent < 0 ? -1 : sibling;
        return last_child;
    }
};

} // namespace detail

/// A level of the skeleton takes about a hundred cycles in place of some thousand for each joint of it, since what a
/// joint passes on stays in shared memory.
template <class T>
void bone_chain(Device& device, const gsh::detail::BoneTransforms<T>& chain) {
    if (chain.parents.size() > detail::most_chain_joints)
        device.for_each(1, chain);
    else if (!chain.parents.empty())
        device.launch(1, detail::BoneChain<T>{chain});
}

template <class T>
void bone_chain_backward(Device& device, const gsh::detail::BoneTransformsBackward<T>& chain) {
    if (chain.parents.size() > detail::most_chain_joints)
        device.for_each(1, chain);
    else if (!chain.parents.empty())
        device.launch(1, detail::BoneChainBackward<T>{chain});
}

} // namespace gsh::cuda
