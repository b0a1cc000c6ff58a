// SPDX-License-Identifier: Apache-2.0
/// @file  The structural similarity of images, with its gradient.

#include "library/ssim.hpp"

#include "library/arrays.hpp"
#include "library/errors.hpp"

#include <gsh/image/image.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/loss/photometric.hpp>

#include <cstddef>

namespace gsh_python {

namespace {

template <class T>
void compare(const SsimSizes& sizes, const void* a, const void* b, double* value, void* da) {
    using Loss = gsh::PhotometricLoss<gsh::cpu::Threads, T>;
    thread_local typename Loss::Cache cache; // of the calling thread, so that steps allocate nothing
    const auto planes = static_cast<int>(sizes.planes);
    const std::size_t count = static_cast<std::size_t>(sizes.planes) * static_cast<std::size_t>(sizes.height) *
                              static_cast<std::size_t>(sizes.width);
    const auto view = [&](const void* image) {
        return gsh::ImageView<const T>{elements<T, T>(image, 0, count), planes, sizes.height, sizes.width};
    };
    gsh::cpu::Threads& backend = threads(sizes.threads);
    const Loss loss(backend, {.ssim_weight = T(1), .whole_windows = sizes.whole_windows != 0});
    loss.forward(view(a), view(b), cache);
    *value = loss.values(cache).ssim;
    if (da == nullptr) return;
    const gsh::ImageView<T> gradient{elements<T, T>(da, 0, count), planes, sizes.height, sizes.width};
    backend.fill(gradient.data, T(0));
    loss.backward(view(a), view(b), T(-1), cache, gradient); // the loss is 1 - SSIM
}

} // namespace

int ssim(const SsimSizes& sizes, const void* a, const void* b, double* value, void* da) {
    return guarded([&] {
        if (sizes.scalar_bytes == 4) compare<float>(sizes, a, b, value, da);
        else compare<double>(sizes, a, b, value, da);
    });
}

} // namespace gsh_python
