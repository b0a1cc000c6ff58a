// SPDX-License-Identifier: Apache-2.0
/// @file  LPIPS on the GPU, for evaluation: convolutions as matrix products of tiles in shared memory.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/pack.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/cuda/sum.cuh>
#include <gsh/backend/cuda/unroll.cuh>
#include <gsh/core/error.hpp>
#include <gsh/core/lane.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/lpips_network.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace gsh::cuda {

namespace detail {

/// A feature map, [height, width, channels]: channels are innermost, so a row of a patch is one run of memory.
template <class T>
struct LpipsMapView {
    Span<T> values;
    int height, width, channels;

    /// Index of the first channel of a pixel.
    [[nodiscard]] __device__ std::size_t at(int y, int x) const {
        return (std::size_t(y) * std::size_t(width) + std::size_t(x)) * std::size_t(channels);
    }
    [[nodiscard]] __device__ bool contains(int y, int x) const { return y >= 0 && y < height && x >= 0 && x < width; }
    [[nodiscard]] GSH_HD int pixel_count() const { return height * width; }
};

/// Converts planes to interleaved pixels, x -> (x * stretch + offset - shift) / scale. Sets failed[0] where a number is
/// not finite. One pixel.
template <class T>
struct LpipsNormalise {
    ImageView<const T> image;
    T stretch, offset;
    vec3<T> shift, scale;
    Span<T> out;
    Span<std::uint32_t> failed;

    __device__ void operator()(std::size_t pixel) const {
        for (int c = 0; c < 3; ++c) {
            const T value = image.data[std::size_t(c) * image.plane_size() + pixel];
            if (!(value - value == T(0))) failed[0] = 1; // all threads write the same value
            out[3 * pixel + std::size_t(c)] = (value * stretch + offset - shift[c]) / scale[c];
        }
    }
};

/// One number of the maxima over windows, which lie inside the map.
template <class T>
struct LpipsMaxPool {
    LpipsMapView<const T> in;
    LpipsMapView<T> out;
    int kernel, stride;

    __device__ void operator()(std::size_t i) const {
        const std::size_t channel = i % std::size_t(out.channels);
        const int pixel = int(i / std::size_t(out.channels)), y = pixel / out.width, x = pixel % out.width;
        T largest = in.values[in.at(y * stride, x * stride) + channel];
        for (int v = 0; v < kernel; ++v)
            for (int u = 0; u < kernel; ++u)
                largest = gsh::max(largest, in.values[in.at(y * stride + v, x * stride + u) + channel]);
        out.values[i] = largest;
    }
};

/// out = relu(weight * in + bias) for a tile of 64 output pixels and 64 channels.
///
/// The product runs over the taps of a patch, 16 at a time: a block loads those of its pixels and of its channels into
/// shared memory, while it multiplies the 16 before. Consecutive taps form packs of 16 bytes, in rows of an odd number
/// of packs, so that eight threads that read eight rows access all banks. A thread has 4 x 4 outputs, so that it
/// multiplies 64 times for 8 packs.
template <class T>
struct LpipsConvolution {
    static constexpr unsigned block_size = 256;
    static constexpr unsigned pack = widest_pack<T>;
    static constexpr int side = 64, micro = 4, apart = side / micro; // outputs of a tile and of a thread
    static constexpr int step = 16, packs = step / int(pack), row_stride = packs + 1;
    static constexpr int loads = side * packs / int(block_size); // packs of each operand that a thread loads
    static_assert(row_stride % 2 == 1 && apart * apart == int(block_size));
    using Values = Pack<T, pack>;
    struct Shared {
        SharedArray<Values, side * row_stride> patches, weights;
    };

    LpipsMapView<const T> in;
    LpipsMapView<T> out;
    int kernel, stride, padding;
    Span<const T> weight, bias; // [channels, kernel, kernel, input channels], [channels]

    [[nodiscard]] GSH_HD int tiles_of_channels() const { return (out.channels + side - 1) / side; }
    [[nodiscard]] std::size_t tiles() const {
        return std::size_t(tiles_of_channels()) * std::size_t((out.pixel_count() + side - 1) / side);
    }

    __device__ void operator()(Shared& shared) const {
        const int first_pixel = int(blockIdx.x) / tiles_of_channels() * side;
        const int first_channel = int(blockIdx.x) % tiles_of_channels() * side;
        const int taps = kernel * kernel * in.channels;
        const int row = int(threadIdx.x) / apart, column = int(threadIdx.x) % apart;

        T sums[micro][micro] = {};
        Values patches[loads], weights[loads];
        load(first_pixel, first_channel, 0, taps, patches, weights);
        for (int first = 0; first < taps; first += step) {
            for (int k = 0; k < loads; ++k) {
                const int n = k * int(block_size) + int(threadIdx.x);
                const auto place = std::size_t(n / packs * row_stride + n % packs);
                shared.patches[place] = patches[k], shared.weights[place] = weights[k];
            }
            __syncthreads();
            if (first + step < taps) load(first_pixel, first_channel, first + step, taps, patches, weights);
            unrolled<packs>([&]<int p>() {
                Values patch_taps[micro];
                unrolled<micro>(
                    [&]<int m>() { patch_taps[m] = shared.patches[std::size_t((row + m * apart) * row_stride + p)]; });
                unrolled<micro>([&]<int c>() {
                    const Values taps_of_weight = shared.weights[std::size_t((column + c * apart) * row_stride + p)];
                    unrolled<micro* int(pack)>([&]<int n>() {
                        sums[n % micro][c] += patch_taps[n % micro][n / micro] * taps_of_weight[n / micro];
                    });
                });
            });
            __syncthreads();
        }
        unrolled<micro * micro>([&]<int n>() {
            const int pixel = first_pixel + row + n / micro * apart,
                      channel = first_channel + column + n % micro * apart;
            if (pixel >= out.pixel_count() || channel >= out.channels) return;
            const T value = sums[n / micro][n % micro] + bias[std::size_t(channel)];
            out.values[std::size_t(pixel) * std::size_t(out.channels) + std::size_t(channel)] =
                value > T(0) ? value : T(0);
        });
    }

private:
    __device__ void load(int first_pixel, int first_channel, int first_tap, int taps, Values (&patches)[loads],
                         Values (&weights)[loads]) const {
        for (int k = 0; k < loads; ++k) {
            const int n = k * int(block_size) + int(threadIdx.x), tap = first_tap + n % packs * int(pack);
            const int pixel = first_pixel + n / packs, channel = first_channel + n / packs;
            patches[k] = weights[k] = {};
            if (pixel < out.pixel_count() && tap < taps) patches[k] = patch(pixel, tap, taps);
            if (channel < out.channels && tap < taps) weights[k] = weights_of(channel, tap, taps);
        }
    }
    /// Taps [tap, tap + pack) of an output pixel's patch, 0 beyond the border of the map and the end of the patch.
    __device__ Values patch(int pixel, int tap, int taps) const {
        const int y = pixel / out.width * stride - padding, x = pixel % out.width * stride - padding;
        Values values{};
        if (in.channels % int(pack) == 0) { // they are channels of one pixel
            const int place = tap / in.channels, v = y + place / kernel, u = x + place % kernel;
            if (in.contains(v, u)) values = load_pack<pack>(in.values, in.at(v, u) + std::size_t(tap % in.channels));
            return values;
        }
        for (unsigned i = 0; i < pack; ++i) {
            const int t = tap + int(i), place = t / in.channels, v = y + place / kernel, u = x + place % kernel;
            if (t < taps && in.contains(v, u)) values[i] = in.values[in.at(v, u) + std::size_t(t % in.channels)];
        }
        return values;
    }
    __device__ Values weights_of(int channel, int tap, int taps) const {
        const std::size_t first = std::size_t(channel) * std::size_t(taps) + std::size_t(tap);
        if (taps % int(pack) == 0) return load_pack<pack>(weight, first);
        Values values{};
        for (unsigned i = 0; i < pack; ++i)
            if (tap + int(i) < taps) values[i] = weight[first + i];
        return values;
    }
};

/// Sums over blocks of pixels of sum_c w_c (a_c / |a| - b_c / |b|)²; the direction of a zero vector is 0. A warp takes
/// some pixels one after the other, its lanes the channels.
template <class T>
struct LpipsDifference {
    static constexpr unsigned block_size = 256, warps = block_size / warp_size;
    static constexpr std::size_t pixels = 64; // of a block
    struct Shared {
        SharedArray<T, warps> sums;
    };
    Span<const T> a, b, w;
    Span<double> sums;

    __device__ void operator()(Shared& shared) const {
        const std::size_t channels = w.size(), count = a.size() / channels, begin = blockIdx.x * pixels;
        const std::size_t lane = threadIdx.x % warp_size;
        T sum(0);
        for (std::size_t i = begin + threadIdx.x / warp_size; i < begin + pixels && i < count;
             i += warps) { // for a warp
            T aa(0), bb(0);
            for (std::size_t c = lane; c < channels; c += warp_size) {
                const T p = a[i * channels + c], q = b[i * channels + c];
                aa += p * p, bb += q * q;
            }
            const T length_a = gsh::sqrt(warp_sum(aa)) + T(1e-10), length_b = gsh::sqrt(warp_sum(bb)) + T(1e-10);
            for (std::size_t c = lane; c < channels; c += warp_size) {
                // Quotients, because a compiler may fuse one of two products with the difference. Equal vectors would
                // then differ, and the distance would depend on the order of the images.
                const T d = a[i * channels + c] / length_a - b[i * channels + c] / length_b;
                sum += w[c] * (d * d);
            }
        }
        sum = block_sum<block_size>(shared.sums, sum);
        if (threadIdx.x == 0) sums[blockIdx.x] = double(sum);
    }
};

} // namespace detail

/// Fills features.maps. Waits once, for whether the image is accepted.
///
/// Errors  ValueError for an image that holds a NaN or an infinity.
template <class T>
void lpips_forward(Device& device, const LpipsWeights<Device, T>& network, const ImageView<const T>& image,
                   LpipsScaling scaling, LpipsFeatures<Device, T>& features) {
    const auto written = [](auto& map) {
        return detail::LpipsMapView<T>{map.values, map.height, map.width, map.channels};
    };
    const auto read = [](const auto& map) {
        return detail::LpipsMapView<const T>{map.values, map.height, map.width, map.channels};
    };
    const auto begin = [&](auto& out) {
        const bool stretched = scaling == LpipsScaling::correct;
        const auto rgb = [](const auto& values) { return vec3<T>(values[0], values[1], values[2]); };
        Device::Buffer<std::uint32_t> failed(1);
        device.fill(Span<std::uint32_t>(failed), 0u);
        device.for_each(image.plane_size(),
                        detail::LpipsNormalise<T>{image, T(stretched ? 2 : 1), T(stretched ? -1 : 0),
                                                  rgb(network.shift), rgb(network.scale), out.values, failed});
        std::uint32_t refused = 0;
        device.download(Span<const std::uint32_t>(failed), Span<std::uint32_t>(&refused, 1));
        check_value(refused == 0, "Lpips::forward", "image holds a NaN or an infinity, expected numbers in [0, 1]");
    };
    const auto convolve = [&](const auto& in, const LpipsStep& step, const auto& weights, auto& out) {
        const detail::LpipsConvolution<T> kernel{read(in),     written(out),   step.kernel, step.stride,
                                                 step.padding, weights.weight, weights.bias};
        device.launch(kernel.tiles(), kernel);
    };
    const auto pool = [&](const auto& in, const LpipsStep& step, auto& out) {
        device.for_each(out.values.size(), detail::LpipsMaxPool<T>{read(in), written(out), step.kernel, step.stride});
    };
    gsh::detail::run_lpips_steps(network, features, begin, convolve, pool);
}

/// Sum over maps of the mean over pixels of the weighted squared difference of directions. Waits for the result.
template <class T>
double lpips_distance(Device& device, const LpipsWeights<Device, T>& network, const LpipsFeatures<Device, T>& a,
                      const LpipsFeatures<Device, T>& b) {
    const std::size_t maps = a.maps.size();
    Device::Buffer<double> sums, totals(maps), partials;
    device.fill(Span<double>(totals), 0.0);
    for (std::size_t k = 0; k < maps; ++k) {
        using Kernel = detail::LpipsDifference<T>;
        const std::size_t blocks = chunk_count(a.maps[k].pixel_count(), Kernel::pixels);
        sums.resize(blocks);
        device.launch(blocks, Kernel{a.maps[k].values, b.maps[k].values, network.lins[k], sums});
        add_sum(device, Span<const double>(sums), Span<double>(totals).subspan(k, 1), partials);
    }
    std::vector<double> host(maps);
    device.download(Span<const double>(totals), Span<double>(host));
    double distance = 0;
    for (std::size_t k = 0; k < maps; ++k) distance += host[k] / double(a.maps[k].pixel_count());
    return distance;
}

} // namespace gsh::cuda
