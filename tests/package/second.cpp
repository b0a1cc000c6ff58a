// SPDX-License-Identifier: Apache-2.0
/// @file  The stranger's second source, which includes all of gsh once more.

#include <gsh/gsh.hpp>

#include <numeric>
#include <vector>

double sum_in_second_source(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0);
}
