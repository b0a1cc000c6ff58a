// SPDX-License-Identifier: Apache-2.0
/// @file  A user's program: rotates a point on the CPU and prints the version of gsh that it was built with.

#include <gsh/gsh.hpp>

#include <cmath>
#include <cstdio>
#include <vector>

double sum_in_second_source(const std::vector<double>& values);

int main() {
    gsh::cpu::Threads backend;
    std::vector<double> values(1000, 1.0);
    const gsh::Span<double> span = values;
    backend.for_each(values.size(), [=](std::size_t i) { span[i] *= static_cast<double>(i); });

    const double sum = sum_in_second_source(values);
    std::printf("gsh %d.%d.%d: %g\n", GSH_VERSION_MAJOR, GSH_VERSION_MINOR, GSH_VERSION_PATCH, sum);
    return std::abs(sum - 499500.0) < 1e-9 ? 0 : 1;
}
