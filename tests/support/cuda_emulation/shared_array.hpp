// SPDX-License-Identifier: Apache-2.0
/// @file  Shared memory of a block that notices accesses outside of it, uninitialised reads, and races.
#pragma once

#include "support/cuda_emulation/block.hpp"
#include "support/cuda_emulation/intrinsics.hpp"

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

namespace gsh::test {

/// The threads that accessed an element in one way, of those that no barrier orders.
class Accesses {
public:
    /// A thread among them that the running thread does not know of, numbered from 1; 0 if there is none. All lanes
    /// count as if they had accessed the element when the last one did.
    [[nodiscard]] std::uint32_t unknown(const Block& block) const {
        if (last_.thread == 0 || last_.epoch != block.epoch()) return 0;
        if (elsewhere_ != 0) return block.knows(last_) ? elsewhere_ : last_.thread;
        const std::uint32_t first = (last_.thread - 1) / 32 * 32 + 1;
        for (std::uint32_t rest = lanes_; rest != 0; rest &= rest - 1) {
            const std::uint32_t thread = first + static_cast<std::uint32_t>(std::countr_zero(rest));
            if (!block.knows({thread, last_.epoch, last_.date})) return thread;
        }
        return 0;
    }
    /// The running thread accesses the element. If it knows of all before, these need not be kept: who knows of it,
    /// knows of them.
    void add(const Block& block) {
        const Moment now = block.now();
        const std::uint32_t lane = 1u << (now.thread - 1) % 32;
        if (unknown(block) == 0)
            lanes_ = lane, elsewhere_ = 0;
        else if ((last_.thread - 1) / 32 == (now.thread - 1) / 32)
            lanes_ |= lane;
        else
            lanes_ = lane, elsewhere_ = last_.thread;
        last_ = now;
    }

private:
    Moment last_;
    std::uint32_t lanes_ = 0;     // of the last one's warp
    std::uint32_t elsewhere_ = 0; // a thread of another warp, if there is one
};

/// An array in shared memory: elements are read and written through [], as a whole.
///
/// Two accesses by different threads race if one of them writes and no barrier lies between: __syncthreads, or
/// __syncwarp if both threads are of one warp and in its mask.
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
        requires AtomicNumber<T>
    T atomic(std::size_t i, const Change& change) {
        check_index(i);
        Block& block = *Block::current();
        Access& a = access_[i];
        if (a.serial != block.serial()) block.fail("atomic operation on uninitialised shared memory" + name(i));
        check(block, i, "an atomic operation", "a write", a.write);
        check(block, i, "an atomic operation", "a read", a.reads);
        const T before = values_[i];
        values_[i] = change(before);
        a.atomics.add(block);
        return before;
    }

private:
    /// Who accessed an element.
    struct Access {
        std::uint64_t serial = 0; // of the block that wrote it: other blocks find it uninitialised
        Moment write;
        Accesses reads, atomics;
    };

    void check_index(std::size_t i) const {
        if (i >= N)
            Block::current()->fail("shared memory of " + std::to_string(N) + " elements, index " + std::to_string(i));
    }

    T read(std::size_t i) {
        Block& block = *Block::current();
        Access& a = access_[i];
        if (a.serial != block.serial()) block.fail("uninitialised shared memory is read" + name(i));
        check(block, i, "a read", "a write", a.write);
        check(block, i, "a read", "an atomic operation", a.atomics);
        a.reads.add(block);
        return values_[i];
    }
    void write(std::size_t i, const T& value) {
        Block& block = *Block::current();
        Access& a = access_[i];
        if (a.serial != block.serial()) a = {}; // the element of a block before
        check(block, i, "a write", "a write", a.write);
        check(block, i, "a write", "a read", a.reads);
        check(block, i, "a write", "an atomic operation", a.atomics);
        a.serial = block.serial(), a.write = block.now();
        values_[i] = value;
    }

    /// The running thread must know of accesses before.
    static void check(const Block& block, std::size_t i, const char* what, const char* before, const Moment& access) {
        if (!block.knows(access)) race(block, i, what, before, access.thread);
    }
    static void check(const Block& block, std::size_t i, const char* what, const char* before, const Accesses& all) {
        if (const std::uint32_t thread = all.unknown(block)) race(block, i, what, before, thread);
    }
    [[noreturn]] static void race(const Block& block, std::size_t i, const char* what, const char* before,
                                  std::uint32_t thread) {
        block.fail(std::string("race in shared memory: ") + what + " and " + before + " of thread " +
                   std::to_string(thread - 1) + " without a barrier between" + name(i));
    }
    static std::string name(std::size_t i) {
        return " (element " + std::to_string(i) + " of " + std::to_string(N) + ")";
    }

    std::array<T, N> values_;
    std::array<Access, N> access_;
};

} // namespace gsh::test
