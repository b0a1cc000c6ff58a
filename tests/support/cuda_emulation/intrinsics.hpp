// SPDX-License-Identifier: Apache-2.0
/// @file  The functions of device code: barriers, exchanges between the lanes of a warp, atomic operations, bits.
#pragma once

#include "support/cuda_emulation/block.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <source_location>
#include <string>
#include <type_traits>

// Barriers ------------------------------------------------------------------------------------------------------------

inline void __syncthreads(const std::source_location& where = std::source_location::current()) {
    gsh::test::Block::current()->wait_for_block("__syncthreads", where);
}
inline void __syncwarp(unsigned mask = ~0u, const std::source_location& where = std::source_location::current()) {
    gsh::test::Block::current()->wait_for_warp("__syncwarp", where, mask);
}
inline float __uint_as_float(std::uint32_t bits) {
    return std::bit_cast<float>(bits);
}
inline std::uint32_t __float_as_uint(float value) {
    return std::bit_cast<std::uint32_t>(value);
}
inline void __threadfence() {}
inline void __threadfence_block() {}

namespace gsh::test {

/// One thread's part in a vote of the block.
struct BlockVote {
    int predicate = 0;
    int count = 0;
    static void combine(const Block::Records& records) {
        int count = 0;
        for (void* record : records) count += static_cast<BlockVote*>(record)->predicate != 0;
        for (void* record : records) static_cast<BlockVote*>(record)->count = count;
    }
};
inline int block_vote(const char* kind, int predicate, const std::source_location& where) {
    BlockVote mine{predicate};
    Block::current()->wait_for_block(kind, where, &mine, &BlockVote::combine);
    return mine.count;
}

/// One lane's part in an exchange: it gives a value and names the lane whose value it takes.
template <class T>
struct Exchange {
    T value;
    unsigned from;
    T result{};
    bool missing = false; // the lane that it names takes no part
    static void combine(const Block::Records& records) {
        for (void* record : records) {
            if (!record) continue;
            auto& mine = *static_cast<Exchange*>(record);
            void* const other = mine.from < records.size() ? records[mine.from] : nullptr;
            if (other) mine.result = static_cast<Exchange*>(other)->value;
            mine.missing = !other;
        }
    }
};
template <class T>
T exchange(const char* kind, unsigned mask, T value, unsigned from, const std::source_location& where) {
    Exchange<T> mine{value, from};
    Block::current()->wait_for_warp(kind, where, mask, &mine, &Exchange<T>::combine);
    if (mine.missing)
        Block::current()->fail(std::string(kind) + ": takes the value of lane " + std::to_string(from) +
                               ", which is not in the mask" + Block::at(where));
    return mine.result;
}
inline unsigned lane() {
    return Block::current()->thread().index % 32;
}

/// One lane's part in a vote or a match of its warp.
template <class T>
struct WarpVote {
    T value;
    std::uint32_t nonzero = 0, equal = 0; // lanes whose value is not zero, and lanes whose value is this lane's
    static void combine(const Block::Records& records) {
        for (std::size_t i = 0; i < records.size(); ++i) {
            if (!records[i]) continue;
            auto& mine = *static_cast<WarpVote*>(records[i]);
            mine.nonzero = mine.equal = 0;
            for (std::size_t j = 0; j < records.size(); ++j) {
                if (!records[j]) continue;
                const T& other = static_cast<WarpVote*>(records[j])->value;
                mine.nonzero |= std::uint32_t(other != T(0)) << j;
                mine.equal |= std::uint32_t(other == mine.value) << j;
            }
        }
    }
};
/// The values of all lanes of a warp, for stand-ins of its matrix instructions.
template <class T>
struct WarpValues {
    T value;
    std::array<T, 32> all{};
    static void combine(const Block::Records& records) {
        std::array<T, 32> values{};
        for (std::size_t i = 0; i < records.size(); ++i) values[i] = static_cast<WarpValues*>(records[i])->value;
        for (void* record : records) static_cast<WarpValues*>(record)->all = values;
    }
};
template <class T>
std::array<T, 32> values_of_warp(const T& value,
                                 const std::source_location& where = std::source_location::current()) {
    WarpValues<T> mine{value};
    Block::current()->wait_for_warp("values_of_warp", where, ~0u, &mine, &WarpValues<T>::combine);
    return mine.all;
}
template <class T>
WarpVote<T> warp_vote(const char* kind, unsigned mask, T value, const std::source_location& where) {
    WarpVote<T> mine{value};
    Block::current()->wait_for_warp(kind, where, mask, &mine, &WarpVote<T>::combine);
    return mine;
}

} // namespace gsh::test

inline int __syncthreads_count(int predicate, const std::source_location& where = std::source_location::current()) {
    return gsh::test::block_vote("__syncthreads_count", predicate, where);
}
inline int __syncthreads_or(int predicate, const std::source_location& where = std::source_location::current()) {
    return gsh::test::block_vote("__syncthreads_or", predicate, where) != 0;
}
inline int __syncthreads_and(int predicate, const std::source_location& where = std::source_location::current()) {
    return gsh::test::block_vote("__syncthreads_and", predicate, where) ==
           static_cast<int>(gsh::test::Block::current()->thread_count());
}

// Exchanges -----------------------------------------------------------------------------------------------------------

template <class T>
T __shfl_sync(unsigned mask, T value, int from, int width = 32,
              const std::source_location& where = std::source_location::current()) {
    const unsigned base = gsh::test::lane() / unsigned(width) * unsigned(width);
    return gsh::test::exchange("__shfl_sync", mask, value, base + unsigned(from) % unsigned(width), where);
}
template <class T>
T __shfl_xor_sync(unsigned mask, T value, int distance, int width = 32,
                  const std::source_location& where = std::source_location::current()) {
    (void)width;
    return gsh::test::exchange("__shfl_xor_sync", mask, value, gsh::test::lane() ^ unsigned(distance), where);
}
/// Lanes beyond the end of the group keep their own value.
template <class T>
T __shfl_down_sync(unsigned mask, T value, unsigned distance, int width = 32,
                   const std::source_location& where = std::source_location::current()) {
    const unsigned mine = gsh::test::lane(), from = mine + distance;
    const bool inside = from / unsigned(width) == mine / unsigned(width);
    return gsh::test::exchange("__shfl_down_sync", mask, value, inside ? from : mine, where);
}
template <class T>
T __shfl_up_sync(unsigned mask, T value, unsigned distance, int width = 32,
                 const std::source_location& where = std::source_location::current()) {
    const unsigned mine = gsh::test::lane();
    const bool inside = mine % unsigned(width) >= distance;
    return gsh::test::exchange("__shfl_up_sync", mask, value, inside ? mine - distance : mine, where);
}

inline unsigned __ballot_sync(unsigned mask, int predicate,
                              const std::source_location& where = std::source_location::current()) {
    return gsh::test::warp_vote("__ballot_sync", mask, int(predicate != 0), where).nonzero;
}
inline int __any_sync(unsigned mask, int predicate,
                      const std::source_location& where = std::source_location::current()) {
    return gsh::test::warp_vote("__any_sync", mask, int(predicate != 0), where).nonzero != 0;
}
inline int __all_sync(unsigned mask, int predicate,
                      const std::source_location& where = std::source_location::current()) {
    return gsh::test::warp_vote("__all_sync", mask, int(predicate == 0), where).nonzero == 0;
}
template <class T>
unsigned __match_any_sync(unsigned mask, T value, const std::source_location& where = std::source_location::current()) {
    return gsh::test::warp_vote("__match_any_sync", mask, value, where).equal;
}

/// The sum (maximum, …) of integers over the lanes of a mask.
inline unsigned __reduce_add_sync(unsigned mask, unsigned value,
                                  const std::source_location& where = std::source_location::current()) {
    struct Sum {
        unsigned value;
        static void combine(const gsh::test::Block::Records& records) {
            unsigned sum = 0;
            for (void* record : records) sum += record ? static_cast<Sum*>(record)->value : 0;
            for (void* record : records)
                if (record) static_cast<Sum*>(record)->value = sum;
        }
    } mine{value};
    gsh::test::Block::current()->wait_for_warp("__reduce_add_sync", where, mask, &mine, &Sum::combine);
    return mine.value;
}

// Atomic operations on integers. Those of floating-point numbers would give results that depend on the order of the
// threads, so there are none: a kernel that has one does not compile here --------------------------------------------

namespace gsh::test {

template <class T>
concept AtomicNumber = std::is_integral_v<T>;

} // namespace gsh::test

template <gsh::test::AtomicNumber T>
T atomicAdd(T* address, std::type_identity_t<T> value) {
    const T before = *address;
    *address = static_cast<T>(before + value);
    return before;
}
template <gsh::test::AtomicNumber T>
T atomicMax(T* address, std::type_identity_t<T> value) {
    const T before = *address;
    if (value > before) *address = value;
    return before;
}
template <gsh::test::AtomicNumber T>
T atomicMin(T* address, std::type_identity_t<T> value) {
    const T before = *address;
    if (value < before) *address = value;
    return before;
}
template <gsh::test::AtomicNumber T>
T atomicOr(T* address, std::type_identity_t<T> value) {
    const T before = *address;
    *address = before | value;
    return before;
}
template <gsh::test::AtomicNumber T>
T atomicExch(T* address, std::type_identity_t<T> value) {
    const T before = *address;
    *address = value;
    return before;
}
template <gsh::test::AtomicNumber T>
T atomicCAS(T* address, std::type_identity_t<T> expected, std::type_identity_t<T> value) {
    const T before = *address;
    if (before == expected) *address = value;
    return before;
}

// Bits and arithmetic -------------------------------------------------------------------------------------------------

inline int __popc(unsigned x) {
    return std::popcount(x);
}
inline int __popcll(unsigned long long x) {
    return std::popcount(x);
}
inline int __clz(int x) {
    return std::countl_zero(static_cast<unsigned>(x));
}
inline int __ffs(int x) {
    return x == 0 ? 0 : std::countr_zero(static_cast<unsigned>(x)) + 1;
}
inline int __ffsll(long long x) {
    return x == 0 ? 0 : std::countr_zero(static_cast<unsigned long long>(x)) + 1;
}
template <class T>
T __ldg(const T* address) {
    return *address;
}
