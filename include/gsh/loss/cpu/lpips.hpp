// SPDX-License-Identifier: Apache-2.0
/// @file  LPIPS on the CPU: convolutions as matrix products over tiles of pixels, with Eigen.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/math/linalg.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <vector>

namespace gsh::cpu::inline GSH_ISA {

namespace detail {

/// A feature map with channels innermost: a patch is a few long runs of memory, and the result of a matrix product is
/// one run.
template <class T>
struct LpipsMapView {
    T* data = nullptr;
    int height = 0, width = 0, channels = 0;

    [[nodiscard]] std::size_t pixel_count() const { return std::size_t(height) * std::size_t(width); }
    [[nodiscard]] std::size_t size() const { return pixel_count() * std::size_t(channels); }
    [[nodiscard]] T* at(int y, int x) const {
        return data + (std::size_t(y) * std::size_t(width) + std::size_t(x)) * std::size_t(channels);
    }
};

/// The window of `in` whose first pixel is (y, x), [kernel, kernel, channels], 0 beyond the border.
template <class T>
void copy_patch(const LpipsMapView<const T>& in, int y, int x, int kernel, T* out) {
    const int left = std::clamp(-x, 0, kernel), right = std::clamp(in.width - x, left, kernel);
    const auto channels = std::size_t(in.channels), row = std::size_t(kernel) * channels;
    for (int j = y; j < y + kernel; ++j, out += row) {
        if (j < 0 || j >= in.height || left == right) {
            std::fill(out, out + row, T(0));
            continue;
        }
        const T* from = in.at(j, x + left);
        T* to = std::fill_n(out, std::size_t(left) * channels, T(0));
        to = std::copy(from, from + std::size_t(right - left) * channels, to);
        std::fill(to, out + row, T(0));
    }
}

/// out = relu(weight * in + bias), as one matrix product per tile of output pixels.
template <CpuBackend B, class T>
void convolve_relu(B& backend, const LpipsMapView<const T>& in, const LpipsStep& step, const T* weight, const T* bias,
                   const LpipsMapView<T>& out) {
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    constexpr std::size_t tile = 256; // pixels; their patches stay in the second-level cache
    const auto channels = Eigen::Index(step.channels), taps = Eigen::Index(step.kernel) * step.kernel * in.channels;
    const Eigen::Map<const Matrix> rows(weight, taps, channels);
    backend.for_chunks(out.pixel_count(), tile, [&](std::size_t, std::size_t begin, std::size_t end) {
        Matrix patches(taps, Eigen::Index(end - begin));
        for (std::size_t p = begin; p < end; ++p) {
            const int y = int(p / std::size_t(out.width)), x = int(p % std::size_t(out.width));
            copy_patch(in, y * step.stride - step.padding, x * step.stride - step.padding, step.kernel,
                       patches.col(Eigen::Index(p - begin)).data());
        }
        T* first = out.data + begin * std::size_t(step.channels);
        Eigen::Map<Matrix>(first, channels, patches.cols()).noalias() = rows.transpose() * patches;
        for (std::size_t p = begin; p < end; ++p, first += step.channels)
            for (int c = 0; c < step.channels; ++c) {
                const T value = first[c] + bias[c];
                first[c] = value > T(0) ? value : T(0);
            }
    });
}

/// Maximum over each window; windows lie inside the map.
template <CpuBackend B, class T>
void max_pool(B& backend, const LpipsMapView<const T>& in, const LpipsStep& step, const LpipsMapView<T>& out) {
    backend.for_chunks(std::size_t(out.height), 1, [&](std::size_t, std::size_t row, std::size_t) {
        const int y = int(row);
        for (int x = 0; x < out.width; ++x) {
            T* to = out.at(y, x);
            std::copy_n(in.at(y * step.stride, x * step.stride), out.channels, to);
            for (int j = 0; j < step.kernel; ++j)
                for (int i = 0; i < step.kernel; ++i) {
                    const T* from = in.at(y * step.stride + j, x * step.stride + i);
                    for (int c = 0; c < out.channels; ++c) to[c] = from[c] > to[c] ? from[c] : to[c];
                }
        }
    });
}

/// Converts planes to interleaved pixels, x -> (x * stretch + offset - shift) / scale. False if a number is not finite.
template <CpuBackend B, class T>
bool normalise_image(B& backend, const ImageView<const T>& image, const LpipsWeights<B, T>& network,
                     LpipsScaling scaling, const LpipsMapView<T>& out) {
    const T stretch = scaling == LpipsScaling::correct ? T(2) : T(1);
    const T offset = scaling == LpipsScaling::correct ? T(-1) : T(0);
    std::atomic<bool> finite = true;
    backend.for_chunks(std::size_t(image.height), 16, [&](std::size_t, std::size_t begin, std::size_t end) {
        bool good = true;
        for (int y = int(begin); y < int(end); ++y)
            for (int c = 0; c < 3; ++c) {
                const T *from = image.row(c, y), shift = network.shift[std::size_t(c)];
                const T scale = network.scale[std::size_t(c)];
                T* to = out.at(y, 0) + c;
                for (int x = 0; x < image.width; ++x, to += 3) {
                    good = good && std::isfinite(from[x]);
                    *to = (from[x] * stretch + offset - shift) / scale;
                }
            }
        if (!good) finite = false;
    });
    return finite;
}

/// sum_c w_c (a_c / |a| - b_c / |b|)² at one pixel; the direction of a zero vector is 0.
template <class T>
T direction_difference(const T* a, const T* b, const T* w, std::size_t channels) {
    T aa = T(0), bb = T(0), sum = T(0);
    for (std::size_t c = 0; c < channels; ++c) aa += a[c] * a[c], bb += b[c] * b[c];
    const T inverse_a = T(1) / (std::sqrt(aa) + T(1e-10)), inverse_b = T(1) / (std::sqrt(bb) + T(1e-10));
    for (std::size_t c = 0; c < channels; ++c) {
        const T d = a[c] * inverse_a - b[c] * inverse_b;
        sum += w[c] * (d * d);
    }
    return sum;
}

} // namespace detail

/// Fills features.maps.
///
/// Errors  ValueError for an image that holds a NaN or an infinity.
template <CpuBackend B, class T>
void lpips_forward(B& backend, const LpipsWeights<B, T>& network, const ImageView<const T>& image,
                   LpipsScaling scaling, LpipsFeatures<B, T>& features) {
    const auto written = [](auto& map) {
        return detail::LpipsMapView<T>{map.values.data(), map.height, map.width, map.channels};
    };
    const auto read = [](const auto& map) {
        return detail::LpipsMapView<const T>{map.values.data(), map.height, map.width, map.channels};
    };
    gsh::detail::run_lpips_steps(
        network, features,
        [&](auto& out) {
            check_value(detail::normalise_image(backend, image, network, scaling, written(out)), "Lpips::forward",
                        "image holds a NaN or an infinity, expected numbers in [0, 1]");
        },
        [&](const auto& in, const LpipsStep& step, const auto& weights, auto& out) {
            detail::convolve_relu(backend, read(in), step, weights.weight.data(), weights.bias.data(), written(out));
        },
        [&](const auto& in, const LpipsStep& step, auto& out) {
            detail::max_pool(backend, read(in), step, written(out));
        });
}

/// Sum over maps of the mean over pixels of the weighted squared difference of directions.
template <CpuBackend B, class T>
double lpips_distance(B& backend, const LpipsWeights<B, T>& network, const LpipsFeatures<B, T>& a,
                      const LpipsFeatures<B, T>& b) {
    constexpr std::size_t grain = 256; // pixels
    double distance = 0;
    for (std::size_t k = 0; k < a.maps.size(); ++k) {
        const auto &p = a.maps[k], &q = b.maps[k];
        const auto channels = std::size_t(p.channels);
        std::vector<double> sums(chunk_count(p.pixel_count(), grain), 0);
        backend.for_chunks(p.pixel_count(), grain, [&](std::size_t chunk, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                sums[chunk] += double(detail::direction_difference(p.values.data() + i * channels,
                                                                   q.values.data() + i * channels,
                                                                   network.lins[k].data(), channels));
        });
        double total = 0;
        for (const double sum : sums) total += sum;
        distance += total / double(p.pixel_count());
    }
    return distance;
}

} // namespace gsh::cpu
