// SPDX-License-Identifier: Apache-2.0
/// @file  One level of a hash grid: table entries and weights of the eight corners around a point.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/math/vec.hpp>

#include <concepts>
#include <cstddef>
#include <cstdint>

namespace gsh {

/// The cell of a point on one level. Corner c in 0..7 is the cell's low corner plus bit 0 of c in x, bit 1 in y,
/// bit 2 in z.
template <Lane T>
struct HashCell {
    IndexOf<T> x[2], y[2], z[2]; ///< contribution of each coordinate of a corner to its entry
    vec3<T> fraction;            ///< position inside the cell, [0, 1)

    [[nodiscard]] GSH_HD T weight(int corner) const { return along(0, corner) * along(1, corner) * along(2, corner); }

    /// d weight / d fraction.
    [[nodiscard]] GSH_HD vec3<T> weight_gradient(int corner) const {
        const T wx = along(0, corner), wy = along(1, corner), wz = along(2, corner);
        return {sign(corner & 1) * wy * wz, sign(corner & 2) * wx * wz, sign(corner & 4) * wx * wy};
    }

private:
    [[nodiscard]] GSH_HD T along(int axis, int corner) const {
        return corner >> axis & 1 ? fraction[axis] : T(1) - fraction[axis];
    }
    [[nodiscard]] GSH_HD static T sign(int bit) { return bit ? T(1) : T(-1); }
};

/// Geometry of one level.
///
/// Units   points in [0, 1]^3; others are moved to the nearest face.
/// Source  Müller et al., "Instant Neural Graphics Primitives", 2022, equations 2 to 4; cell positions are shifted by
///         half a cell, as in their published code.
struct HashLevel {
    double scale = 0;             ///< cells per unit length: position = scale * point + 0.5
    float scale_single = 0;       ///< the same, rounded, since GPUs convert a double slowly
    std::uint32_t resolution = 0; ///< the largest corner coordinate
    std::uint32_t size = 0;       ///< entries of this level
    std::uint32_t offset = 0;     ///< first entry of this level in the table
    bool hashed = false;          ///< if false, corner (x, y, z) has the entry x + stride (y + stride z)

    [[nodiscard]] GSH_HD std::uint32_t stride() const { return resolution + 1; }
    template <std::floating_point T>
    [[nodiscard]] GSH_HD T scale_as() const {
        if constexpr (std::same_as<T, float>)
            return scale_single;
        else
            return static_cast<T>(scale);
    }

    template <Lane T>
    [[nodiscard]] GSH_HD HashCell<T> cell(const vec3<T>& point) const {
        return hashed ? cell<true>(point) : cell<false>(point);
    }
    template <bool Hashed, Lane T>
    [[nodiscard]] GSH_HD HashCell<T> cell(const vec3<T>& point) const {
        using Traits = LaneTraits<T>;
        using Index = IndexOf<T>;
        const Index one = Index(1);
        const Index step_y = Index(Hashed ? 2654435761u : stride());
        const Index step_z = Index(Hashed ? 805459861u : stride() * stride());
        const vec3<T> position(inside(point.x), inside(point.y), inside(point.z));
        const Index x = Traits::to_index(position.x), y = Traits::to_index(position.y),
                    z = Traits::to_index(position.z);
        return {{x, x + one},
                {y * step_y, (y + one) * step_y},
                {z * step_z, (z + one) * step_z},
                {position.x - Traits::from_index(x), position.y - Traits::from_index(y),
                 position.z - Traits::from_index(z)}};
    }

    /// Entry of a corner, counted from the start of the table.
    template <Lane T>
    [[nodiscard]] GSH_HD IndexOf<T> index(const HashCell<T>& cell, int corner) const {
        return hashed ? index<true>(cell, corner) : index<false>(cell, corner);
    }
    template <bool Hashed, Lane T>
    [[nodiscard]] GSH_HD IndexOf<T> index(const HashCell<T>& cell, int corner) const {
        using Index = IndexOf<T>;
        const Index x = cell.x[corner & 1], y = cell.y[corner >> 1 & 1], z = cell.z[corner >> 2 & 1];
        if constexpr (Hashed)
            return ((x ^ y ^ z) & Index(size - 1)) + Index(offset);
        else
            return x + y + z + Index(offset);
    }

private:
    template <Lane T>
    [[nodiscard]] GSH_HD T inside(const T& coordinate) const {
        // This order of arguments turns NaN into 0, so that no index leaves the table. Product and sum are apart, so
        // that no compiler fuses them: a point has the same cell on every machine and in every copy of this code.
        const T end(scale_as<ScalarOf<T>>());
        return min(end, max(T(0), coordinate * end)) + T(ScalarOf<T>(0.5));
    }
};

/// Weights of coarse and fine levels at a point: its features on a level are multiplied by the weight of the level.
template <class T>
struct LevelWeight {
    int split = 0; ///< levels [0, split) are coarse, the others fine
    T coarse = T(1), fine = T(1);

    [[nodiscard]] GSH_HD const T& operator()(int level) const { return level < split ? coarse : fine; }
};

/// The same for N points. An empty array means 1 everywhere. Where a weight is 0, the table is neither read nor
/// updated.
template <class T>
struct LevelWeights {
    int split = 0;              ///< levels [0, split) are coarse, the others fine
    Span<const T> coarse, fine; ///< [N]

    [[nodiscard]] GSH_HD LevelWeight<T> operator[](std::size_t i) const {
        return {split, coarse.empty() ? T(1) : coarse[i], fine.empty() ? T(1) : fine[i]};
    }
    /// The weights that apply to a level.
    [[nodiscard]] Span<const T> of_level(int level) const { return level < split ? coarse : fine; }
};

} // namespace gsh
