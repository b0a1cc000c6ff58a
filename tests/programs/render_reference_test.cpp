// SPDX-License-Identifier: Apache-2.0
/// Compares gsh-render on a standard 3DGS file with a plain evaluation in double precision. The activations and the
/// colour are computed here, the compositing in support/reference_rasterizer.hpp.
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/rasterizer.hpp>

#include "programs/process.hpp"
#include "support/gradient.hpp"
#include "support/reference_rasterizer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// A ball of Gaussians with random shapes and colours of degree 3, in the form of a file.
GaussianCloud<float> scene(std::size_t count) {
    test::Rng rng(5);
    GaussianCloud<float> cloud(count, 3);
    for (std::size_t i = 0; i < count; ++i) {
        cloud.means[i] = vec3<float>(rng.vec(-0.6, 0.6));
        const quat<double> q = rng.quat();
        cloud.quats[i] = {float(q.w), float(q.x), float(q.y), float(q.z)};
        cloud.log_scales[i] = vec3<float>(rng.vec(-5, -2.5));
        cloud.opacity_logits[i] = static_cast<float>(rng.uniform(-3, 3));
        for (std::size_t k = 0; k < 16; ++k) cloud.sh[16 * i + k] = vec3<float>(rng.vec() * (k == 0 ? 1.5 : 0.15));
    }
    return cloud;
}

/// Covariance, opacity and colour of each Gaussian, by the formulas of the format and without the library.
Splats<cpu::Serial, double> plain_splats(const GaussianCloud<float>& cloud, const vec3<double>& eye) {
    Splats<cpu::Serial, double> splats;
    splats.resize(cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        const quat<float>& f = cloud.quats[i];
        const double n = std::sqrt(double(f.w) * f.w + double(f.x) * f.x + double(f.y) * f.y + double(f.z) * f.z);
        const double w = f.w / n, x = f.x / n, y = f.y / n, z = f.z / n;
        const double R[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
        double sigma[3][3] = {};
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
                for (int k = 0; k < 3; ++k) sigma[a][b] += R[a][k] * R[b][k] * std::exp(2.0 * cloud.log_scales[i][k]);
        splats.covariances[i] = {sigma[0][0], sigma[0][1], sigma[0][2], sigma[1][1], sigma[1][2], sigma[2][2]};
        splats.means[i] = vec3<double>(cloud.means[i]);
        splats.opacities[i] = 1 / (1 + std::exp(-double(cloud.opacity_logits[i])));

        const vec3<double> offset = splats.means[i] - eye;
        const double length = std::sqrt(offset.x * offset.x + offset.y * offset.y + offset.z * offset.z);
        const double dx = offset.x / length, dy = offset.y / length, dz = offset.z / length;
        const double xx = dx * dx, yy = dy * dy, zz = dz * dz;
        const double Y[16] = {0.28209479177387814,
                              -0.4886025119029199 * dy,
                              0.4886025119029199 * dz,
                              -0.4886025119029199 * dx,
                              1.0925484305920792 * dx * dy,
                              -1.0925484305920792 * dy * dz,
                              0.31539156525252005 * (2 * zz - xx - yy),
                              -1.0925484305920792 * dx * dz,
                              0.5462742152960396 * (xx - yy),
                              -0.5900435899266435 * dy * (3 * xx - yy),
                              2.890611442640554 * dx * dy * dz,
                              -0.4570457994644658 * dy * (4 * zz - xx - yy),
                              0.3731763325901154 * dz * (2 * zz - 3 * xx - 3 * yy),
                              -0.4570457994644658 * dx * (4 * zz - xx - yy),
                              1.445305721320277 * dz * (xx - yy),
                              -0.5900435899266435 * dx * (xx - 3 * yy)};
        for (int c = 0; c < 3; ++c) {
            double value = 0.5;
            for (std::size_t k = 0; k < 16; ++k) value += Y[k] * cloud.sh[16 * i + k][c];
            splats.colors[i][c] = std::max(value, 0.0);
        }
    }
    return splats;
}

} // namespace

TEST_CASE("gsh-render draws a standard PLY as its format says") {
    const test::Temporary folder;
    const GaussianCloud<float> cloud = scene(600);
    write_gaussian_ply(folder / "scene.ply", cloud);
    NamedCamera named;
    named.camera = look_at<double>({0.4, 0.5, 2.2}, {0.05, 0, 0}, {0, 1, 0}, 0.6, 150, 130);
    named.camera.cx += 6.5; // the principal point is not the middle
    write_camera(folder / "camera.json", named);
    test::check_done(
        test::run({"gsh-render", folder / "scene.ply", "--camera", folder / "camera.json", "--out",
                   folder / "image.png", "--npy", folder / "image.npy", "--background", "0.2", "0.4", "0.6"}));
    const NpyArray<float> image = read_npy<float>(folder / "image.npy");
    REQUIRE(image.shape == Shape{130, 150, 3});

    const Camera<double> camera = read_camera(folder / "camera.json").camera;
    const auto splats = plain_splats(cloud, camera.center());
    const vec3<double> background(0.2, 0.4, 0.6);
    const test::Reference reference = test::reference_rasterize(camera, splats.view(), background);

    // The library instantiated for double, from the same file.
    cpu::Serial backend;
    GaussianCloud<double> wide(cloud.size(), 3);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        wide.means[i] = vec3<double>(cloud.means[i]);
        wide.quats[i] = {cloud.quats[i].w, cloud.quats[i].x, cloud.quats[i].y, cloud.quats[i].z};
        wide.log_scales[i] = vec3<double>(cloud.log_scales[i]);
        wide.opacity_logits[i] = cloud.opacity_logits[i];
    }
    for (std::size_t k = 0; k < cloud.sh.size(); ++k) wide.sh[k] = vec3<double>(cloud.sh[k]);
    Splats<cpu::Serial, double> own;
    own.resize(cloud.size());
    StaticSplats<cpu::Serial, 3, double>::Cache splats_cache;
    StaticSplats<cpu::Serial, 3, double>(backend).forward(std::as_const(wide).view(), camera.center(), own.view(),
                                                          splats_cache);
    Image<double> drawn(3, 130, 150);
    Rasterizer<cpu::Serial, double>::Cache cache;
    Rasterizer<cpu::Serial, double>(backend).forward(camera, std::as_const(own).view(), {.color = background},
                                                     {.color = drawn.view()}, cache);

    std::size_t outside = 0;
    for (int y = 0; y < 130; ++y)
        for (int x = 0; x < 150; ++x)
            for (int c = 0; c < 3; ++c) {
                const double expected = reference.color.at(c, y, x);
                CHECK(std::abs(drawn.at(c, y, x) - expected) < 1e-9);
                const std::size_t at =
                    3 * (150 * static_cast<std::size_t>(y) + static_cast<std::size_t>(x)) + static_cast<std::size_t>(c);
                if (std::abs(image[at] - expected) <= 1e-3) continue;
                ++outside;
                INFO("pixel " << x << ", " << y);
                CHECK((reference.cut_margin.at(0, y, x) < 1e-4 || reference.depth_gap.at(0, y, x) < 1e-6));
            }
    CHECK(outside <= 3 * 130 * 150 / 1000);
}
