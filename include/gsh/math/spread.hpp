// SPDX-License-Identifier: Apache-2.0
/// @file  Median and spread of numbers, some of which may be outliers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh {

struct Spread {
    double median = 0;
    double deviation = 0; ///< an estimate of the standard deviation that up to half of the numbers may not spoil
};

/// The median of an even count is the upper of the middle two numbers. The deviation is 1.4826 times the median of the
/// distances from the median, which is the standard deviation of normally distributed numbers. Both are 0 without any.
[[nodiscard]] inline Spread robust_spread(std::vector<double> values) {
    if (values.empty()) return {};
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    const auto median = [&] {
        std::nth_element(values.begin(), middle, values.end());
        return *middle;
    };
    Spread result{.median = median()};
    for (double& value : values) value = std::abs(value - result.median);
    result.deviation = 1.4826 * median();
    return result;
}

} // namespace gsh
