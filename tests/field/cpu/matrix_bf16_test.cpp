// SPDX-License-Identifier: Apache-2.0
#include <gsh/field/cpu/matrix_bf16.hpp>

#include <gsh/math/wide_bf16.hpp>

#include "support/gradient.hpp"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

using namespace gsh;

TEST_CASE("products of bf16 matrices, assigned and added, in every number of tiles") {
    namespace detail = cpu::detail;
    test::Rng rng(2);
    const detail::ProductBf16 product;
    for (const auto& [m, n, k] : {detail::ProductSize{16, 16, 32}, {32, 64, 64}, {48, 16, 96}, {16, 48, 32}, {64, 80, 64}}) {
        const auto words = [&](std::size_t count) {
            std::vector<std::uint32_t> some(count);
            for (auto& word : some)
                word = bf16_word(static_cast<float>(rng.uniform(-1, 1)), static_cast<float>(rng.uniform(-1, 1)));
            return some;
        };
        const auto number = [](std::uint32_t word, std::size_t k_) {
            return double(std::bit_cast<float>(k_ % 2 ? word & 0xffff0000u : word << 16));
        };
        const std::size_t a_stride = k / 2 + 3, b_stride = n + 5, c_stride = n + 7;
        const auto a = words(m * a_stride), b = words(k / 2 * b_stride);
        std::vector<float> c(m * c_stride, 3.0f);
        const auto check = [&](double before, double times) {
            for (std::size_t i = 0; i < m; ++i) {
                for (std::size_t j = 0; j < n; ++j) {
                    double sum = before;
                    for (std::size_t l = 0; l < k; ++l)
                        sum += times * number(a[i * a_stride + l / 2], l) * number(b[l / 2 * b_stride + j], l);
                    REQUIRE(c[i * c_stride + j] == doctest::Approx(sum).epsilon(1e-5));
                }
                for (std::size_t j = n; j < c_stride; ++j) REQUIRE(c[i * c_stride + j] == 3.0f); // beside the matrix
            }
        };
        product({m, n, k}, {a.data(), a_stride}, {b.data(), b_stride}, {c.data(), c_stride});
        check(0, 1);
        product.operator()<true>({m, n, k}, {a.data(), a_stride}, {b.data(), b_stride}, {c.data(), c_stride});
        check(0, 2);
    }
}
