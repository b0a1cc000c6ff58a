// SPDX-License-Identifier: Apache-2.0
#include "support/reconstruction.hpp"

#include "support/gpu.hpp"
#include "support/machine.hpp"
#include "support/rasterizer.hpp"
#include "support/reconstruction_on.hpp"

#include <gsh/cpu.hpp>

#include <utility>

namespace gsh::examples {

std::unique_ptr<Reconstruction> make_reconstruction(Machine& machine, ReconstructionSetup setup) {
    if (machine.has_gpu()) return reconstruction_on(*machine.gpu(), std::move(setup));
    return std::make_unique<ReconstructionOn<cpu::Threads>>(machine.host(), std::move(setup));
}

void TrainingRecord::add(const StepValues& values) {
    if (values.step != 1 && values.step % interval != 0) return;
    loss.emplace_back(static_cast<double>(values.step), values.loss);
    psnr.emplace_back(static_cast<double>(values.step), values.psnr);
    constexpr std::size_t most = 600;
    if (loss.size() < most) return;
    interval *= 2;
    for (auto* curve : {&loss, &psnr})
        std::erase_if(*curve, [&](const auto& point) {
            return point.first != 1 && static_cast<std::uint64_t>(point.first) % interval != 0;
        });
}

} // namespace gsh::examples
