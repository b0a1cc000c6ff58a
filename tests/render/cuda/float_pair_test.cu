// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/cuda/device.cuh>
#include <gsh/render/cuda/float_pair.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"
#include "support/gradient.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

namespace {

using Pair = cuda::detail::FloatPair;

/// Six results for each two numbers.
struct PairResults {
    Span<const Pair> a, b;
    Span<Pair> results;
    __device__ void operator()(std::size_t i) const {
        const Pair x = a[i], y = b[i];
        const Pair all[] = {x + y, x - y, x * y, x / y, sqrt(x * x), max(x, y)};
        for (std::size_t k = 0; k < 6; ++k) results[6 * i + k] = all[k];
    }
};

double value(Pair x) {
    return static_cast<double>(x.high) + static_cast<double>(x.low);
}
Pair pair_of(double x) {
    const auto high = static_cast<float>(x);
    return {high, static_cast<float>(x - static_cast<double>(high))};
}

} // namespace

TEST_CASE("Sums, products and roots of pairs of floats are right to about 2⁻⁴⁴") {
    if (test::skip_without_device()) return;
    test::Rng rng(1);
    const std::size_t n = 1000;
    std::vector<Pair> a, b;
    for (std::size_t i = 0; i < n; ++i) {
        const double x = rng.normal() * std::exp(rng.uniform(-8, 8)), y = rng.normal() * std::exp(rng.uniform(-8, 8));
        a.push_back(pair_of(x)), b.push_back(pair_of(i % 4 == 0 ? x * (1 + 1e-9) : y));
    }
    cuda::Device device;
    cuda::Buffer<Pair> on_a(n), on_b(n), results(6 * n);
    device.upload(Span<const Pair>(a), Span<Pair>(on_a));
    device.upload(Span<const Pair>(b), Span<Pair>(on_b));
    device.for_each(n, PairResults{on_a, on_b, results});
    std::vector<Pair> found(6 * n);
    device.download(Span<const Pair>(results), Span<Pair>(found));
    double worst[6] = {}, worst_rounded = 0;
    for (std::size_t i = 0; i < n; ++i) {
        const double x = value(a[i]), y = value(b[i]), both = std::abs(x) + std::abs(y);
        const double expected[] = {x + y, x - y, x * y, x / y, std::abs(x), std::max(x, y)};
        const double scale[] = {both, both, std::abs(x * y), std::abs(x / y), std::abs(x), both};
        for (std::size_t k = 0; k < 6; ++k) {
            const double error = std::abs(value(found[6 * i + k]) - expected[k]) / scale[k];
            worst[k] = std::max(worst[k], error);
        }
        const Pair product = found[6 * i + 2];
        worst_rounded =
            std::max(worst_rounded, std::abs(static_cast<double>(cuda::detail::rounded(product)) +
                                             static_cast<double>(cuda::detail::rest_of(product)) - value(product)) /
                                        std::abs(x * y));
    }
    for (std::size_t k = 0; k < 6; ++k) {
        CAPTURE(k);
        CHECK(worst[k] < 6e-14);
    }
    CHECK(worst_rounded < 1e-14);
}
