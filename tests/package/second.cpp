// SPDX-License-Identifier: Apache-2.0
/// @file  The second source file of the user's program. It also includes all of gsh.

#include <gsh/gsh.hpp>

#include <numeric>
#include <vector>

double sum_in_second_source(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0);
}
