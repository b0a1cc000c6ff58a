// SPDX-License-Identifier: Apache-2.0
#include <gsh/field/cpu/matrix_bf16.hpp>

#include <gsh/math/wide_bf16.hpp>

#include "support/gradient.hpp"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

using namespace gsh;

TEST_CASE("products of bf16 matrices of any size, and sums of such with a transposed factor") {
    namespace detail = cpu::detail;
    test::Rng rng(2);
    const detail::ProductBf16 product;
    const auto padded = [](std::size_t size) { return (size + 31) / 32 * 32; };
    // A matrix whose rows hold words of two neighbours in k. Zeros pad it, and a few words lie beside it.
    struct Words {
        std::size_t stride;
        std::vector<std::uint32_t> words;
    };
    const auto matrix = [&](std::size_t rows, std::size_t columns, const auto& is_number) {
        Words result{columns + 5, {}};
        for (std::size_t r = 0; r < rows; ++r)
            for (std::size_t c = 0; c < result.stride; ++c) {
                const auto number = [&](std::size_t half) {
                    return c < columns && is_number(r, c, half) ? static_cast<float>(rng.uniform(-1, 1)) : 0.0f;
                };
                result.words.push_back(c < columns ? bf16_word(number(0), number(1)) : 0x7fc07fc0u);
            }
        return result;
    };
    const auto half = [](std::uint32_t word, std::size_t k) {
        return double(std::bit_cast<float>(k % 2 ? word & 0xffff0000u : word << 16));
    };
    for (const auto& [m, n, k] : {detail::ProductSize{16, 16, 32}, {32, 64, 64}, {48, 16, 64}, {16, 48, 32},
                                  {64, 80, 64}, {27, 74, 30}, {3, 3, 5}, {64, 96, 63}, {64, 27, 1}}) {
        const std::size_t M = m, N = n, K = k; // lambdas take no bindings
        CAPTURE(M);
        CAPTURE(N);
        CAPTURE(K);
        const Words a = matrix(padded(M), padded(K) / 2, [&](std::size_t r, std::size_t c, std::size_t h) {
                        return r < M && 2 * c + h < K;
                    }),
                    b = matrix(padded(K) / 2, padded(N), [&](std::size_t r, std::size_t c, std::size_t h) {
                        return c < N && 2 * r + h < K;
                    });
        Words transposed{padded(M) + 3, std::vector<std::uint32_t>(padded(K) / 2 * (padded(M) + 3))};
        for (std::size_t r = 0; r < padded(M); ++r)
            for (std::size_t c = 0; c < padded(K) / 2; ++c)
                transposed.words[c * transposed.stride + r] = a.words[r * a.stride + c];

        const std::size_t stride = padded(N) + 7;
        std::vector<float> c(padded(M) * stride, 3.0f);
        const auto check = [&](double times) {
            for (std::size_t i = 0; i < M; ++i) {
                for (std::size_t j = 0; j < N; ++j) {
                    double sum = 0;
                    for (std::size_t l = 0; l < K; ++l)
                        sum += half(a.words[i * a.stride + l / 2], l) * half(b.words[l / 2 * b.stride + j], l);
                    REQUIRE(c[i * stride + j] == doctest::Approx(times * sum).epsilon(1e-5));
                }
                for (std::size_t j = padded(N); j < stride; ++j) REQUIRE(c[i * stride + j] == 3.0f); // beside it
            }
        };
        product({M, N, K}, {a.words.data(), a.stride}, {b.words.data(), b.stride},
                [&](std::size_t row, std::size_t column, const auto& sums) {
                    if (N % 32 == 0) REQUIRE(std::size(sums) % 2 == 0);
                    for (const Wide<float>& sum : sums) {
                        sum.store(&c[row * stride + column]);
                        column += Wide<float>::width;
                    }
                });
        check(1);
        product.add_transposed({M, N, K}, {transposed.words.data(), transposed.stride},
                               {b.words.data(), b.stride}, {c.data(), stride});
        check(2);
    }
}
