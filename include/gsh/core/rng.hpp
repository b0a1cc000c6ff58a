// SPDX-License-Identifier: Apache-2.0
/// @file  Counter-based random numbers: a seed and a counter give the same number on every machine.
#pragma once

#include <gsh/core/config.hpp>

#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

namespace gsh {

/// Mixes 64 bits well enough that consecutive counters look independent.
/// Source  Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators", 2014 (SplitMix64).
[[nodiscard]] GSH_HD constexpr std::uint64_t mix_bits(std::uint64_t x) {
    x += 0x9E3779B97F4A7C15ull;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ull;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EBull;
    return x ^ (x >> 31);
}

/// The random bits of element `index` in the stream `seed`. The generator has no state, so elements may be drawn in any
/// order.
[[nodiscard]] GSH_HD constexpr std::uint64_t random_bits(std::uint64_t seed, std::uint64_t index) {
    return mix_bits(mix_bits(seed) ^ (index * 0xD1B54A32D192ED03ull));
}

/// Uniform in [0, 1) with 53 random bits.
[[nodiscard]] GSH_HD constexpr double random_uniform(std::uint64_t seed, std::uint64_t index) {
    return static_cast<double>(random_bits(seed, index) >> 11) * 0x1p-53;
}

/// A sequence of draws for host code. Its state is two integers, which a checkpoint can store.
class Rng {
public:
    struct State {
        std::uint64_t seed = 0;
        std::uint64_t counter = 0;
    };

    explicit Rng(std::uint64_t seed) : state_{seed, 0} {}
    explicit Rng(State state) : state_(state) {}

    [[nodiscard]] State state() const { return state_; }

    std::uint64_t bits() { return random_bits(state_.seed, state_.counter++); }
    /// Uniform in [low, high).
    double uniform(double low = 0, double high = 1) {
        return low + (high - low) * random_uniform(state_.seed, state_.counter++);
    }
    /// Standard normal (Box and Muller, 1958); uses two draws.
    double normal() {
        const double radius = std::sqrt(-2 * std::log(1 - uniform()));
        return radius * std::cos(2 * std::numbers::pi * uniform());
    }
    /// Uniform integer in [0, count); count > 0.
    std::uint64_t below(std::uint64_t count) {
        return static_cast<std::uint64_t>(uniform() * static_cast<double>(count));
    }

private:
    State state_;
};

/// The numbers 0 .. count-1 in random order (Fisher and Yates).
[[nodiscard]] inline std::vector<std::uint32_t> shuffled_indices(std::uint32_t count, std::uint64_t seed) {
    std::vector<std::uint32_t> order(count);
    for (std::uint32_t i = 0; i < count; ++i) order[i] = i;
    Rng rng(seed);
    for (std::uint32_t i = count; i > 1; --i) std::swap(order[i - 1], order[rng.below(i)]);
    return order;
}

} // namespace gsh
