// SPDX-License-Identifier: Apache-2.0
#include <gsh/loss/ssim.hpp>
#include <gsh/math/wide.hpp>

#include "support/gradient.hpp"

#include <cmath>

using namespace gsh;

namespace {
/// Moments of some window over random images.
SsimMoments<double> random_moments(test::Rng& rng) {
    SsimMoments<double> m{};
    for (int k = 0; k < 9; ++k) {
        const double a = rng.uniform(), b = rng.uniform();
        m.s += (a + b) / 9, m.d += (a - b) / 9;
        m.ss += (a + b) * (a + b) / 9, m.dd += (a - b) * (a - b) / 9;
    }
    return m;
}
} // namespace

TEST_CASE("the window is symmetric and sums to one") {
    const SsimWindow<double> window;
    double sum = 0;
    for (int k = 0; k < 11; ++k) {
        sum += window.taps[k];
        CHECK(window.taps[k] == window.taps[10 - k]);
    }
    CHECK(sum == doctest::Approx(1).epsilon(1e-15));
    CHECK(window.taps[5] / window.taps[8] == doctest::Approx(std::exp(2.0)).epsilon(1e-14));
}

TEST_CASE("ssim_loss is one minus the textbook's SSIM, its partials are its gradient") {
    test::Rng rng(1);
    for (int trial = 0; trial < 20; ++trial) {
        SsimMoments<double> m = random_moments(rng);
        const double ma = (m.s + m.d) / 2, mb = (m.s - m.d) / 2;
        const double squares = (m.ss + m.dd) / 2, product = (m.ss - m.dd) / 4;
        const double ssim = (2 * ma * mb + 1e-4) * (2 * (product - ma * mb) + 9e-4) /
                            ((ma * ma + mb * mb + 1e-4) * (squares - ma * ma - mb * mb + 9e-4));
        SsimPartials<double> partials, unused;
        CHECK(ssim_loss(m, partials) == doctest::Approx(1 - ssim).epsilon(1e-12));

        double shift = 0; // the derivative with respect to s and d together, because the mean of a changes both
        const auto shifted = [&] {
            return ssim_loss<double>({m.s + shift, m.d + shift, m.ss, m.dd}, unused);
        };
        const auto loss = [&] { return ssim_loss(m, unused); };
        test::check_gradient(shifted, {&shift, 1}, {&partials.mean, 1});
        test::check_gradient(loss, {&m.ss, 1}, {&partials.ss, 1});
        test::check_gradient(loss, {&m.dd, 1}, {&partials.dd, 1});
    }
    SsimPartials<double> partials;
    CHECK(ssim_loss<double>({1.2, 0, 1.5, 0}, partials) == 0); // exact for equal windows
    CHECK(partials.mean == 0);
    CHECK(partials.ss == 0);
}

TEST_CASE("a register of windows equals its lanes") {
    using P = Wide<double>;
    constexpr std::size_t width = LaneTraits<P>::width;
    test::Rng rng(2);
    double in[4][width], out[4][width];
    for (std::size_t i = 0; i < width; ++i) {
        const auto m = random_moments(rng);
        in[0][i] = m.s, in[1][i] = m.d, in[2][i] = m.ss, in[3][i] = m.dd;
    }
    const auto load = [&](int k) { return P::load(in[k]); };
    SsimPartials<P> partials;
    ssim_loss<P>({load(0), load(1), load(2), load(3)}, partials).store(out[0]);
    partials.mean.store(out[1]);
    partials.ss.store(out[2]);
    partials.dd.store(out[3]);
    for (std::size_t i = 0; i < width; ++i) {
        SsimPartials<double> one;
        const double loss = ssim_loss<double>({in[0][i], in[1][i], in[2][i], in[3][i]}, one);
        CHECK(out[0][i] == doctest::Approx(loss).epsilon(1e-13));
        CHECK(out[1][i] == doctest::Approx(one.mean).epsilon(1e-12));
        CHECK(out[2][i] == doctest::Approx(one.ss).epsilon(1e-12));
        CHECK(out[3][i] == doctest::Approx(one.dd).epsilon(1e-12));
    }
}
