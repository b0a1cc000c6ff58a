// SPDX-License-Identifier: Apache-2.0
/// @file  Planar images: one contiguous plane of rows per channel.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/memory.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <concepts>
#include <cstddef>
#include <type_traits>
#include <vector>

namespace gsh {

/// View of a planar image, [channels, height, width]; `ImageView<const T>` is an input. The layout is planar because
/// filters and losses process one channel at a time and load consecutive pixels of a row into one register.
template <class T>
struct ImageView {
    Span<T> data;
    int channels = 0, height = 0, width = 0;

    [[nodiscard]] GSH_HD std::size_t plane_size() const {
        return static_cast<std::size_t>(height) * static_cast<std::size_t>(width);
    }
    [[nodiscard]] GSH_HD std::size_t size() const { return plane_size() * static_cast<std::size_t>(channels); }
    [[nodiscard]] GSH_HD bool empty() const { return size() == 0; }
    /// The index of a row's first pixel.
    [[nodiscard]] GSH_HD std::size_t row_begin(int channel, int y) const {
        return (static_cast<std::size_t>(channel) * static_cast<std::size_t>(height) + static_cast<std::size_t>(y)) *
               static_cast<std::size_t>(width);
    }
    [[nodiscard]] GSH_HD T* row(int channel, int y) const { return data.data() + row_begin(channel, y); }
    [[nodiscard]] GSH_HD T& at(int channel, int y, int x) const {
        return data[row_begin(channel, y) + static_cast<std::size_t>(x)];
    }

    template <std::same_as<T> U> // a template, because nvcc warns about a conversion to the same type
        requires(!std::is_const_v<T>)
    [[nodiscard]] operator ImageView<const U>() const
    {
        return {data, channels, height, width};
    }
};

/// Throws MemoryError unless the backend reaches the image; an empty one passes.
template <Backend B, class T>
void check_memory(const B& backend, std::string_view where, std::string_view argument, const ImageView<T>& image) {
    check_memory(backend, where, argument, image.data);
}

/// A planar image in host memory.
template <class T>
struct Image {
    std::vector<T> data;
    int channels = 0, height = 0, width = 0;

    Image() = default;
    Image(int channel_count, int rows, int columns, T value = T(0))
        : data(static_cast<std::size_t>(channel_count) * static_cast<std::size_t>(rows) *
                   static_cast<std::size_t>(columns),
               value),
          channels(channel_count), height(rows), width(columns) {}

    [[nodiscard]] ImageView<T> view() { return {data, channels, height, width}; }
    [[nodiscard]] ImageView<const T> view() const { return {data, channels, height, width}; }
    [[nodiscard]] T& at(int channel, int y, int x) { return view().at(channel, y, x); }
    [[nodiscard]] const T& at(int channel, int y, int x) const { return view().at(channel, y, x); }
};

namespace detail {

/// `Picture`: ImageView, or another with the same members channels, height and width.
template <class Picture>
void check_shape(std::string_view where, std::string_view argument, const Picture& picture, int channels, int height,
                 int width) {
    const auto text = [](int c, int h, int w) {
        return std::to_string(c) + "x" + std::to_string(h) + "x" + std::to_string(w);
    };
    if (picture.channels != channels || picture.height != height || picture.width != width)
        throw ShapeError(std::string(where) + ": " + std::string(argument) + " is " +
                         text(picture.channels, picture.height, picture.width) + ", expected " +
                         text(channels, height, width) + " (channels x height x width)");
}

} // namespace detail

/// Throws ShapeError unless the image has the given channels and size.
template <class T>
void check_image(std::string_view where, std::string_view argument, const ImageView<T>& image, int channels,
                 int height, int width) {
    detail::check_shape(where, argument, image, channels, height, width);
    check_size(where, argument, image.data.size(), image.size());
}

} // namespace gsh
