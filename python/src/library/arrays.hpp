// SPDX-License-Identifier: Apache-2.0
/// @file  Arrays of a caller as gsh's views, its cameras, and the threads that work on them.
#pragma once

#include "interface.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>

#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <mutex>
#include <string>

namespace gsh_python {

/// The elements of type Element that follow `offset` numbers in an array; empty for a null pointer.
template <class Element, class T>
[[nodiscard]] gsh::Span<const Element> elements(const void* array, std::size_t offset, std::size_t count) {
    if (array == nullptr) return {};
    return {reinterpret_cast<const Element*>(static_cast<const T*>(array) + offset), count};
}
template <class Element, class T>
[[nodiscard]] gsh::Span<Element> elements(void* array, std::size_t offset, std::size_t count) {
    if (array == nullptr) return {};
    return {reinterpret_cast<Element*>(static_cast<T*>(array) + offset), count};
}

/// The backend with this many threads. Backends stay for the next call.
[[nodiscard]] inline gsh::cpu::Threads& threads(int count) {
    static std::mutex mutex;
    static std::map<int, std::unique_ptr<gsh::cpu::Threads>> backends;
    const std::lock_guard lock(mutex);
    std::unique_ptr<gsh::cpu::Threads>& backend = backends[count];
    if (!backend) backend = std::make_unique<gsh::cpu::Threads>(static_cast<std::size_t>(count < 1 ? 1 : count));
    return *backend;
}

/// Camera `image` of [B * C]. The last rows of viewmats and Ks are not read.
template <class T>
[[nodiscard]] gsh::Camera<T> camera_of(const CameraArrays& cameras, std::size_t image) {
    const T* const m = static_cast<const T*>(cameras.viewmats) + 16 * image;
    const T* const K = static_cast<const T*>(cameras.Ks) + 9 * image;
    gsh::Camera<T> camera;
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) camera.R[c][r] = m[4 * r + c];
        camera.t[r] = m[4 * r + 3];
    }
    camera.fx = K[0], camera.cx = K[2], camera.fy = K[4], camera.cy = K[5];
    camera.width = cameras.width, camera.height = cameras.height;
    const std::string place = "[camera " + std::to_string(image) + "]";
    for (int k = 0; k < 12; ++k)
        gsh::check_value(std::isfinite(m[k]), "viewmats" + place, "holds a NaN or an infinity");
    for (int k = 0; k < 6; ++k) gsh::check_value(std::isfinite(K[k]), "Ks" + place, "holds a NaN or an infinity");
    gsh::check_value(K[0] > T(0) && K[4] > T(0), "Ks" + place, "focal lengths must be above 0, in pixels");
    gsh::check_value(std::abs(K[1]) <= T(1e-6) * K[0], "Ks" + place, "has skew, expected 0");
    return camera;
}

} // namespace gsh_python
