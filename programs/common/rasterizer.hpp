// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer of the programs: rasterizer.cpp compiles its passes on cpu::Threads once for all of them.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

namespace gsh::cpu {

extern template void composite_forward(Threads&, const Deferred<Camera<float>>&, const SplatView<const float>&,
                                       const Background<float>&, const RasterParams<float>&, const RenderTarget<float>&,
                                       RasterCache<Threads, float>&);
extern template void composite_backward(Threads&, const Deferred<Camera<float>>&, const SplatView<const float>&,
                                        const Background<float>&, const RasterParams<float>&,
                                        const RenderGradient<float>&, RasterCache<Threads, float>&,
                                        const SplatView<float>&, Span<CameraGradient<float>>,
                                        const BackgroundGradient<float>&);

} // namespace gsh::cpu
