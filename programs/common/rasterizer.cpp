// SPDX-License-Identifier: Apache-2.0
#include "common/rasterizer.hpp"

namespace gsh::cpu {

template void composite_forward(Threads&, const Deferred<Camera<float>>&, const SplatView<const float>&,
                                const Background<float>&, const RasterParams<float>&, const RenderTarget<float>&,
                                RasterCache<Threads, float>&);
template void composite_backward(Threads&, const Deferred<Camera<float>>&, const SplatView<const float>&,
                                 const Background<float>&, const RasterParams<float>&, const RenderGradient<float>&,
                                 RasterCache<Threads, float>&, const SplatView<float>&, Span<CameraGradient<float>>,
                                 const BackgroundGradient<float>&);

} // namespace gsh::cpu
