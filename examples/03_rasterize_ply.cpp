// SPDX-License-Identifier: Apache-2.0
/// @file  Story 3: a scene is written to a standard 3DGS .ply file, read again, and rendered from two sides.
///
/// The scene has two translucent balls inside a ring of beads. The file has the layout of other viewers and trainers,
/// so the same code renders their scenes. The middle pixel and the radius of the silhouette are compared with values
/// that are computed by hand. Writes 03_rasterize_ply.ply and 03_rasterize_ply.png: front | behind.
#include <gsh/camera/pinhole.hpp>
#include <gsh/cpu.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/gaussian/shade.hpp>
#include <gsh/gaussian/static_gaussian.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/math/activation.hpp>
#include <gsh/render/rasterizer.hpp>

#include <story.hpp>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>

using namespace gsh;
using Vec = vec3<float>;

namespace {

using Backend = cpu::Threads;

// 1. The scene.
const Vec gold(0.95f, 0.75f, 0.20f), teal(0.10f, 0.60f, 0.65f), background(0.93f, 0.94f, 0.96f);
constexpr float front_z = 0.35f, back_z = -0.35f, ball_scale = 0.13f, front_opacity = 0.6f, back_opacity = 0.9f;

GaussianCloud<float> make_scene() {
    constexpr std::size_t beads = 64;
    GaussianCloud<float> cloud(2 + beads, 1);
    const auto ball = [&](std::size_t i, float z, float opacity, const Vec& color) {
        cloud.means[i] = {0, 0, z};
        cloud.log_scales[i] = Vec(std::log(ball_scale));
        cloud.opacity_logits[i] = logit(opacity);
        cloud.sh[4 * i] = sh_of_color(color);
    };
    ball(0, back_z, back_opacity, teal);
    ball(1, front_z, front_opacity, gold);
    for (std::size_t i = 2; i < cloud.size(); ++i) { // a wavy ring; each bead is stretched along the ring
        const float a = 2 * std::numbers::pi_v<float> * static_cast<float>(i - 2) / beads;
        cloud.means[i] = {1.2f * std::cos(a), 1.2f * std::sin(a), 0.12f * std::sin(6 * a)};
        cloud.quats[i] = {std::cos(0.5f * a), 0, 0, std::sin(0.5f * a)}; // rotates x outwards, y along the ring
        cloud.log_scales[i] = {std::log(0.03f), std::log(0.045f), std::log(0.03f)};
        cloud.opacity_logits[i] = logit(0.95f);
        cloud.sh[4 * i] = sh_of_color(Vec(0.5f + 0.3f * std::cos(a), 0.35f, 0.5f + 0.3f * std::sin(a)));
        cloud.sh[4 * i + 2] = {0.6f, 0.2f, 0.2f}; // times 0.49 z of the viewing direction: redder from behind
    }
    return cloud;
}

// 2. Renders any scene from any camera. with_sh_degree turns the SH degree of the file into a template argument.
Image<float> render(Backend& backend, const GaussianCloud<float>& cloud, const Camera<float>& camera,
                    Image<float>& alpha) {
    Gaussians<Backend, float> gaussians;
    Splats<Backend, float> splats;
    upload(backend, cloud, gaussians);
    splats.resize(cloud.size());
    with_sh_degree(cloud.sh_degree, [&](auto degree) {
        StaticSplatsCache<Backend> cache;
        StaticSplats<Backend, degree()>(backend).forward(gaussians.view(), camera.center(), splats.view(), cache);
    });
    const Rasterizer<Backend> rasterizer(backend);
    Rasterizer<Backend>::Cache cache;
    Image<float> color(3, camera.height, camera.width);
    alpha = Image<float>(1, camera.height, camera.width);
    rasterizer.forward(camera, splats.view(), {.color = background}, {.color = color.view(), .alpha = alpha.view()},
                       cache);
    return color;
}

Vec pixel(const Image<float>& image, int y, int x) {
    return {image.at(0, y, x), image.at(1, y, x), image.at(2, y, x)};
}

void story(const std::filesystem::path& folder) {
    // 3. Write and read. The file is padded to degree 3, because many viewers support only that degree.
    const GaussianCloud<float> scene = make_scene();
    write_gaussian_ply(folder / "03_rasterize_ply.ply", scene);
    const GaussianCloud<float> loaded = read_gaussian_ply(folder / "03_rasterize_ply.ply");
    std::printf("%zu Gaussians of degree %d were read\n", loaded.size(), loaded.sh_degree);

    // 4. Two cameras. One is in front of the balls on the z axis. The other one is behind, to the side, and looks at
    //    the golden ball. With an odd number of pixels, the middle of the image is the centre of a pixel.
    constexpr int size = 301, middle = size / 2;
    constexpr float distance = 4;
    const Vec up(0, 1, 0);
    const Camera<float> front = look_at(Vec(0, 0, distance), Vec(0), up, 0.75f, size, size);
    const Camera<float> behind = look_at(Vec(2.8f, 1.2f, -2.4f), Vec(0, 0, front_z), up, 0.75f, size, size);
    Backend backend;
    Image<float> front_alpha, behind_alpha;
    const Image<float> from_front = render(backend, loaded, front, front_alpha);
    const Image<float> from_behind = render(backend, loaded, behind, behind_alpha);
    write_png(folder / "03_rasterize_ply.png", examples::beside<float>({&from_front, &from_behind}));

    // 5. The middle pixel by hand: at the centre of a ball, alpha is its opacity. From the front, gold is over teal
    //    over the background. The view from behind passes beside the teal ball, so gold is over the background.
    const Vec over_teal = back_opacity * teal + (1 - back_opacity) * background;
    const Vec expect_front = front_opacity * gold + (1 - front_opacity) * over_teal;
    const Vec expect_behind = front_opacity * gold + (1 - front_opacity) * background;
    const Vec found_front = pixel(from_front, middle, middle), found_behind = pixel(from_behind, middle, middle);
    std::printf("middle pixel in front: %.4f %.4f %.4f, by hand %.4f %.4f %.4f\n", found_front.x, found_front.y,
                found_front.z, expect_front.x, expect_front.y, expect_front.z);

    // 6. The silhouette by hand: a ball on the axis is a round splat of variance (f s / z)² + 0.3 pixels²; the 0.3 is
    //    the rasterizer's low-pass. The splat ends where opacity exp(-r² / 2 variance) falls below 1/255. The larger
    //    radius counts.
    const auto radius = [&](float z, float opacity) {
        const float blur = front.fx * ball_scale / (distance - z);
        return std::sqrt(2 * (blur * blur + 0.3f) * std::log(255 * opacity));
    };
    const int reach = static_cast<int>(std::max(radius(front_z, front_opacity), radius(back_z, back_opacity)));
    int covered = 0; // pixels to the right of the middle one
    while (front_alpha.at(0, middle, middle + covered + 1) > 0) ++covered;
    std::printf("the balls end %d pixels from the middle, by hand %d\n", covered, reach);

    examples::claim(loaded.means == scene.means && loaded.log_scales == scene.log_scales,
                    "means and scales are bit-identical after reading");
    examples::claim(length(found_front - expect_front) < 1e-4f, "the middle pixel is gold over teal over background");
    examples::claim(length(found_behind - expect_behind) < 1e-4f, "from behind, it is gold over background");
    examples::claim(covered == reach, "the silhouette ends where alpha falls below 1/255");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
