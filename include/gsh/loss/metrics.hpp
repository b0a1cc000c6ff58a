// SPDX-License-Identifier: Apache-2.0
/// @file  Metrics of a report: PSNR, over a whole image or inside a mask, and SSIM. Host code, sums in double.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/ssim.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh {

/// Decibels of a mean squared error, for images with range 1; +infinity for an error of 0, which a mean over images
/// should leave out and a file should write as null.
[[nodiscard]] inline double psnr_of_mse(double mse) { return -10 * std::log10(mse); }

/// Mean squared difference over all pixels and channels.
/// Errors  ShapeError for images that differ in shape, ValueError for empty ones.
template <class A, class B>
[[nodiscard]] double mean_squared_error(const ImageView<A>& image, const ImageView<B>& truth) {
    constexpr std::string_view where = "mean_squared_error";
    check_image(where, "image", image, truth.channels, truth.height, truth.width);
    check_image(where, "truth", truth, truth.channels, truth.height, truth.width);
    check_value(truth.size() > 0, where, "the images have no pixels, expected at least one");
    double sum = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const double d = static_cast<double>(image.data[i]) - static_cast<double>(truth.data[i]);
        sum += d * d;
    }
    return sum / static_cast<double>(truth.size());
}

/// The same over the pixels where mask > 0.5, all channels of each.
/// Shapes  mask [1, height, width], such as an alpha channel.
/// Errors  as above, and ValueError for a mask without such a pixel.
template <class A, class B, class M>
[[nodiscard]] double mean_squared_error(const ImageView<A>& image, const ImageView<B>& truth,
                                        const ImageView<M>& mask) {
    constexpr std::string_view where = "mean_squared_error";
    check_image(where, "image", image, truth.channels, truth.height, truth.width);
    check_image(where, "truth", truth, truth.channels, truth.height, truth.width);
    check_image(where, "mask", mask, 1, truth.height, truth.width);
    double sum = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < mask.size(); ++i) {
        if (!(static_cast<double>(mask.data[i]) > 0.5)) continue;
        for (int c = 0; c < truth.channels; ++c) {
            const std::size_t k = static_cast<std::size_t>(c) * mask.size() + i;
            const double d = static_cast<double>(image.data[k]) - static_cast<double>(truth.data[k]);
            sum += d * d;
            ++count;
        }
    }
    check_value(count > 0, where, "mask has no pixel above 0.5; is it empty, or in bytes and not in [0, 1]?");
    return sum / static_cast<double>(count);
}

/// Peak signal-to-noise ratio in dB, range 1; +infinity for equal images.
template <class A, class B>
[[nodiscard]] double psnr(const ImageView<A>& image, const ImageView<B>& truth) {
    return psnr_of_mse(mean_squared_error(image, truth));
}
/// PSNR of the pixels where mask > 0.5.
template <class A, class B, class M>
[[nodiscard]] double psnr(const ImageView<A>& image, const ImageView<B>& truth, const ImageView<M>& mask) {
    return psnr_of_mse(mean_squared_error(image, truth, mask));
}

/// Mean structural similarity over channels and pixels: window 11 x 11, Gaussian with sigma 1.5, K1 0.01, K2 0.03.
///
/// The protocol pads by reflection and then crops the border of 5 pixels again; no window that is left reaches into the
/// padding, so only whole windows are evaluated here, (height - 10) x (width - 10) of them.
/// Errors  ShapeError for images that differ in shape; ValueError for images smaller than the window.
/// Source  Wang et al., 2004; padding and crop as in torchmetrics' structural_similarity_index_measure.
template <class A, class B>
[[nodiscard]] double ssim(const ImageView<A>& image, const ImageView<B>& truth) {
    constexpr std::string_view where = "ssim";
    constexpr int taps = SsimWindow<double>::size, moments = 4;
    check_image(where, "image", image, truth.channels, truth.height, truth.width);
    check_image(where, "truth", truth, truth.channels, truth.height, truth.width);
    const int rows = truth.height - taps + 1, columns = truth.width - taps + 1;
    check_value(truth.channels > 0 && rows > 0 && columns > 0, where,
                "the images are smaller than the window of 11 x 11 pixels");

    const SsimWindow<double> window;
    const auto width = static_cast<std::size_t>(truth.width), valid = static_cast<std::size_t>(columns);
    std::vector<double> down(moments * width), across(moments * valid); // one row, filtered down; then across
    double loss = 0;
    for (int c = 0; c < truth.channels; ++c)
        for (int y = 0; y < rows; ++y) {
            std::fill(down.begin(), down.end(), 0.0);
            for (int k = 0; k < taps; ++k) {
                const double w = window.taps[k];
                const auto *p = image.row(c, y + k), *q = truth.row(c, y + k);
                double *s = down.data(), *d = s + width, *ss = d + width, *dd = ss + width;
                for (std::size_t x = 0; x < width; ++x) {
                    const double a = static_cast<double>(p[x]), b = static_cast<double>(q[x]);
                    s[x] += w * (a + b), d[x] += w * (a - b);
                    ss[x] += w * (a + b) * (a + b), dd[x] += w * (a - b) * (a - b);
                }
            }
            std::fill(across.begin(), across.end(), 0.0);
            for (std::size_t m = 0; m < moments; ++m)
                for (std::size_t k = 0; k < taps; ++k) {
                    const double w = window.taps[k], *from = down.data() + m * width + k;
                    double* to = across.data() + m * valid;
                    for (std::size_t x = 0; x < valid; ++x) to[x] += w * from[x];
                }
            for (std::size_t x = 0; x < valid; ++x) {
                SsimPartials<double> unused;
                loss += ssim_loss<double>(
                    {across[x], across[valid + x], across[2 * valid + x], across[3 * valid + x]}, unused);
            }
        }
    return 1 - loss / (static_cast<double>(truth.channels) * rows * columns);
}

} // namespace gsh
