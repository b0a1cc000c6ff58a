// SPDX-License-Identifier: Apache-2.0
/// @file  Renders scenes and avatars, on whichever backend, into pictures in host memory.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <memory>

namespace gsh {
template <class T>
struct GaussianCloud;
}

namespace gsh::programs {

class Machine;
struct ShownPeople;

/// A scene in the memory of a backend. renderer_on.hpp has the classes of both kinds of scenes.
class Renderer {
public:
    Renderer() = default;
    Renderer(const Renderer&) = delete;
    virtual ~Renderer() = default;

    /// Renders the scene at a frame of its motions, if it has any.
    [[nodiscard]] virtual Image<float> render(std::size_t frame, const Camera<double>& camera,
                                              const vec3<float>& background) = 0;
};

/// Renders avatars in one scene; a person in front hides the others. Lit avatars cast shadows on each other. `people`
/// and the machine must outlive the result.
std::unique_ptr<Renderer> make_renderer(Machine& machine, const ShownPeople& people);

/// Renders a static 3DGS scene, with the usual pixel filter or another one. The machine must outlive the result.
std::unique_ptr<Renderer> make_renderer(Machine& machine, const GaussianCloud<float>& scene,
                                        const PixelFilter& filter = {});

} // namespace gsh::programs
