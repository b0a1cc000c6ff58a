// SPDX-License-Identifier: Apache-2.0
#include <gsh/math/wide_bf16.hpp>

#include "support/gradient.hpp"

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

using namespace gsh;

namespace {
float value(std::uint32_t bits) { return std::bit_cast<float>(bits << 16); }
} // namespace

TEST_CASE("bf16 is the nearest number of eight bits, ties to even") {
    CHECK(value(bf16_bits(1.0f)) == 1.0f);
    CHECK(value(bf16_bits(-0.15625f)) == -0.15625f);
    const float step = 1.0f / 128; // between neighbours from 1 to 2
    CHECK(value(bf16_bits(1 + 0.49f * step)) == 1.0f);
    CHECK(value(bf16_bits(1 + 0.51f * step)) == 1 + step);
    CHECK(value(bf16_bits(1 + 0.5f * step)) == 1.0f);
    CHECK(value(bf16_bits(1 + 1.5f * step)) == 1 + 2 * step);
    CHECK(std::isinf(value(bf16_bits(std::numeric_limits<float>::max()))));
    CHECK(std::isinf(value(bf16_bits(std::numeric_limits<float>::infinity()))));
    CHECK(std::isnan(value(bf16_bits(std::nanf("")))));
    CHECK(std::isnan(value(bf16_bits(std::bit_cast<float>(0x7f800001u)))));
    CHECK(bf16_word(1.0f, -2.0f) == (bf16_bits(1.0f) | bf16_bits(-2.0f) << 16));
}

TEST_CASE("registers of bf16 hold what the scalar functions give") {
    using W = Wide<float>;
    constexpr std::size_t n = W::width;
    test::Rng rng(4);
    for (int repeat = 0; repeat < 100; ++repeat) {
        float a[n], b[n], c[n];
        for (std::size_t i = 0; i < n; ++i) {
            a[i] = static_cast<float>(rng.uniform(-3, 3)), b[i] = static_cast<float>(rng.uniform(-1e-3, 1e-3));
            c[i] = static_cast<float>(rng.uniform(-1, 1));
        }
        if (repeat == 0) a[0] = std::nanf(""), a[1] = std::numeric_limits<float>::infinity(), a[2] = 0, b[2] = -0.0f;
        const auto words = bf16_words(W::load(a), W::load(b)), next = bf16_neighbours(W::load(a), W::load(b));
        const auto zipped = zip_bf16(words, next);
        const W low = low_bf16(words), high = high_bf16(words), sum = dot_bf16(W::load(c), words, words);
        for (std::size_t i = 0; i < n; ++i) {
            const auto same = [](float x, float y) { return (std::isnan(x) && std::isnan(y)) || x == y; };
            CHECK(same(low[i], value(bf16_bits(a[i]))));
            CHECK(high[i] == value(bf16_bits(b[i])));
            const float first = 2 * i < n ? a[2 * i] : b[2 * i - n], second = 2 * i < n ? a[2 * i + 1] : b[2 * i + 1 - n];
            CHECK(same(std::bit_cast<float>(next[i] << 16), value(bf16_bits(first))));
            CHECK(same(std::bit_cast<float>(next[i] & 0xffff0000u), value(bf16_bits(second))));
            const auto pair = i < n / 2 ? zipped.first : zipped.second; // word i has numbers 2 i and 2 i + 1 of each
            const std::size_t at = 2 * i % n;
            CHECK(pair[at] == ((words[i] & 0xffffu) | next[i] << 16));
            CHECK(pair[at + 1] == (words[i] >> 16 | (next[i] & 0xffff0000u)));
            const double exact = double(c[i]) + double(low[i]) * low[i] + double(high[i]) * high[i];
            if (std::isfinite(exact)) CHECK(sum[i] == doctest::Approx(exact).epsilon(1e-6));
        }
    }
}
