// SPDX-License-Identifier: Apache-2.0
/// @file  A user's program: numbers of the core are written to a file and read again, which needs libzip and oneTBB.
#include <gsh/backend/threads.hpp>
#include <gsh/core/config.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/npz_writer.hpp>
#include <gsh/math/sh.hpp>

#include <cmath>
#include <cstddef>
#include <cstdio>
#include <vector>

namespace {

/// A sphere's values of the first spherical harmonic: 0.2821 in every direction.
struct Constant {
    gsh::Span<double> values;
    void operator()(std::size_t i) const {
        const gsh::vec3<double> coefficient(1);
        const double angle = static_cast<double>(i);
        values[i] = gsh::SHEval<0>::forward(&coefficient, {std::cos(angle), std::sin(angle), 0.0}).x;
    }
};

} // namespace

int main() {
    gsh::cpu::Threads backend(2);
    std::vector<double> values(1000);
    backend.for_each(values.size(), Constant{values});

    gsh::NpzWriter out("consumer.npz");
    out.add("values", values);
    out.commit();
    const auto read = gsh::NpzReader("consumer.npz").read<double>("values", {1000});
    double sum = 0;
    for (const double value : read.data) sum += value;
    std::printf("gsh %s: %.4f\n", GSH_VERSION_TEXT, sum);
    return std::abs(sum - 500 / std::sqrt(std::acos(-1.0))) < 1e-9 ? 0 : 1; // Y_00 = 1 / (2 sqrt(pi))
}
