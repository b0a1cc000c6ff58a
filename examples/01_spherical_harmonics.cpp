// SPDX-License-Identifier: Apache-2.0
/// @file  Story 1: spherical harmonics learn the colour of a glossy point from all directions.
///
/// The colour of a Gaussian depends on the viewing direction. The story defines a glossy point with two lamps and fits
/// SH of degrees 1 to 4 to its colour by gradient descent, with dL_dsh. Then it finds the highlight of the fitted
/// colour by gradient ascent, with dL_ddir.
/// Writes 01_spherical_harmonics.png: truth | degree 1 | 2 | 3 | 4.
#include <gsh/image/image.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/sh.hpp>
#include <gsh/math/vec.hpp>

#include <story.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

using namespace gsh;
using Vec = vec3<double>;

namespace {

// 1. A glossy red point. Its colour is the sum of a constant and two lobes of different width, the reflections of two
//    lamps. `dir` is the direction from the camera to the point, so the camera is in the direction -dir.
const Vec warm_lobe = normalize(Vec(-0.6, 0.55, 0.58)), cold_lobe = normalize(Vec(0.8, -0.3, 0.5));

Vec glossy_point(const Vec& dir) {
    const double warm = std::max(0.0, dot(-dir, warm_lobe)), cold = std::max(0.0, dot(-dir, cold_lobe));
    return Vec(0.55, 0.16, 0.12) + std::pow(warm, 6) * Vec(0.40, 0.70, 0.65) + std::pow(cold, 3) * Vec(0.0, 0.15, 0.40);
}

// 2. Viewing directions on a spiral, which are distributed evenly over the sphere.
std::vector<Vec> spread_directions(int count) {
    std::vector<Vec> directions;
    for (int i = 0; i < count; ++i) {
        const double z = 1 - (2 * i + 1.0) / count, angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
        directions.push_back({std::sqrt(1 - z * z) * std::cos(angle), std::sqrt(1 - z * z) * std::sin(angle), z});
    }
    return directions;
}

// A fit: SH coefficients, and the colour that they give. As everywhere in gsh, SH encode the difference from mid-grey.
template <int Degree>
struct Fit {
    std::vector<Vec> sh = std::vector<Vec>(SHEval<Degree>::basis_count, Vec(0));
    double rms = 0, from_integral = 0;

    Vec operator()(const Vec& dir) const { return SHEval<Degree>::forward(sh.data(), dir) + Vec(0.5); }
};

template <int Degree>
Fit<Degree> fit(const std::vector<Vec>& directions) {
    Fit<Degree> result;
    const double n = static_cast<double>(directions.size());

    // 3. Gradient descent on L = mean |color - truth|²: forward, dL_dcolor, backward, a step against the gradient.
    //    The harmonics are orthonormal, so the curvature of the loss is 1/2π along every coefficient, and each step
    //    with a rate of 4 removes 64% of the error.
    for (int step = 0; step < 30; ++step) {
        std::vector<Vec> dL_dsh(result.sh.size(), Vec(0));
        double sum = 0;
        for (const Vec& dir : directions) {
            const Vec difference = result(dir) - glossy_point(dir), dL_dcolor = difference * (2 / n);
            Vec dL_ddir(0); // not used here: the directions are fixed; step 5 uses it
            SHEval<Degree>::backward(result.sh.data(), dir, dL_dcolor, dL_dsh.data(), dL_ddir);
            sum += dot(difference, difference);
        }
        for (std::size_t k = 0; k < result.sh.size(); ++k) result.sh[k] -= 4.0 * dL_dsh[k];
        result.rms = std::sqrt(sum / (3 * n));
    }

    // 4. For orthonormal functions the solution is also known directly: sh_k is the integral of (colour - grey) Y_k.
    std::vector<Vec> integral(result.sh.size(), Vec(0));
    for (const Vec& dir : directions) {
        Vec unused(0);
        const Vec share = (glossy_point(dir) - Vec(0.5)) * (4 * std::numbers::pi / n);
        SHEval<Degree>::backward(result.sh.data(), dir, share, integral.data(), unused); // adds Y_k * share
    }
    for (std::size_t k = 0; k < integral.size(); ++k)
        result.from_integral = std::max(result.from_integral, length(result.sh[k] - integral[k]));
    std::printf("degree %d: %2d coefficients, rms error %.4f, off the integral by %.1e\n", Degree,
                SHEval<Degree>::basis_count, result.rms, result.from_integral);
    return result;
}

// 5. The highlight, by gradient ascent of red, the main colour of the warm lamp, over the direction. The adjoint treats
//    x, y and z as independent; normalize_backward is the adjoint of the normalisation.
template <int Degree>
Vec brightest_side(const Fit<Degree>& fitted) {
    Vec dir(0, 0, -1); // the camera is in the direction +z
    for (int step = 0; step < 200; ++step) {
        std::vector<Vec> unused(fitted.sh.size(), Vec(0));
        Vec up_dir(0), up(0);
        SHEval<Degree>::backward(fitted.sh.data(), normalize(dir), {1, 0, 0}, unused.data(), up_dir);
        normalize_backward(dir, up_dir, up);
        dir = normalize(dir + 0.1 * up);
    }
    return -dir;
}

// 6. A picture of a ball. The colour at each spot is the colour of the point seen from the direction of that spot.
template <class Color>
Image<double> paint_ball(const Color& color) {
    constexpr int size = 160;
    Image<double> ball(3, size, size, 1.0);
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) {
            const double a = (x + 0.5) / size * 2.1 - 1.05, b = 1.05 - (y + 0.5) / size * 2.1;
            if (a * a + b * b > 1) continue;
            const Vec seen = color(-Vec(a, b, std::sqrt(1 - a * a - b * b)));
            for (int c = 0; c < 3; ++c) ball.at(c, y, x) = seen[c];
        }
    return ball;
}

void story(const std::filesystem::path& folder) {
    const std::vector<Vec> directions = spread_directions(4000);
    const auto one = fit<1>(directions);
    const auto two = fit<2>(directions);
    const auto three = fit<3>(directions);
    const auto four = fit<4>(directions);
    const double degrees = std::acos(std::min(1.0, dot(brightest_side(four), warm_lobe))) * 180 / std::numbers::pi;
    std::printf("the highlight of the fit is %.1f degrees from the lamp's reflection\n", degrees);

    const auto truth = paint_ball(glossy_point), ball1 = paint_ball(one), ball2 = paint_ball(two),
               ball3 = paint_ball(three), ball4 = paint_ball(four);
    const auto row = examples::beside<double>({&truth, &ball1, &ball2, &ball3, &ball4});
    write_png(folder / "01_spherical_harmonics.png", row);

    examples::claim(one.rms > two.rms && two.rms > three.rms && three.rms > four.rms, "a higher degree fits better");
    examples::claim(four.rms < 0.02, "the rms error of degree 4 is below 0.02");
    examples::claim(four.from_integral < 1e-3, "gradient descent converges to the coefficients of the integral");
    examples::claim(degrees < 3, "gradient ascent along dL_ddir ends at the highlight");
}

} // namespace

int main(int argc, char** argv) {
    return examples::tell(argc, argv, story);
}
