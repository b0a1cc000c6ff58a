// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/learn/frame_codes.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <vector>

using namespace gsh;

TEST_CASE("fields read γ(t) with t = frame / frames") {
    cpu::Serial backend;
    const FrameCodes<cpu::Serial> codes(backend, 5);
    CHECK(codes.size() == 9);
    for (std::size_t frame = 0; frame < 5; ++frame) {
        CAPTURE(frame);
        const double t = static_cast<double>(frame) / 5;
        std::vector<double> expected;
        for (const double octave : {1, 2, 4, 8})
            for (const double wave : {std::sin(3.14159265358979 * octave * t), std::cos(3.14159265358979 * octave * t)})
                expected.push_back(wave);
        expected.push_back(t);
        const Span<const float> code = codes[frame];
        REQUIRE(code.size() == 9);
        for (std::size_t k = 0; k < 9; ++k) CHECK(std::abs(code[k] - expected[k]) < 1e-5);
    }
    CHECK_THROWS_WITH_AS((void)codes[5], "FrameCodes: frame 5 does not exist; the motion has 5 frames", ValueError);
}

TEST_CASE("without frames every code is empty") {
    cpu::Serial backend;
    const FrameCodes<cpu::Serial> none(backend, 0);
    CHECK(none.size() == 0);
    CHECK(none[0].empty());
    CHECK(none[7].empty());
    CHECK(FrameCodes<cpu::Serial, double>()[0].empty());
    CHECK(FrameCodes<cpu::Serial>(backend, 1)[0][8] == 0);
}
