// SPDX-License-Identifier: Apache-2.0
/// @file  Photographs on a GPU: cropped, with unknown pixels, and in a step that is recorded once.
#include <gsh/backend/serial.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/image/image.hpp>
#include <gsh/photo/backdrop.hpp>
#include <gsh/photo/photo_pixels.hpp>

#include <gsh/cuda.cuh>

#include <doctest/doctest.h>

#include "support/cuda_device.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace gsh::photographs_on_device {
namespace {

constexpr int height = 45, width = 64;
constexpr std::size_t plane = height * width;
#if defined(GSH_CUDA_EMULATION)
constexpr float rounding = 0; // the host's bits
#else
constexpr float rounding = 5e-7f; // of a colour up to 1: nvcc fuses products and sums
#endif

/// Photographs whose masks are boxes in several places, the first `unknown[k]` pixels of which are not believed.
struct Photographs {
    std::vector<std::vector<std::uint8_t>> images, cropped, plates;
    std::vector<std::vector<UnknownPixel>> unknown;
    std::vector<Photo> photos;

    /// With plates, photographs k and k + 2 share one.
    explicit Photographs(const std::vector<std::size_t>& unknown_counts, bool with_plates = false) {
        Rng rng(3);
        const auto byte = [&] { return static_cast<std::uint8_t>(rng.below(256)); };
        for (int camera = 0; with_plates && camera < 2; ++camera) {
            plates.emplace_back(4 * plane);
            for (std::uint8_t& value : plates.back()) value = byte();
        }
        for (std::size_t k = 0; k < unknown_counts.size(); ++k) {
            const int shift = static_cast<int>(k);
            const PixelBox mask{4 + shift, 3, 40 + shift, 36 - shift};
            std::vector<std::uint8_t>& image = images.emplace_back(4 * plane);
            for (std::size_t i = 0; i < 4 * plane; ++i) image[i] = byte();
            std::vector<UnknownPixel>& doubted = unknown.emplace_back();
            for (int y = 0; y < height; ++y)
                for (int x = 0; x < width; ++x) {
                    const std::size_t at = whole_picture(height, width).index(x, y);
                    if (!mask.contains(x, y)) image[4 * at + 3] = 0;
                    else if (doubted.size() < unknown_counts[k])
                        doubted.push_back({static_cast<std::uint32_t>(at), {byte(), byte(), byte()}});
                }
            Photo photo{.name = std::to_string(k), .camera = {}, .rgba = Span<const std::uint8_t>(image)};
            photo.camera.height = height, photo.camera.width = width;
            photo.unknown = Span<const UnknownPixel>(doubted);
            if (with_plates) photo.plate = Span<const std::uint8_t>(plates[k % 2]);
            cropped.push_back(crop_photo(photo));
            photos.push_back(std::move(photo));
        }
    }
};

/// What a step of training does with a photograph first.
template <class B>
struct Shown {
    template <class U>
    using Buffer = typename B::template Buffer<U>;
    PhotoPixels<B> pixels;
    Backdrop<B, float> backdrop{{0.2, 0.5, 0.9}};
    Buffer<float> color = Buffer<float>(3 * plane), mask = Buffer<float>(plane);

    Shown(B& backend, const Photographs& from, std::uint64_t budget = PhotoPixels<B>::no_limit)
        : pixels(backend, from.photos, budget) {}
    void show(B& backend, std::size_t photo) {
        const auto& view = pixels[photo];
        backdrop.photograph(backend, view.rgba, view.box, view.plate, view.unknown, {color, 3, height, width},
                            {mask, 1, height, width});
    }
    std::vector<float> picture(B& backend) {
        std::vector<float> host(4 * plane);
        backend.download(Span<const float>(color), Span<float>(host).subspan(0, 3 * plane));
        backend.download(Span<const float>(mask), Span<float>(host).subspan(3 * plane, plane));
        return host;
    }
};

float largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
    float largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
    return largest;
}

} // namespace

TEST_CASE("photographs of different boxes and numbers of unknown pixels repeat one recorded step") {
    if (test::skip_without_device()) return;
    cuda::Device device;
    cpu::Serial host;
    const Photographs photographs({520, 1024, 700, 1000}); // blocks of threads would differ
    Shown<cuda::Device> shown(device, photographs);
    Shown<cpu::Serial> expected(host, photographs);
    shown.show(device, 0); // buffers grow
    cuda::StepGraph graph(device);
    for (int turn = 0; turn < 2; ++turn)
        for (std::size_t k = 0; k < photographs.photos.size(); ++k) {
            graph.run([&] { shown.show(device, k); });
            expected.show(host, k);
            CHECK(largest_difference(shown.picture(device), expected.picture(host)) <= rounding);
        }
    CHECK(graph.counts().captures == 1);
    CHECK(graph.counts().launches == 8);
}

TEST_CASE("plates and photographs that do not fit a budget are brought in time, also to a step that is recorded once") {
    if (test::skip_without_device()) return;
    cuda::Device device;
    const Photographs photographs({0, 3, 0, 5, 2}, true);
    Shown<cuda::Device> expected(device, photographs);
    const std::uint64_t plate = 4 * plane;
    for (const std::uint64_t budget : {std::uint64_t(0), plate + 100, 2 * plate + 100, 3 * plate + 100})
        for ([[maybe_unused]] const bool eager : {false, true}) {
            CAPTURE(budget);
#if defined(GSH_CUDA_EMULATION)
            test::CudaEmulation::instance().eager_streams = eager; // copies run as early as their events allow
#endif
            Shown<cuda::Device> shown(device, photographs, budget);
            cuda::StepGraph graph(device);
            shown.pixels.prepare(0);
            shown.show(device, 0); // buffers grow
            for (const std::size_t k : {0u, 1u, 2u, 3u, 4u, 2u, 1u, 1u, 0u, 4u, 3u, 2u}) {
                shown.pixels.prepare(k);
                graph.run([&] { shown.show(device, k); });
                shown.pixels.fetch((k + 1) % 5); // may be another than the next
                expected.show(device, k);
                CHECK(shown.picture(device) == expected.picture(device));
            }
        }
#if defined(GSH_CUDA_EMULATION)
    test::CudaEmulation::instance().eager_streams = false;
#endif
}

} // namespace gsh::photographs_on_device
