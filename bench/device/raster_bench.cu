// SPDX-License-Identifier: Apache-2.0
/// @file  Bench of rasterizing on a GPU: a person, many transparent layers, a room, or a .ply file from given cameras,
///        as splats (raster/) and from stored Gaussians with their harmonics (cloud/).
///        --write FOLDER writes the room as such a file, for other programs: room.ply and cameras.json.
#include "load.hpp"
#include "measure.cuh"

#include "../render/capsule_load.hpp"

#include <gsh/camera/pinhole.hpp>
#include <gsh/cuda.cuh>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/render/rasterizer.hpp>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::bench {
namespace {

using cuda::Device;

/// Splats on the device, their gradients, and an image.
struct Scene {
    Device& device;
    cuda::Buffer<vec3<float>> means, colors, dL_dmeans, dL_dcolors;
    cuda::Buffer<sym3<float>> covariances, dL_dcovariances;
    cuda::Buffer<float> opacities, dL_dopacities, color, dL_dcolor;
    std::vector<Camera<float>> cameras;
    Rasterizer<Device> rasterizer;
    Rasterizer<Device>::Cache cache;

    Scene(Device& on, const SplatView<const float>& splats, std::vector<Camera<float>> views)
        : device(on), cameras(std::move(views)), rasterizer(on) {
        const auto copy = [&]<class T>(Span<const T> from, cuda::Buffer<T>& to, cuda::Buffer<T>& gradient) {
            assign(device, from, to), gradient.resize(from.size());
        };
        copy(splats.means, means, dL_dmeans), copy(splats.covariances, covariances, dL_dcovariances);
        copy(splats.opacities, opacities, dL_dopacities), copy(splats.colors, colors, dL_dcolors);
        const auto pixels = static_cast<std::size_t>(cameras[0].width) * static_cast<std::size_t>(cameras[0].height);
        std::vector<float> weights(3 * pixels);
        for (std::size_t i = 0; i < weights.size(); ++i) weights[i] = 0.5f * std::sin(0.05f * static_cast<float>(i));
        color.resize(weights.size());
        dL_dcolor = uploaded(device, weights);
    }
    [[nodiscard]] SplatView<const float> splats() const { return {means, covariances, opacities, colors}; }
    template <class Buffer>
    [[nodiscard]] ImageView<float> image(Buffer& buffer) const {
        return {Span<float>(buffer), 3, cameras[0].height, cameras[0].width};
    }
    [[nodiscard]] const Camera<float>& camera(int k) const {
        return cameras[static_cast<std::size_t>(k) % cameras.size()];
    }
    void forward(int k) {
        rasterizer.forward(camera(k), splats(), {.color = vec3<float>(1)}, {.color = image(color)}, cache);
    }
    void backward(int k) {
        const SplatView<float> gradients{dL_dmeans, dL_dcovariances, dL_dopacities, dL_dcolors};
        fill_zero(device, gradients);
        rasterizer.backward(camera(k), splats(), {.color = vec3<float>(1)}, {.color = image(dL_dcolor)}, cache,
                            gradients);
    }
};

/// Both passes read and write what there is of a splat; the forward pass writes an image.
void measure(Bench& bench, const std::string& name, const SplatView<const float>& splats,
             const std::vector<Camera<float>>& cameras) {
    const double n = static_cast<double>(splats.means.size()), splat = 13 * sizeof(float);
    const double image = 3.0 * sizeof(float) * cameras[0].width * cameras[0].height;
    if (bench.wants(name + "/forward")) {
        Scene scene(bench.device(), splats, cameras);
        bench.measure(name + "/forward", {n * splat + image}, [&](int k) { scene.forward(k); });
    }
    if (bench.wants(name + "/forward+backward")) {
        Scene scene(bench.device(), splats, cameras);
        bench.measure(name + "/forward+backward", {3 * n * splat + 2 * image}, [&](int k) {
            scene.forward(k);
            scene.backward(k);
        });
    }
}

/// A scene whose splats are made anew for each view: covariances, and colours from harmonics of the file's degree.
template <int Degree>
struct Cloud {
    Scene scene;
    StaticSplats<Device, Degree> splats;
    StaticSplatsCache<Device> cache;
    Gaussians<Device, float> gaussians, dL_dgaussians;

    Cloud(Device& device, const CloudLoad& load, const std::vector<Camera<float>>& cameras)
        : scene(device, load.view(), cameras), splats(device) {
        upload(device, load.cloud, gaussians);
        dL_dgaussians.resize(load.cloud.size(), Degree);
    }
    void forward(int k) {
        const SplatView<float> made{scene.means, scene.covariances, scene.opacities, scene.colors};
        splats.forward(std::as_const(gaussians).view(), scene.camera(k).center(), made, cache);
        scene.forward(k);
    }
    void backward(int k) {
        scene.backward(k);
        const SplatView<const float> from{scene.dL_dmeans, scene.dL_dcovariances, scene.dL_dopacities,
                                          scene.dL_dcolors};
        fill_zero(scene.device, dL_dgaussians.view());
        splats.backward(std::as_const(gaussians).view(), scene.camera(k).center(), from, cache, dL_dgaussians.view());
    }
};

/// The same passes from stored Gaussians, whose numbers are read, and in the backward pass read again and their
/// gradients written.
template <int Degree>
void measure_cloud(Bench& bench, const std::string& name, const CloudLoad& load,
                   const std::vector<Camera<float>>& cameras) {
    const double gaussian = (3 + 4 + 3 + 1 + 3 * sh_basis_count(Degree)) * sizeof(float);
    const double n = static_cast<double>(load.cloud.size());
    const double image = 3.0 * sizeof(float) * cameras[0].width * cameras[0].height;
    if (bench.wants(name + "/forward")) {
        Cloud<Degree> cloud(bench.device(), load, cameras);
        bench.measure(name + "/forward", {n * gaussian + image}, [&](int k) { cloud.forward(k); });
    }
    if (bench.wants(name + "/forward+backward")) {
        Cloud<Degree> cloud(bench.device(), load, cameras);
        bench.measure(name + "/forward+backward", {3 * n * gaussian + 2 * image}, [&](int k) {
            cloud.forward(k);
            cloud.backward(k);
        });
    }
}

std::vector<Camera<float>> ring(int size) {
    std::vector<Camera<float>> cameras;
    for (int view = 0; view < 8; ++view) cameras.push_back(make_camera(size, view));
    return cameras;
}
/// Views from the middle of a room.
std::vector<Camera<float>> panorama(int size) {
    std::vector<Camera<float>> cameras = ring(size);
    for (Camera<float>& camera : cameras) {
        camera.t = vec3<float>(0);
        camera.fx = camera.fy = 0.6f * static_cast<float>(size);
    }
    return cameras;
}

void cases(Bench& bench) {
    const Arguments& options = bench.arguments();
    if (!options.ply.empty()) {
        const CloudLoad load = read_cloud_load(options.ply, options.cameras);
        for (const auto& [name, cameras] : load.cameras) {
            measure(bench, "raster/" + name, load.view(), cameras);
            with_sh_degree(load.cloud.sh_degree, [&, name = name, &cameras = cameras](auto degree) {
                measure_cloud<decltype(degree)::value>(bench, "cloud/" + name, load, cameras);
            });
        }
        return;
    }
    const std::size_t many = 12 * options.gaussians; // of a room
    if (!options.write.empty()) {
        std::filesystem::create_directories(options.write);
        write_cloud_load(options.write + "/room.ply", options.write + "/cameras.json", make_room(many).view(),
                         panorama(2 * options.size));
        return;
    }
    const CapsuleLoad person = make_person(options.gaussians), layers = make_layers(options.gaussians);
    for (const int size : {options.size, 2 * options.size}) {
        measure(bench, "raster/person/" + std::to_string(size), person.view(), ring(size));
        measure(bench, "raster/layers/" + std::to_string(size), layers.view(), ring(size));
    }
    const std::string room = "raster/room/" + std::to_string(2 * options.size);
    const bool shown = bench.wants(room + "/forward"), learned = bench.wants(room + "/forward+backward");
    if (shown || learned) measure(bench, room, make_room(many).view(), panorama(2 * options.size));
}

} // namespace
} // namespace gsh::bench

int main(int argc, char** argv) {
    return gsh::bench::run_cases(argc, argv, gsh::bench::cases);
}
