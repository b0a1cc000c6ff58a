// SPDX-License-Identifier: Apache-2.0
/// @file  LPIPS networks with weights that a script in any language can reproduce.
#pragma once

#include <gsh/loss/lpips_network.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace gsh::test {

/// Numbers in [-amplitude, amplitude) from integer arithmetic alone.
inline std::vector<float> noise(std::size_t count, std::uint32_t seed, double amplitude) {
    std::vector<float> values(count);
    for (std::size_t i = 0; i < count; ++i) {
        auto x = static_cast<std::uint32_t>(i * 2654435761u + std::uint64_t(seed) * 40503u);
        for (int round = 0; round < 2; ++round) {
            x ^= x >> 16;
            x *= 0x45d9f3bu;
        }
        x ^= x >> 16;
        values[i] = static_cast<float>(amplitude * (static_cast<double>(x) / 2147483648.0 - 1));
    }
    return values;
}

/// Fills a network's weights so that signals neither vanish nor explode; lins in [0, 1).
inline LpipsNetwork with_noise(LpipsNetwork network) {
    std::uint32_t seed = 0;
    std::size_t inputs = 3;
    network.convolutions.clear(), network.lins.clear();
    for (const LpipsStep& step : network.steps) {
        if (step.is_convolution()) {
            const std::size_t fan_in = inputs * static_cast<std::size_t>(step.kernel * step.kernel);
            inputs = static_cast<std::size_t>(step.channels);
            network.convolutions.push_back({noise(inputs * fan_in, seed, std::sqrt(6 / static_cast<double>(fan_in))),
                                            noise(inputs, seed + 1, 0.05)});
            seed += 2;
        }
        if (!step.compared) continue;
        auto lin = noise(inputs, 100 + static_cast<std::uint32_t>(network.lins.size()), 0.5);
        for (float& w : lin) w += 0.5f;
        network.lins.push_back(std::move(lin));
    }
    return network;
}

} // namespace gsh::test
