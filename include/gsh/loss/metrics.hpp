// SPDX-License-Identifier: Apache-2.0
/// @file  Image metrics: PSNR and SSIM of a whole image or inside a mask. Host code, sums in double.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/ssim.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string_view>
#include <vector>

namespace gsh {

/// PSNR in decibels of a mean squared error, for images with range 1. An error of 0 gives +infinity, which a mean over
/// images should leave out and a file should store as null.
[[nodiscard]] inline double psnr_of_mse(double mse) { return -10 * std::log10(mse); }

/// Mean squared difference over all pixels and channels.
///
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
///
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

namespace detail {

/// Calls row(channel, y, losses) for each row of whole windows: losses[x] is 1 - SSIM of the window that is centred
/// on pixel (x + 5, y + 5).
template <class A, class B, class Row>
void for_ssim_rows(const ImageView<A>& image, const ImageView<B>& truth, const Row& row) {
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
    std::vector<double> losses(valid);
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
                losses[x] = ssim_loss<double>(
                    {across[x], across[valid + x], across[2 * valid + x], across[3 * valid + x]}, unused);
            }
            row(c, y, Span<const double>(losses));
        }
}

} // namespace detail

/// Mean structural similarity over channels and pixels: window 11 x 11, Gaussian with sigma 1.5, K1 0.01, K2 0.03.
///
/// The protocol pads by reflection and then crops a border of 5 pixels. No remaining window reaches into the padding,
/// so only whole windows are evaluated here, (height - 10) x (width - 10) of them.
///
/// Errors  ShapeError for images that differ in shape; ValueError for images smaller than the window.
/// Source  Wang et al., 2004; padding and crop as in torchmetrics' structural_similarity_index_measure.
template <class A, class B>
[[nodiscard]] double ssim(const ImageView<A>& image, const ImageView<B>& truth) {
    double loss = 0;
    std::size_t count = 0;
    detail::for_ssim_rows(image, truth, [&](int, int, Span<const double> losses) {
        for (const double l : losses) loss += l;
        count += losses.size();
    });
    return 1 - loss / static_cast<double>(count);
}

/// The mean over the windows whose central pixel has mask > 0.5. A window extends 5 pixels around its centre, so at the
/// border of the mask it includes pixels outside the mask.
///
/// Errors  as above, and ValueError where no such pixel is 5 pixels away from the image's border.
template <class A, class B, class M>
[[nodiscard]] double ssim(const ImageView<A>& image, const ImageView<B>& truth, const ImageView<M>& mask) {
    check_image("ssim", "mask", mask, 1, truth.height, truth.width);
    constexpr int radius = SsimWindow<double>::radius;
    double loss = 0;
    std::size_t count = 0;
    detail::for_ssim_rows(image, truth, [&](int, int y, Span<const double> losses) {
        const M* inside = mask.row(0, y + radius) + radius;
        for (std::size_t x = 0; x < losses.size(); ++x)
            if (static_cast<double>(inside[x]) > 0.5) loss += losses[x], ++count;
    });
    check_value(count > 0, "ssim", "mask has no pixel above 0.5 at least 5 pixels inside the image");
    return 1 - loss / static_cast<double>(count);
}

/// Scores of the pixels of one image inside a mask.
struct RegionScore {
    std::size_t pixels = 0;  ///< mask > 0.5
    std::size_t windows = 0; ///< of these, at least 5 pixels inside the image
    double psnr = std::numeric_limits<double>::quiet_NaN(); ///< dB; +infinity where equal, NaN without a pixel
    double ssim = std::numeric_limits<double>::quiet_NaN(); ///< NaN without a window
};

/// Scores of a region of one image. A region without pixels, such as a face that is turned away, is not an error.
///
/// Errors  ShapeError for images or masks that differ in shape; ValueError for images smaller than 11 x 11.
template <class A, class B, class M>
[[nodiscard]] RegionScore score_region(const ImageView<A>& image, const ImageView<B>& truth, const ImageView<M>& mask) {
    constexpr int radius = SsimWindow<double>::radius;
    check_image("score_region", "mask", mask, 1, truth.height, truth.width);
    RegionScore score;
    for (int y = 0; y < mask.height; ++y)
        for (int x = 0; x < mask.width; ++x) {
            if (!(static_cast<double>(mask.at(0, y, x)) > 0.5)) continue;
            ++score.pixels;
            score.windows += y >= radius && y < mask.height - radius && x >= radius && x < mask.width - radius;
        }
    if (score.pixels > 0) score.psnr = psnr(image, truth, mask);
    if (score.windows > 0) score.ssim = ssim(image, truth, mask);
    return score;
}

/// Scores of a region averaged over images.
struct RegionMean {
    std::size_t images = 0; ///< images that show at least min_pixels of the region
    std::size_t equal = 0;  ///< of these, with a PSNR of +infinity: left out of the mean
    double psnr = std::numeric_limits<double>::quiet_NaN(); ///< dB, mean over images; NaN if there are none,
                                                            ///< +infinity if all are equal
    double ssim = std::numeric_limits<double>::quiet_NaN();
};

/// Means over the images that show the region: PSNR per image, then averaged with equal weights. If a score of an image
/// is NaN because the image holds a NaN, the mean is NaN.
[[nodiscard]] inline RegionMean mean_over_images(Span<const RegionScore> scores, std::size_t min_pixels = 50) {
    RegionMean mean;
    double psnr = 0, ssim = 0;
    std::size_t ssims = 0;
    for (const RegionScore& score : scores) {
        if (score.pixels == 0 || score.pixels < min_pixels) continue;
        ++mean.images;
        if (score.psnr == std::numeric_limits<double>::infinity()) ++mean.equal;
        else psnr += score.psnr;
        if (score.windows > 0) ssim += score.ssim, ++ssims;
    }
    if (mean.images > mean.equal) mean.psnr = psnr / static_cast<double>(mean.images - mean.equal);
    else if (mean.images > 0) mean.psnr = std::numeric_limits<double>::infinity();
    if (ssims > 0) mean.ssim = ssim / static_cast<double>(ssims);
    return mean;
}

} // namespace gsh
