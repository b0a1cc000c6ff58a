// SPDX-License-Identifier: Apache-2.0
/// @file  Renders an avatar after 60 steps of training. The program is built for two instruction sets.
///
/// trained_picture write FILE     trains and writes the picture
/// trained_picture compare FILE   trains and compares; results of different instruction sets agree within a tolerance
///
/// Rounding depends on the registers' width (through the order of sums) and on fused multiply-adds. Training amplifies
/// these differences, so the pictures are compared by PSNR, not number by number.

#define DOCTEST_CONFIG_IMPLEMENT // shared test code needs doctest's implementation; main is below

#include <gsh/cpu.hpp>
#include <gsh/io/file/npy.hpp>

#include "support/small_training.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

int main(int argc, char** argv) try {
    using namespace gsh;
    const bool write = argc == 3 && std::strcmp(argv[1], "write") == 0;
    if (argc != 3 || (!write && std::strcmp(argv[1], "compare") != 0)) {
        std::fprintf(stderr, "usage: %s write|compare FILE.npy\n", argv[0]);
        return 2;
    }
    const test::SmallScene scene;
    test::SmallTraining<cpu::Threads> training(
        scene, cpu::Threads(2), 3,
        {.appearance = {.sh_rate = test::small_sh_rate}, .ao = AmbientOcclusion::time, .model = {.quat_rate = 0}});
    for (int step = 0; step < 60; ++step) training.trainer.step(step / 60.0);
    Image<float> picture;
    training.trainer.render(scene.photos[0], picture);
    if (write) {
        write_npy(argv[2], Span<const float>(picture.data), {picture.data.size()});
        return 0;
    }
    const std::vector<float> other = read_npy<float>(argv[2]).data;
    check_size("trained_picture", "the other picture", other.size(), picture.data.size());
    double squares = 0, largest = 0;
    for (std::size_t i = 0; i < other.size(); ++i) {
        const double d = std::abs(static_cast<double>(other[i]) - static_cast<double>(picture.data[i]));
        squares += d * d, largest = std::max(largest, d);
    }
    const double decibels = -10 * std::log10(squares / static_cast<double>(other.size()) + 1e-30);
    std::printf("after 60 steps the pictures agree to %.1f dB, the largest difference is %.2e\n", decibels, largest);
    return decibels > 80 ? 0 : 1;
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
