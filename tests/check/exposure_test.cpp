// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/check/capture_check.hpp>
#include <gsh/check/exposure.hpp>
#include <gsh/image/color.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Points of a surface under light from one side, in images of two cameras with exposures of their own.
struct LitPoints {
    std::vector<std::size_t> camera_of{0, 0, 0, 0, 0, 1, 1, 1, 1};
    std::vector<vec3<double>> truth;
    std::vector<std::vector<SeenColor>> points;

    explicit LitPoints(double outliers = 0) {
        test::Rng rng(11);
        truth = rng.vecs(camera_of.size(), -0.3, 0.3);
        for (const std::size_t camera : {0, 1}) { // 0 in the mean of a camera
            vec3<double> sum(0);
            double count = 0;
            for (std::size_t i = 0; i < truth.size(); ++i)
                if (camera_of[i] == camera) sum += truth[i], count += 1;
            for (std::size_t i = 0; i < truth.size(); ++i)
                if (camera_of[i] == camera) truth[i] -= sum / count;
        }
        for (int p = 0; p < 200; ++p) {
            const vec3<double> own = rng.vec(-4, -1), resting = normalize(rng.vec());
            auto& colors = points.emplace_back();
            for (std::size_t i = 0; i < truth.size(); ++i) {
                if (rng.uniform(0, 1) < 0.4) continue; // hidden
                const double turned = 0.4 * static_cast<double>(i);
                const vec3<double> n(resting.x * std::cos(turned) + resting.z * std::sin(turned), resting.y,
                                     resting.z * std::cos(turned) - resting.x * std::sin(turned));
                vec3<double> stops = own + vec3<double>(1.5 * n.z + 0.5 * n.x * n.y) + truth[i];
                if (rng.uniform(0, 1) < outliers) stops += rng.vec(-3, 0); // a shadow
                colors.push_back({i, n, stops});
            }
        }
    }
    [[nodiscard]] double worst_error() const {
        double worst = 0;
        const auto found = exposures(points, camera_of);
        for (std::size_t i = 0; i < truth.size(); ++i)
            for (int c = 0; c < 3; ++c) worst = std::max(worst, std::abs((*found[i])[c] - truth[i][c]));
        return worst;
    }
};

} // namespace

TEST_CASE("exposures are told from the colours of points and from light that a turning person shows") {
    CHECK(LitPoints().worst_error() < 1e-3);
    CHECK(LitPoints(0.2).worst_error() < 0.03); // one colour in five is in a shadow of up to three stops
}

TEST_CASE("images without a colour have no exposure; a colour of no image is refused") {
    LitPoints lit;
    for (auto& point : lit.points) std::erase_if(point, [](const SeenColor& color) { return color.image == 2; });
    const auto found = exposures(lit.points, lit.camera_of);
    CHECK(!found[2]);
    vec3<double> sum(0);
    for (const std::size_t i : {0, 1, 3, 4}) sum += *found[i];
    CHECK(length(sum) < 1e-3);
    for (const auto& stops : exposures({}, {0, 0, 1})) CHECK(!stops);
    CHECK_THROWS_AS((void)exposures({{SeenColor{.image = 3}}}, {0, 0, 1}), ValueError);
}

TEST_CASE("a check finds the exposure of photographs and the holes of masks, and says what follows") {
    cpu::Threads backend(2);
    const BodyModel body = make_actor({.edge_scale = 1.5});
    Capture capture = film(backend, body, actor_motion(ActorMotion::talk, 5),
                           {.train_cameras = 2, .test_cameras = 0, .image_size = 160, .samples = 9, .light = {}});
    const auto check = [&] { return check_capture(backend, capture, body); };
    const CaptureCheck clean = check();
    for (const ViewCheck& v : clean.views) {
        REQUIRE((v.stops && v.missing));
        MESSAGE("stops " << v.stops->x << " " << v.stops->y << " " << v.stops->z << ", missing " << *v.missing);
        for (int c = 0; c < 3; ++c) CHECK(std::abs((*v.stops)[c]) < 0.06);
        CHECK(*v.missing < 0.002);
        CHECK(v.background_removed);
    }
    CHECK(advice(capture, clean).empty());

    const std::vector<double> stops{-0.4, 0.1, 0.3, 0, 0};
    for (std::size_t t = 0; t < 5; ++t) {
        PixelImage& image = capture.images[t]; // of the first camera
        for (std::size_t i = 0; i < image.data.size(); ++i) {
            if (i % 4 == 3) continue;
            const double gain = std::exp2(stops[t]) * (i % 4 == 0 && t == 4 ? 1.1 : 1); // a reddish last image
            image.data[i] = static_cast<std::uint8_t>(std::lround(
                255 * linear_to_srgb(std::min(1.0, gain * srgb_to_linear(image.data[i] / 255.0)))));
        }
    }
    const CaptureCheck drifting = check();
    for (std::size_t t = 0; t < 5; ++t) {
        CHECK(drifting.views[t].stops->y == doctest::Approx(stops[t]).epsilon(0.07));
        CHECK(std::abs(drifting.views[t].stops->y - stops[t]) < 0.06);
        CHECK(std::abs(drifting.views[5 + t].stops->y) < 0.06);
    }
    const ExposureDrift drift = exposure_drift(drifting);
    CHECK(drift.darkest == doctest::Approx(-0.4).epsilon(0.1));
    CHECK(drift.brightest == doctest::Approx(0.3).epsilon(0.1));
    std::vector<CaptureAdvice> lines = advice(capture, drifting);
    REQUIRE(lines.size() == 1);
    CHECK(lines[0].text == test::contains("exposure drifts from -0."));
    CHECK(lines[0].text == test::contains("gain.rate"));

    const CaptureCheck few = check_capture(backend, capture, body, {.exposures = 6}); // three of each camera
    for (std::size_t t = 0; t < 5; ++t) {
        CHECK(few.views[t].stops.has_value() == (t % 2 == 0));
        CHECK(few.views[5 + t].stops.has_value() == (t % 2 == 0));
        CHECK(few.views[t].missing == drifting.views[t].missing);
    }
    CHECK(std::abs(few.views[2].stops->y - few.views[0].stops->y - 0.7) < 0.06);
    CHECK(std::abs(few.views[4].stops->y - few.views[0].stops->y - 0.4) < 0.06);

    PixelImage& torn = capture.images[7]; // a blob of a tenth of the person's height is missing in its mask
    for (int y = 70; y < 84; ++y)
        for (int x = 73; x < 87; ++x) torn.pixel(y, x)[3] = 0;
    lines = advice(capture, check());
    REQUIRE(lines.size() == 2);
    CHECK(lines[1].text == test::contains("masks lack a part of the person in cam01/2 ("));
}
