// SPDX-License-Identifier: Apache-2.0
/// @file  The size of a model's part before the part is made, for budgets of memory.
#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The size of one learned array that its part will announce.
struct LearnedSize {
    std::string name;          ///< that of the LearnedArray
    std::size_t fixed = 0;     ///< numbers that do not depend on the number of canonical points
    std::size_t per_point = 0; ///< numbers for each point

    [[nodiscard]] std::size_t at(std::size_t points) const { return fixed + per_point * points; }
};

/// The size of a part: its learned arrays in the order of learned(), and what it stores for each point beside them.
///
/// Each part of an avatar has a static function `size`, next to the constructor that makes its arrays. It allocates no
/// array. tests/train/memory_test.cpp compares the sizes of every configuration with the arrays that the avatar
/// announces, so it fails for an array whose size is not stated.
struct PartSize {
    std::vector<LearnedSize> learned;
    std::size_t other_per_point = 0; ///< numbers: activations and outputs, and their gradients
    std::size_t other = 0;           ///< numbers that do not depend on the number of points
    std::size_t queries = 0;         ///< of hash grids (HashField::Query); fields may share one

    /// Numbers in memory. A learned number has a gradient and two moments.
    [[nodiscard]] std::size_t fixed() const {
        std::size_t sum = other;
        for (const LearnedSize& array : learned) sum += 4 * array.fixed;
        return sum;
    }
    [[nodiscard]] std::size_t per_point() const {
        std::size_t sum = other_per_point;
        for (const LearnedSize& array : learned) sum += 4 * array.per_point;
        return sum;
    }
};

/// Appends a part's size to that of others.
inline void append(PartSize& all, PartSize part) {
    for (LearnedSize& array : part.learned) all.learned.push_back(std::move(array));
    all.other_per_point += part.other_per_point;
    all.other += part.other;
    all.queries += part.queries;
}

} // namespace gsh
