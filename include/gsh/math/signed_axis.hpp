// SPDX-License-Identifier: Apache-2.0
/// @file  Signed coordinate axes, and the rotations that turn a world so that one of them is y.
#pragma once

#include <gsh/math/vec.hpp>

#include <cmath>
#include <optional>
#include <string>

namespace gsh {

/// One of x, -x, y, -y, z, -z.
struct SignedAxis {
    int index = 1; ///< 0 to 2: x, y, z
    int sign = 1;

    bool operator==(const SignedAxis&) const = default;
    [[nodiscard]] std::string name() const { return (sign < 0 ? "-" : "") + std::string(1, "xyz"[index]); }
};

/// The signed axis of a vector's largest component, if that is more than `least`; none for NaN.
[[nodiscard]] inline std::optional<SignedAxis> signed_axis_along(const vec3<double>& v, double least) {
    int k = 0;
    for (int i = 1; i < 3; ++i)
        if (std::abs(v[i]) > std::abs(v[k])) k = i;
    if (!(std::abs(v[k]) > least)) return std::nullopt;
    return SignedAxis{k, v[k] > 0 ? 1 : -1};
}

/// The rotation by at most half a turn that turns a signed axis to +y. It keeps x, or z where the axis is x.
[[nodiscard]] inline mat3<double> turn_to_y(const SignedAxis& axis) {
    const double sign = axis.sign;
    if (axis.index == 1) return {vec3<double>(1, 0, 0), vec3<double>(0, sign, 0), vec3<double>(0, 0, sign)};
    mat3<double> A(0.0);              // columns: the images of x, y and z
    const int other = 2 - axis.index; // the horizontal axis that stays fixed
    A[other][other] = 1;
    A[axis.index][1] = sign;
    A[1][axis.index] = -sign;
    return A;
}

} // namespace gsh
