// SPDX-License-Identifier: Apache-2.0
/// @file  Settings, values and cache of the photometric loss.
#pragma once

#include <gsh/backend/backend.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

template <class T>
struct PhotometricParams {
    T ssim_weight = T(0.2);  ///< λ of (1-λ) L1 + λ (1 - SSIM), as in 3D Gaussian Splatting
    bool skip_equal = true;  ///< skip tiles in which the images are equal: bit-identical, and faster
    /// SSIM's mean is over the windows that lie within the image, not over those of all pixels. On the CPU backends.
    bool whole_windows = false;
};

/// The loss and its parts.
struct PhotometricValues {
    double loss = 0; ///< (1-λ) l1 + λ (1 - ssim)
    double l1 = 0;   ///< mean |render - truth|
    double ssim = 0; ///< mean over pixels and channels; NaN where ssim_weight is 0: not computed
    double mse = 0;  ///< mean (render - truth)², which is not a part of the loss; see psnr_of_mse

    static constexpr std::size_t count = 4;
    /// From `count` numbers, in the order of the members: as backends store them.
    [[nodiscard]] static PhotometricValues from(const double* numbers) {
        return {numbers[0], numbers[1], numbers[2], numbers[3]};
    }
};

/// Whether the overloads of a backend read a CompositePicture, too.
template <class B>
inline constexpr bool photometric_composites = false;

/// Private storage of a backend, for instance partial derivatives of the SSIM term and sums of each tile. Each backend
/// specialises it beside its overloads.
template <Backend B, std::floating_point T>
struct PhotometricScratch {
    static_assert(detail::overload_is_included<B>,
                  "PhotometricLoss: include its backend's overloads, <gsh/loss/cpu/photometric.hpp> or <gsh/cpu.hpp>");
};

/// Results of forward, which backward needs.
template <Backend B, std::floating_point T = float>
struct PhotometricCache {
    int channels = 0, height = 0, width = 0;
    bool with_ssim = false;
    typename B::template Buffer<double> values; ///< [PhotometricValues::count] loss, l1, ssim, mse
    PhotometricScratch<B, T> scratch;           ///< the backend's own
};

} // namespace gsh
