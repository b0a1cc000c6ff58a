// SPDX-License-Identifier: Apache-2.0
/// @file  SSIM of two windows from four filtered numbers, and its partial derivatives.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/core/lane.hpp>

#include <cmath>

namespace gsh {

/// The 11-tap Gaussian, sigma 1.5 pixels, that SSIM filters rows and columns with; its 121 products sum to one.
template <class T>
struct SsimWindow {
    static constexpr int radius = 5;
    static constexpr int size = 2 * radius + 1;
    T taps[size];

    SsimWindow() {
        double weights[size], sum = 0;
        for (int k = 0; k < size; ++k) sum += weights[k] = std::exp((k - radius) * (k - radius) / (-2 * 1.5 * 1.5));
        for (int k = 0; k < size; ++k) taps[k] = static_cast<T>(weights[k] / sum);
    }
};

/// Two images a and b filtered by the window w, in terms of their sum s = a + b and difference d = a - b.
template <Lane T>
struct SsimMoments {
    T s, d, ss, dd; ///< w * s, w * d, w * s², w * d²
};

/// dL/d of the moments. If only a varies, ds = dd = da, so the first two are stored as their sum: dL_da = w * dL_dmean
/// + 2 s (w * dL_dss) + 2 d (w * dL_ddd), where * is the correlation with the window.
template <Lane T>
struct SsimPartials {
    T mean, ss, dd;
};

/// 1 - SSIM of one window, for images in [0, 1]: C1 = 0.01², C2 = 0.03².
///
/// The usual (2 μa μb + C1)(2 σab + C2) / ((μa² + μb² + C1)(σa² + σb² + C2)) equals (1 - u)(1 - v) with
///
///     u = μd² / A,  A = (μs² + μd²)/2 + C1        v = σd² / B,  B = (σs² + σd²)/2 + C2
///
/// This form needs four filtered images instead of five, and equal windows give exactly 0.
///
/// Source  Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment", 2004; the form in s and d is ours.
template <Lane T>
[[nodiscard]] GSH_HD T ssim_loss(const SsimMoments<T>& m, SsimPartials<T>& partials) {
    const T mu_ss = m.s * m.s, mu_dd = m.d * m.d;
    const T variance_d = m.dd - mu_dd;
    const T A = T(0.5) * (mu_ss + mu_dd) + T(0.01 * 0.01);
    const T B = T(0.5) * ((m.ss - mu_ss) + variance_d) + T(0.03 * 0.03);
    const T inverse_A = T(1) / A, inverse_B = T(1) / B;
    const T u = mu_dd * inverse_A, v = variance_d * inverse_B;
    const T du = (T(1) - v) * inverse_A, dv = (T(1) - u) * inverse_B; // of u + v - u v, less a factor each

    partials.mean = du * (m.d * (T(2) - u) - m.s * u) + dv * (m.s * v - m.d * (T(2) - v));
    partials.ss = T(-0.5) * dv * v;
    partials.dd = dv * (T(1) - T(0.5) * v);
    return u + v - u * v;
}

} // namespace gsh
