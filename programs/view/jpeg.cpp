// SPDX-License-Identifier: Apache-2.0
#include "view/jpeg.hpp"

#include <gsh/core/error.hpp>

#include <turbojpeg.h>

#include <cstddef>
#include <cstdint>
#include <memory>

namespace gsh::programs {

PixelImage quantise_on(cpu::Threads& backend, const Image<float>& image) {
    PixelImage result(3, image.height, image.width);
    const std::size_t plane = image.data.size() / 3;
    constexpr std::size_t grain = 4096; // pixels; their bytes stay in the first-level cache
    backend.for_chunks(plane, grain, [&](std::size_t, std::size_t begin, std::size_t end) {
        std::uint8_t bytes[grain];
        for (std::size_t c = 0; c < 3; ++c) {
            const float* const from = image.data.data() + c * plane + begin;
            for (std::size_t i = 0; i < end - begin; ++i) { // a loop that compilers vectorise
                const double value = 255 * static_cast<double>(from[i]);
                bytes[i] =
                    static_cast<std::uint8_t>(static_cast<int>(value > 0 ? (value < 255 ? value : 255) + 0.5 : 0.0));
            }
            std::uint8_t* const to = result.data.data() + 3 * begin + c;
            for (std::size_t i = 0; i < end - begin; ++i) to[3 * i] = bytes[i];
        }
    });
    return result;
}

std::string encode_jpeg(const PixelImage& image, int quality) {
    check_size("encode_jpeg", "channels", static_cast<std::size_t>(image.channels), 3);
    const struct Destroy {
        void operator()(void* handle) const { tjDestroy(handle); }
    } destroy;
    thread_local const std::unique_ptr<void, Destroy> compressor(tjInitCompress(), destroy);
    const int sampling = quality >= 90 ? TJSAMP_444 : TJSAMP_420;
    std::string bytes(tjBufSize(image.width, image.height, sampling), '\0');
    auto* destination = reinterpret_cast<unsigned char*>(bytes.data());
    auto size = static_cast<unsigned long>(bytes.size());
    if (compressor == nullptr || tjCompress2(compressor.get(), image.data.data(), image.width, 0, image.height,
                                             TJPF_RGB, &destination, &size, sampling, quality, TJFLAG_NOREALLOC) != 0)
        throw IoError("encode_jpeg: libjpeg-turbo: " + std::string(tjGetErrorStr2(compressor.get())));
    bytes.resize(size);
    return bytes;
}

} // namespace gsh::programs
