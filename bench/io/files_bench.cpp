// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of reading and writing the files of a training run: images, arrays, Gaussians.
#include <gsh/core/rng.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/splat/ply.hpp>

#include <benchmark/benchmark.h>

#include <filesystem>
#include <string>
#include <vector>

namespace gsh {
namespace {

constexpr std::size_t N = 170000;

std::filesystem::path scratch(const char* name) { return std::filesystem::temp_directory_path() / name; }

void count(benchmark::State& state, std::size_t items, std::size_t bytes) {
    state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(items));
    state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(bytes));
}

/// A picture like that of a person: a tenth of 540 x 540 pixels is textured, the rest is transparent.
PixelImage picture() {
    PixelImage image(4, 540, 540);
    Rng rng(1);
    for (int y = 60; y < 480; ++y)
        for (int x = 235; x < 305; ++x) {
            for (int c = 0; c < 3; ++c)
                image.pixel(y, x)[c] = static_cast<std::uint8_t>(120 + (x + y) / 10 + rng.below(12));
            image.pixel(y, x)[3] = 255;
        }
    return image;
}

void png_read(benchmark::State& state) {
    const auto path = scratch("gsh_bench.png");
    write_png(path, picture());
    for (auto _ : state) benchmark::DoNotOptimize(read_image(path).data.data());
    count(state, 540 * 540, 4 * 540 * 540);
    std::filesystem::remove(path);
}
void png_encode(benchmark::State& state) {
    const PixelImage image = picture();
    for (auto _ : state) benchmark::DoNotOptimize(encode_png(image).data());
    count(state, 540 * 540, 4 * 540 * 540);
}

/// 64 MiB of parameters, as in a checkpoint.
constexpr std::size_t parameters = std::size_t(1) << 24;
void write_parameters(const std::filesystem::path& path, const std::vector<float>& values) {
    ArchiveWriter file(path, "bench", 1);
    file.add("values", values);
    file.commit();
}
void archive_write(benchmark::State& state) {
    const auto path = scratch("gsh_bench.gsh");
    const std::vector<float> values(parameters, 0.5f);
    for (auto _ : state) write_parameters(path, values);
    count(state, parameters, 4 * parameters);
    std::filesystem::remove(path);
}
void archive_read(benchmark::State& state) {
    const auto path = scratch("gsh_bench.gsh");
    write_parameters(path, std::vector<float>(parameters, 0.5f));
    for (auto _ : state) benchmark::DoNotOptimize(ArchiveReader(path, "bench", 1).read<float>("values").data.data());
    count(state, parameters, 4 * parameters);
    std::filesystem::remove(path);
}

GaussianCloud<float> cloud() {
    GaussianCloud<float> result(N, 3);
    for (std::size_t i = 0; i < N; ++i) result.means[i] = vec3<float>(static_cast<float>(i), 0, 1);
    return result;
}
void ply_write(benchmark::State& state) {
    const auto path = scratch("gsh_bench.ply");
    const auto gaussians = cloud();
    for (auto _ : state) write_gaussian_ply(path, gaussians);
    count(state, N, N * 62 * 4);
    std::filesystem::remove(path);
}
void ply_read(benchmark::State& state) {
    const auto path = scratch("gsh_bench.ply");
    write_gaussian_ply(path, cloud());
    for (auto _ : state) benchmark::DoNotOptimize(read_gaussian_ply(path).means.data());
    count(state, N, N * 62 * 4);
    std::filesystem::remove(path);
}

BENCHMARK(png_read)->Unit(benchmark::kMillisecond);
BENCHMARK(png_encode)->Unit(benchmark::kMillisecond);
BENCHMARK(archive_write)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(archive_read)->Unit(benchmark::kMillisecond);
BENCHMARK(ply_write)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK(ply_read)->Unit(benchmark::kMillisecond);

} // namespace
} // namespace gsh
