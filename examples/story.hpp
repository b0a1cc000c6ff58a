// SPDX-License-Identifier: Apache-2.0
/// @file  Shared by the numbered stories: main function, claims, memory of a backend, a landscape as a formula.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <initializer_list>
#include <string>
#include <type_traits>
#include <vector>

namespace gsh::examples {

/// Runs a story with the folder named on the command line (default: the current one). Returns 1 after a broken claim or
/// an error.
template <class Story>
int tell(int argc, char** argv, const Story& story) {
    try {
        const std::filesystem::path folder = argc > 1 ? argv[1] : ".";
        std::filesystem::create_directories(folder);
        story(folder);
        return 0;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}

/// Checks a statement of a story and prints it.
/// Errors  ValueError if it does not hold.
inline void claim(bool holds, const std::string& what) {
    check_value(holds, "broken claim", what);
    std::printf("holds: %s\n", what.c_str());
}

/// A view of vectors, quaternions and similar types in a backend's memory as numbers.
template <class Buffer>
[[nodiscard]] Span<float> numbers(Buffer& buffer) {
    return view_as<float>(Span<std::remove_pointer_t<decltype(buffer.data())>>(buffer));
}

/// A copy on the host of an image in a backend's memory.
template <Backend B, class T>
[[nodiscard]] Image<T> on_host(B& backend, const ImageView<T>& image) {
    Image<T> host(image.channels, image.height, image.width);
    backend.download(Span<const T>(image.data), Span<T>(host.data));
    return host;
}

/// Places pictures of the same height side by side.
template <class T>
[[nodiscard]] Image<T> beside(std::initializer_list<const Image<T>*> pictures) {
    int width = 0;
    for (const Image<T>* picture : pictures) width += picture->width;
    const Image<T>& first = **pictures.begin();
    Image<T> row(first.channels, first.height, width);
    int left = 0;
    for (const Image<T>* picture : pictures) {
        check_image("beside", "picture", picture->view(), row.channels, row.height, picture->width);
        for (int c = 0; c < row.channels; ++c)
            for (int y = 0; y < row.height; ++y)
                std::copy_n(picture->view().row(c, y), picture->width, row.view().row(c, y) + left);
        left += picture->width;
    }
    return row;
}

/// The colour of a landscape at dusk at a point of the unit square: u to the right, v down. Edges have a width of 0.01.
[[nodiscard]] inline vec3<float> landscape(float u, float v) {
    const auto mix = [](const vec3<float>& a, const vec3<float>& b, float t) { return a + (b - a) * t; };
    const auto step = [](float x) { // from 0 to 1 around x = 0
        const float t = std::clamp(x / 0.01f + 0.5f, 0.0f, 1.0f);
        return t * t * (3 - 2 * t);
    };
    vec3<float> color = mix({0.20f, 0.26f, 0.55f}, {0.98f, 0.66f, 0.42f}, std::min(1.0f, 1.5f * v)); // sky
    color = mix(color, {1.0f, 0.93f, 0.70f}, step(0.11f - std::hypot(u - 0.68f, v - 0.36f)));        // sun
    const vec3<float> near_hill(0.10f, 0.20f, 0.17f), far_hill(0.45f, 0.38f, 0.52f);
    for (int k = 0; k < 4; ++k) { // hills, the far ones first
        const float t = static_cast<float>(k), nearness = t / 3;
        const float ridge =
            0.42f + 0.11f * t + 0.06f * std::sin((5 + 3 * t) * u + 1.7f * t) + 0.015f * std::sin((23 + 5 * t) * u + t);
        color = mix(color, mix(far_hill, near_hill, nearness), step(v - ridge));
    }
    const float distance = (v - 0.80f) / 0.20f;                                        // a field in the foreground
    const float furrows = 0.5f + 0.5f * std::sin(40 * (u - 0.5f) / (0.4f + distance)); // that meet at the horizon
    const vec3<float> soil = mix({0.55f, 0.38f, 0.20f}, {0.85f, 0.70f, 0.35f}, furrows);
    return mix(color, soil, step(v - 0.80f - 0.02f * std::sin(6 * u)));
}

/// The landscape at the pixel centres of a square picture.
[[nodiscard]] inline Image<float> landscape_picture(int size) {
    Image<float> picture(3, size, size);
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const float scale = 1 / static_cast<float>(size);
            const vec3<float> color =
                landscape((static_cast<float>(x) + 0.5f) * scale, (static_cast<float>(y) + 0.5f) * scale);
            for (int c = 0; c < 3; ++c) picture.at(c, y, x) = color[c];
        }
    return picture;
}

} // namespace gsh::examples
