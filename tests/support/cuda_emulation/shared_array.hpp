// SPDX-License-Identifier: Apache-2.0
/// @file  Shared memory of a block that notices accesses outside of it, uninitialised reads, and races.
#pragma once

#include "support/cuda_emulation/block.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

namespace gsh::test {

/// An array in shared memory: elements are read and written through [], as a whole.
///
/// Two accesses by different threads race if one of them writes and no barrier lies between: __syncthreads, or
/// __syncwarp if both threads are of one warp.
template <class T, std::size_t N>
    requires std::is_trivially_copyable_v<T>
class EmulatedSharedArray {
public:
    /// Stands for an element: converts to its value and takes assignments.
    class Element {
    public:
        Element(EmulatedSharedArray& array, std::size_t i) : array_(array), i_(i) {}
        operator T() const { return array_.read(i_); }
        const Element& operator=(const T& value) const {
            array_.write(i_, value);
            return *this;
        }
        const Element& operator=(const Element& other) const { return *this = static_cast<T>(other); }
        const Element& operator+=(const T& value) const { return *this = static_cast<T>(array_.read(i_) + value); }
        const Element& operator-=(const T& value) const { return *this = static_cast<T>(array_.read(i_) - value); }
        const Element& operator|=(const T& value) const { return *this = static_cast<T>(array_.read(i_) | value); }

    private:
        EmulatedSharedArray& array_;
        std::size_t i_;
    };

    [[nodiscard]] Element operator[](std::size_t i) {
        check_index(i);
        return {*this, i};
    }
    [[nodiscard]] T operator[](std::size_t i) const { return const_cast<EmulatedSharedArray&>(*this).read(i); }
    [[nodiscard]] static constexpr std::size_t size() { return N; }

    /// change(value) as one operation that nothing interrupts; returns the value before. Atomic operations do not race
    /// with each other.
    template <class Change>
    T atomic(std::size_t i, const Change& change) {
        check_index(i);
        Block& block = *Block::current();
        Access& a = access_[i];
        if (a.serial != block.serial()) block.fail("atomic operation on uninitialised shared memory" + name(i));
        const bool alone = a.writer == block.thread().index + 1 ||
                           ordered(block, a.writer, a.write_epoch, a.write_warp_epoch) || a.atomic;
        if (!alone || !readers_ordered(block, a)) race(block, i, "an atomic operation");
        const T before = values_[i];
        values_[i] = change(before);
        note_write(block, a, true);
        return before;
    }

private:
    /// Who accessed an element last. Threads are numbered from 1; 0 is none.
    struct Access {
        std::uint64_t serial = 0; // of the block that wrote it: other blocks find it uninitialised
        std::uint32_t writer = 0, write_epoch = 0, write_warp_epoch = 0;
        std::uint32_t reader = 0, read_epoch = 0, read_warp_epoch = 0;
        bool many_warps = false; // read by more than one warp in read_epoch
        bool many_lanes = false; // read by more than one lane in read_warp_epoch
        bool atomic = false;     // the last write was an atomic operation
    };

    void check_index(std::size_t i) const {
        if (i >= N)
            Block::current()->fail("shared memory of " + std::to_string(N) + " elements, index " + std::to_string(i));
    }

    /// Whether an access of `thread` at these epochs comes before what the running thread does now.
    static bool ordered(const Block& block, std::uint32_t thread, std::uint32_t epoch, std::uint32_t warp_epoch) {
        if (thread == 0 || epoch != block.epoch()) return true;
        return (thread - 1) / 32 == block.thread().index / 32 && warp_epoch != block.warp_epoch();
    }
    static bool readers_ordered(const Block& block, const Access& a) {
        const std::uint32_t mine = block.thread().index + 1;
        if (a.reader == 0 || a.read_epoch != block.epoch()) return true;
        if (a.many_warps) return false;
        if ((a.reader - 1) / 32 != (mine - 1) / 32) return false;
        return a.read_warp_epoch != block.warp_epoch() || (a.reader == mine && !a.many_lanes);
    }
    static void note_write(const Block& block, Access& a, bool atomic) {
        a.serial = block.serial();
        a.writer = block.thread().index + 1, a.write_epoch = block.epoch(), a.write_warp_epoch = block.warp_epoch();
        a.atomic = atomic;
    }

    T read(std::size_t i) {
        Block& block = *Block::current();
        Access& a = access_[i];
        const std::uint32_t mine = block.thread().index + 1;
        if (a.serial != block.serial()) block.fail("uninitialised shared memory is read" + name(i));
        if (a.writer != mine && !ordered(block, a.writer, a.write_epoch, a.write_warp_epoch)) race(block, i, "a read");
        if (a.reader == 0 || a.read_epoch != block.epoch()) {
            a.many_warps = a.many_lanes = false;
        } else if ((a.reader - 1) / 32 != (mine - 1) / 32) {
            a.many_warps = true;
        } else if (a.read_warp_epoch == block.warp_epoch()) {
            a.many_lanes = a.many_lanes || a.reader != mine;
        } else {
            a.many_lanes = false;
        }
        a.reader = mine, a.read_epoch = block.epoch(), a.read_warp_epoch = block.warp_epoch();
        return values_[i];
    }
    void write(std::size_t i, const T& value) {
        Block& block = *Block::current();
        Access& a = access_[i];
        if (a.serial != block.serial()) a = {}; // the element of a block before
        const std::uint32_t mine = block.thread().index + 1;
        if (a.writer != mine && !ordered(block, a.writer, a.write_epoch, a.write_warp_epoch)) race(block, i, "a write");
        if (!readers_ordered(block, a)) race(block, i, "a write");
        note_write(block, a, false);
        values_[i] = value;
    }

    [[noreturn]] void race(const Block& block, std::size_t i, const char* what) const {
        const Access& a = access_[i];
        block.fail(std::string("race in shared memory: ") + what + " and an access of thread " +
                   std::to_string((a.writer ? a.writer : a.reader) - 1) + " without a barrier between" + name(i));
    }
    static std::string name(std::size_t i) {
        return " (element " + std::to_string(i) + " of " + std::to_string(N) + ")";
    }

    std::array<T, N> values_;
    std::array<Access, N> access_;
};

} // namespace gsh::test
