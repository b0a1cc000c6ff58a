// SPDX-License-Identifier: Apache-2.0
/// @file  Draws the pictures that a page asks for, with gsh's own rasterizer.
#pragma once

#include "view/view_request.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/image/image.hpp>
#include <gsh/light/light.hpp>

#include <memory>

namespace gsh::programs {

struct ViewScene;

/// A scene that is ready to be drawn. One picture at a time.
class ViewPainter {
public:
    /// The backend and the scene must outlive the painter.
    ViewPainter(cpu::Threads& backend, const ViewScene& scene);
    ~ViewPainter();
    ViewPainter(const ViewPainter&) = delete;
    ViewPainter& operator=(const ViewPainter&) = delete;

    /// The picture is valid until the next call.
    /// Errors  those of posing and of the rasterizer.
    [[nodiscard]] const Image<float>& draw(const ViewRequest& request);

private:
    class Painted;
    std::unique_ptr<Painted> painted_;
};

/// A light after a turn about the vertical through `centre`, from +z towards +x.
/// Units   radians.
[[nodiscard]] LightData turned_light(LightData light, double angle, const vec3<double>& centre);

} // namespace gsh::programs
