// SPDX-License-Identifier: Apache-2.0
/// @file  A user's program that draws Gaussians and prints each pixel exactly, with headers of gsh/ or with gsh.hpp.
#ifdef GSH_IN_ONE_HEADER
#include "gsh.hpp"
#else
#include <gsh/backend/threads.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/image/image.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>
#endif

#include <cmath>
#include <cstddef>
#include <cstdio>

using namespace gsh;

int main() {
    GaussianCloud<float> cloud(40, 0);
    for (std::size_t i = 0; i < cloud.size(); ++i) { // a spiral
        const float a = 0.4f * static_cast<float>(i);
        cloud.means[i] = {std::cos(a), std::sin(a), 0.05f * a};
        cloud.log_scales[i] = {-2.0f, -2.5f, -3.0f};
        cloud.opacity_logits[i] = logit(0.8f);
        cloud.sh[i] = sh_of_color(vec3<float>(0.5f + 0.5f * std::cos(a), 0.4f, 0.5f));
    }
    cpu::Threads backend(2);
    Gaussians<cpu::Threads, float> gaussians;
    Splats<cpu::Threads, float> splats;
    upload(backend, cloud, gaussians);
    splats.resize(cloud.size());
    const auto camera = look_at<float>({0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.9f, 48, 48);
    StaticSplatsCache<cpu::Threads> posing;
    StaticSplats<cpu::Threads, 0>(backend).forward(gaussians.view(), camera.center(), splats.view(), posing);
    Image<float> image(3, 48, 48);
    Rasterizer<cpu::Threads>::Cache drawing;
    Rasterizer<cpu::Threads>(backend).forward(camera, splats.view(), {.color = vec3<float>(1)},
                                              {.color = image.view()}, drawing);
    bool drawn = false;
    for (const float value : image.data) {
        std::printf("%a\n", static_cast<double>(value));
        drawn = drawn || value < 0.5f;
    }
    return drawn ? 0 : 1;
}
