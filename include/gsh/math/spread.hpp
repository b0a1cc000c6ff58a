// SPDX-License-Identifier: Apache-2.0
/// @file  Median and spread of numbers, some of which may be outliers.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace gsh {

/// The median; of an even count the upper of the middle two numbers, and 0 of none.
[[nodiscard]] inline double median(std::vector<double> values) {
    if (values.empty()) return 0;
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

struct Spread {
    double median = 0;
    double deviation = 0; ///< an estimate of the standard deviation that up to half of the numbers may not spoil
};

/// The deviation is 1.4826 times the median of the distances from the median, which is the standard deviation of
/// normally distributed numbers. Both are 0 without any.
[[nodiscard]] inline Spread robust_spread(std::vector<double> values) {
    Spread result{.median = median(values)};
    for (double& value : values) value = std::abs(value - result.median);
    result.deviation = 1.4826 * median(std::move(values));
    return result;
}

} // namespace gsh
