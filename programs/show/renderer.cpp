// SPDX-License-Identifier: Apache-2.0
#include "show/renderer.hpp"

#include "common/gpu.hpp"
#include "common/machine.hpp"
#include "common/rasterizer.hpp"
#include "show/renderer_on.hpp"

#include <gsh/cpu.hpp>

namespace gsh::programs {

std::unique_ptr<Renderer> make_renderer(Machine& machine, const ShownPeople& people) {
    if (machine.has_gpu()) return renderer_on(*machine.gpu(), people);
    return std::make_unique<PeopleRenderer<cpu::Threads>>(machine.host(), people);
}
std::unique_ptr<Renderer> make_renderer(Machine& machine, const GaussianCloud<float>& scene,
                                        const PixelFilter& filter) {
    if (machine.has_gpu()) return renderer_on(*machine.gpu(), scene, filter);
    return std::make_unique<CloudRenderer<cpu::Threads>>(machine.host(), scene, filter);
}

} // namespace gsh::programs
