// SPDX-License-Identifier: Apache-2.0
/// @file  Story 9: an application renders with gsh on its own CUDA stream, in its own memory and its own graph.
///
/// The application moves 10,000 Gaussians of a flag with a kernel of its own. gsh rasterizes them straight from the
/// application's memory into the application's picture, and gives the gradient with respect to each position. All of a
/// frame is captured as one CUDA graph, which the application launches. Writes 09_on_your_stream.png: three frames.
/// Needs nvcc and a GPU.
#include <gsh/camera/pinhole.hpp>
#include <gsh/cuda.cuh>
#include <gsh/image/image.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/render/rasterizer.hpp>

#include <story.hpp>

#include <cuda_runtime.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <vector>

using namespace gsh;
using Vec = vec3<float>;

namespace {

// 1. The application's own kernels.
constexpr int columns = 125, rows = 80, width = 240, height = 180;
constexpr std::size_t flag_size = std::size_t(columns) * rows, value_count = std::size_t(3) * width * height;

/// One thread per Gaussian: a flag that waves, 1.6 m wide. `frame` is in device memory, because a graph repeats its
/// arguments.
__global__ void wave(Vec* means, sym3<float>* covariances, float* opacities, Vec* colors, const std::uint32_t* frame) {
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= flag_size) return;
    const float u = static_cast<float>(i % columns) / columns, v = static_cast<float>(i / columns) / rows;
    const float phase = 9 * u + 2 * v - 0.7f * static_cast<float>(*frame), swing = 0.12f * u;
    means[i] = {1.6f * (u - 0.5f), v - 0.5f, swing * std::sin(phase)};
    const float size = 0.6f * 1.6f / columns;
    covariances[i] = {size * size, 0, 0, size * size, 0, size * size};
    opacities[i] = 0.95f;
    const float light = 0.75f + 0.25f * std::cos(phase);
    const bool cross = (u > 0.30f && u < 0.42f) || (v > 0.42f && v < 0.58f);
    colors[i] = (cross ? Vec(0.96f, 0.94f, 0.90f) : Vec(0.10f, 0.35f, 0.55f)) * light;
}
/// What the application would like to see brighter: the gradient of the sum of the left half's values.
__global__ void prefer_left(float* dL_dcolor) {
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < value_count) dL_dcolor[i] = i % width < width / 2 ? 1.0f : 0.0f;
}
__global__ void count_frame(std::uint32_t* frame) {
    *frame += 1;
}

/// Launches a kernel of the application, `count` threads. Code for nvcc alone writes kernel<<<…>>>(…).
template <class... Parameters, class... Arguments>
void launch(cudaStream_t stream, std::size_t count, void (*kernel)(Parameters...), const Arguments&... arguments) {
    cudaLaunchConfig_t config{};
    config.gridDim = dim3(static_cast<unsigned>((count + 255) / 256));
    config.blockDim = dim3(count < 256 ? static_cast<unsigned>(count) : 256u);
    config.stream = stream;
    cuda::check(cudaLaunchKernelEx(&config, kernel, static_cast<Parameters>(arguments)...), "launch");
}

/// The application's own memory.
template <class T>
struct Memory {
    T* data = nullptr;
    std::size_t size;
    explicit Memory(std::size_t count) : size(count) {
        cuda::check(cudaMalloc(&data, count * sizeof(T)), "cudaMalloc");
    }
    Memory(const Memory&) = delete;
    ~Memory() { (void)cudaFree(data); }
    operator Span<T>() const { return {data, size}; }       // NOLINT: gsh takes spans
    operator Span<const T>() const { return {data, size}; } // NOLINT
    [[nodiscard]] std::vector<T> read(cudaStream_t stream) const {
        std::vector<T> host(size);
        cuda::check(cudaMemcpyAsync(host.data(), data, size * sizeof(T), cudaMemcpyDeviceToHost, stream), "read");
        cuda::check(cudaStreamSynchronize(stream), "read");
        return host;
    }
};

void story(const std::filesystem::path& folder) {
    if (!cuda::Device::available()) {
        std::printf("no GPU answers; there is nothing to show\n");
        return;
    }

    // 2. The application's stream and memory. gsh owns neither.
    cudaStream_t stream = nullptr;
    cuda::check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking), "stream");
    Memory<Vec> means(flag_size), colors(flag_size), dL_dmeans(flag_size);
    Memory<sym3<float>> covariances(flag_size);
    Memory<float> opacities(flag_size), picture(value_count), dL_dpicture(value_count);
    Memory<std::uint32_t> frame(1);

    // 3. A device on that stream. Its work comes after what the application has queued, and before what follows.
    cuda::Device device(stream);
    device.fill(Span<std::uint32_t>(frame), 0u);
    Rasterizer<cuda::Device> rasterizer(device);
    Rasterizer<cuda::Device>::Cache cache;
    Camera<float> camera;
    camera.t = {0, 0, 1.7f};
    camera.fx = camera.fy = 225;
    camera.cx = 0.5f * width, camera.cy = 0.5f * height;
    camera.width = width, camera.height = height;
    const Background<float> background{.color = Vec(0.93f, 0.94f, 0.96f)};
    const SplatView<const float> splats{means, covariances, opacities, colors};

    // 4. A frame: the application's kernel, gsh's forward pass, the application's kernel, gsh's adjoint.
    const auto draw = [&] {
        launch(stream, flag_size, wave, means.data, covariances.data, opacities.data, colors.data, frame.data);
        rasterizer.forward(camera, splats, background, {.color = ImageView<float>{picture, 3, height, width}}, cache);
        launch(stream, value_count, prefer_left, dL_dpicture.data);
        device.fill(Span<Vec>(dL_dmeans), Vec(0));
        rasterizer.backward(camera, splats, background, {.color = ImageView<float>{dL_dpicture, 3, height, width}},
                            cache, {dL_dmeans, {}, {}, {}});
        launch(stream, 1, count_frame, frame.data);
    };

    // 5. Once directly: buffers grow, and errors in the input would be told here.
    draw();
    const std::vector<float> first = picture.read(stream);
    const std::vector<Vec> first_gradient = dL_dmeans.read(stream);

    // 6. Then as the application's own graph.
    cudaGraph_t graph = nullptr;
    cudaGraphExec_t executable = nullptr;
    cuda::check(cudaStreamBeginCapture(stream, cudaStreamCaptureModeGlobal), "capture");
    draw();
    cuda::check(cudaStreamEndCapture(stream, &graph), "capture");
    cuda::check(cudaGraphInstantiate(&executable, graph, 0), "capture");
    device.fill(Span<std::uint32_t>(frame), 0u);
    std::vector<Image<float>> shown;
    for (int number = 0; number < 7; ++number) {
        cuda::check(cudaGraphLaunch(executable, stream), "launch");
        if (number % 3 != 0) continue;
        shown.emplace_back(3, height, width);
        shown.back().data = picture.read(stream);
        if (number == 0) {
            examples::claim(shown[0].data == first, "the graph draws the same bits as direct calls");
            const std::vector<Vec> gradient = dL_dmeans.read(stream);
            bool same = true;
            for (std::size_t i = 0; i < flag_size; ++i) same = same && gradient[i] == first_gradient[i];
            examples::claim(same, "and computes the same gradient, in the application's memory");
        }
    }

    // 7. In a graph nothing waits for the device. Afterwards, check tells what forward would have thrown.
    rasterizer.check(cache);
    examples::claim(shown[1].data != shown[0].data, "the flag waves, without new arguments");

    // 8. Another stream of the application waits for the picture by an event.
    cudaStream_t other = nullptr;
    cudaEvent_t drawn = nullptr;
    cuda::check(cudaStreamCreateWithFlags(&other, cudaStreamNonBlocking), "stream");
    cuda::check(cudaEventCreateWithFlags(&drawn, cudaEventDisableTiming), "event");
    device.record(drawn);
    cuda::check(cudaStreamWaitEvent(other, drawn, 0), "event");
    examples::claim(picture.read(other) == shown.back().data, "another stream sees the finished picture");

    write_png(folder / "09_on_your_stream.png", examples::beside<float>({&shown[0], &shown[1], &shown[2]}));
    (void)cudaEventDestroy(drawn);
    (void)cudaStreamDestroy(other);
    (void)cudaGraphExecDestroy(executable);
    (void)cudaGraphDestroy(graph);
    device.synchronize();
    (void)cudaStreamDestroy(stream);
}

} // namespace

int main(int argc, char** argv) {
    return gsh::examples::tell(argc, argv, story);
}
