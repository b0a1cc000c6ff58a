// SPDX-License-Identifier: Apache-2.0
/// @file  What the photometric loss is told, reports, and remembers between forward and backward.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>

#include <cstddef>
#include <cstdint>

namespace gsh {

template <class T>
struct PhotometricParams {
    T ssim_weight = T(0.2);  ///< λ of (1-λ) L1 + λ (1 - SSIM), as in 3D Gaussian Splatting
    bool skip_equal = true;  ///< leave out tiles in which the images are equal: same bits, less time
};

/// The parts of the loss, as one report.
struct PhotometricValues {
    double loss = 0; ///< (1-λ) l1 + λ (1 - ssim)
    double l1 = 0;   ///< mean |render - truth|
    double ssim = 0; ///< mean over pixels and channels; NaN where ssim_weight is 0: not computed
};

/// Partial derivatives of the SSIM term, kept tile by tile.
template <Backend B, std::floating_point T = float>
struct PhotometricCache {
    template <class U>
    using Buffer = typename B::template Buffer<U>;

    int channels = 0, height = 0, width = 0;
    bool with_ssim = false;
    Buffer<double> values;       ///< [3] loss, l1, ssim
    Buffer<T> partials;          ///< [tiles, 3, tile rows, tile columns]; garbage in tiles that are not active
    Buffer<std::uint8_t> active; ///< [tiles] 1 where some window of the tile sees a difference
    Buffer<double> sums;         ///< [tiles, 2] sums of |render - truth| and of 1 - SSIM
};

} // namespace gsh
