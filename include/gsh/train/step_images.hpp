// SPDX-License-Identifier: Apache-2.0
/// @file  The images of a training step: what was rendered, what was photographed, and the loss's gradient.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>

#include <concepts>
#include <cstddef>

namespace gsh {

/// Three images of one size in the backend's memory. Their buffers grow with the largest view and keep their memory.
///
/// Shapes  render, truth, dL_drender [3, height, width].
template <Backend B, std::floating_point T>
class StepImages {
public:
    using Buffer = typename B::template Buffer<T>;

    void resize(int height, int width) {
        height_ = height, width_ = width;
        for (Buffer* buffer : {&render_, &truth_, &dL_drender_}) buffer->resize(3 * plane_size());
    }

    [[nodiscard]] int height() const { return height_; }
    [[nodiscard]] int width() const { return width_; }
    [[nodiscard]] std::size_t plane_size() const {
        return static_cast<std::size_t>(height_) * static_cast<std::size_t>(width_);
    }

    [[nodiscard]] ImageView<T> render() { return view(render_, 3); }
    [[nodiscard]] ImageView<T> truth() { return view(truth_, 3); }
    [[nodiscard]] ImageView<T> dL_drender() { return view(dL_drender_, 3); }
    [[nodiscard]] ImageView<const T> render() const { return {render_, 3, height_, width_}; }
    [[nodiscard]] ImageView<const T> truth() const { return {truth_, 3, height_, width_}; }

    /// Another buffer as an image of this size, and made as large first.
    [[nodiscard]] ImageView<T> in(Buffer& buffer, int channels) const {
        buffer.resize(static_cast<std::size_t>(channels) * plane_size());
        return view(buffer, channels);
    }

    /// PSNR of render against truth; waits for both.
    [[nodiscard]] double psnr(B& backend) const {
        const Image<T> seen = download(backend, render()), wanted = download(backend, truth());
        return gsh::psnr(seen.view(), wanted.view());
    }

    /// Copies one of the images to the host, and the plane of alpha [1, height, width] that came with it, if asked.
    /// write(plane) makes both; nobody wants alpha where the plane is empty.
    template <class Write>
    void take(B& backend, const ImageView<const T>& image, Image<T>& color, Image<T>* alpha, const Write& write) const {
        Buffer buffer;
        const ImageView<T> plane = alpha ? in(buffer, 1) : ImageView<T>{};
        write(plane);
        color = download(backend, image);
        if (alpha) *alpha = download(backend, plane);
    }

private:
    int height_ = 0, width_ = 0;
    Buffer render_, truth_, dL_drender_;

    [[nodiscard]] static Image<T> download(B& backend, const ImageView<const T>& image) {
        Image<T> host(image.channels, image.height, image.width);
        backend.download(image.data, Span<T>(host.data));
        return host;
    }
    [[nodiscard]] ImageView<T> view(Buffer& buffer, int channels) const { return {buffer, channels, height_, width_}; }
};

} // namespace gsh
