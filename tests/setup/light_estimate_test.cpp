// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/setup/canonical_setup.hpp>
#include <gsh/setup/light_estimate.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

namespace gsh {
namespace {

const BodyModel& lit_actor() {
    static const BodyModel body = make_actor();
    return body;
}

/// The actor who turns under the studio's lamp, filmed by three cameras.
struct FilmedTurn {
    cpu::Threads backend{2};
    Motion motion = actor_motion(ActorMotion::talk, 8);
    Capture capture;
    CanonicalSetup setup;

    /// The actor turns by `turn` radians from frame to frame.
    explicit FilmedTurn(const StudioLight& light = {}, double turn = 0.7) {
        for (std::size_t t = 0; t < motion.frame_count(); ++t)
            motion.pose[t * motion.joint_count] = {0, turn * (static_cast<double>(t) - 3.5), 0};
        StudioParams params;
        params.train_cameras = 3, params.test_cameras = 0, params.image_size = 200, params.samples = 4;
        params.light = light;
        capture = film(backend, lit_actor(), motion, params);
        setup = make_canonical_setup(backend, lit_actor(), motion, named_configuration("no-ao"), 2000, 0);
    }
    LightEstimate estimate(const LightEstimateParams& params = {}) {
        const LitPerson person{&setup.rig, &setup.motion};
        const std::vector<Photo> photos = photos_of(capture, false);
        return estimate_light(backend, Span<const LitPerson>(&person, 1), Span<const Photo>(photos), params);
    }
    /// Of the strongest point, from the middle of the person.
    vec3<double> direction(const LightEstimate& found) const {
        return normalize(found.light.points[0] - motion.transl[0] - setup.rig.joints[0]);
    }
};

/// Filmed under the studio's own light, once for all cases.
FilmedTurn& filmed_turn() {
    static FilmedTurn scene;
    return scene;
}
const LightEstimate& light_of_filmed_turn() {
    static const LightEstimate found = filmed_turn().estimate();
    return found;
}

} // namespace

TEST_CASE("the strongest light that is found stands where the lamp stood, and explains the photographs") {
    const auto check = [](const FilmedTurn& scene, const vec3<float>& lamp, const LightEstimate& found) {
        const vec3<double> expected =
            normalize(vec3<double>(lamp) - scene.motion.transl[0] - scene.setup.rig.joints[0]);
        CHECK(dot(scene.direction(found), expected) > std::cos(0.3));
        CHECK(found.samples > 5'000);
        CHECK(found.psnr > found.psnr_even + 4);
        CHECK(found.light.points.size() == 4);
        CHECK(found.light.directions.size() == 12);
        for (const double number : found.light.log_intensities) CHECK(std::isfinite(number));
    };
    check(filmed_turn(), StudioLight().position, light_of_filmed_turn());
    StudioLight elsewhere;
    elsewhere.position = {-2.4f, 1.9f, 1.2f};
    FilmedTurn scene(elsewhere);
    check(scene, elsewhere.position, scene.estimate());
}

TEST_CASE("no light is found on the side from which none comes") {
    // The actor does not turn around, so an albedo that is too dark could explain a light from behind.
    FilmedTurn scene(hard_light(), 0.1);
    const LightEstimate found = scene.estimate();
    const vec3<double> middle = scene.motion.transl[0] + scene.setup.rig.joints[0];
    const vec3<double> to_lamp = normalize(vec3<double>(hard_light().position) - middle);
    const auto irradiance = [&](const vec3<double>& normal) {
        double sum = 0;
        for (std::size_t k = 0; k < found.light.size(); ++k) {
            const std::size_t P = found.light.points.size();
            const vec3<double> l = k < P ? found.light.points[k] - middle : found.light.directions[k - P];
            sum += std::exp(found.light.log_intensities[k]) * std::max(0.0, dot(normal, normalize(l))) / dot(l, l);
        }
        return sum;
    };
    // Of the studio: sky and floor, seen from a surface that faces away from the lamp, against the lamp.
    CHECK(irradiance(to_lamp * -1.0) < 0.2 * irradiance(to_lamp));
}

TEST_CASE("shadows explain more than the surface's direction alone") {
    const LightEstimate &with = light_of_filmed_turn(), without = filmed_turn().estimate({.light = {.shadows = false}});
    CHECK(with.light.shadows);
    CHECK_FALSE(without.light.shadows);
    CHECK(with.psnr > without.psnr + 0.5);
}

TEST_CASE("somebody who waits far away does not change where the light is looked for") {
    FilmedTurn& scene = filmed_turn();
    const LightEstimate& alone = light_of_filmed_turn();
    Motion away = scene.motion;
    for (vec3<double>& transl : away.transl) transl += vec3<double>(0, 60, 0);
    const LitPerson people[] = {{&scene.setup.rig, &scene.setup.motion}, {&scene.setup.rig, &away}};
    const std::vector<std::size_t> frames{0, 1, 2, 3};
    const std::vector<Photo> photos = photos_of(scene.capture, false);
    const vec3<double> middle = detail::middle_of_people(Span<const LitPerson>(people, 1), photos, frames);
    vec3<double> mean(0);
    for (const std::size_t frame : frames)
        mean += (scene.motion.transl[frame] + scene.setup.rig.joints[0]) * 0.25;
    CHECK(length(middle - mean) < 1e-12);
    CHECK(length(detail::middle_of_people(people, photos, frames) - mean) < 1e-12);
    CHECK(length(detail::middle_of_people(Span<const LitPerson>(people + 1, 1), photos, frames) - mean) > 50);
    const LightEstimate both = estimate_light(scene.backend, Span<const LitPerson>(people), Span<const Photo>(photos));
    CHECK(dot(scene.direction(both), scene.direction(alone)) > std::cos(0.1));
    CHECK(both.psnr == doctest::Approx(alone.psnr).epsilon(0.02));
}

TEST_CASE("a light estimate needs people, photographs, and a person in them") {
    FilmedTurn& scene = filmed_turn();
    const LitPerson person{&scene.setup.rig, &scene.setup.motion};
    CHECK_THROWS_AS((void)estimate_light(scene.backend, Span<const LitPerson>(&person, 1), Span<const Photo>()),
                    ValueError);
    CHECK_THROWS_AS((void)scene.estimate({.light = {.points = 0, .directions = 0}}), ValueError);
    CHECK_THROWS_AS((void)scene.estimate({.candidates = 0}), ValueError);
    CHECK_THROWS_AS((void)scene.estimate({.light = {.distance = 0}}), ValueError);
    CHECK_THROWS_AS((void)scene.estimate({.photos_per_frame = 0}), ValueError);
    Motion shorter = scene.setup.motion;
    shorter.transl.resize(4), shorter.timestamps.resize(4), shorter.pose.resize(4 * shorter.joint_count);
    const LitPerson brief{&scene.setup.rig, &shorter};
    const std::vector<Photo> photos = photos_of(scene.capture, false);
    CHECK_THROWS_AS((void)estimate_light(scene.backend, Span<const LitPerson>(&brief, 1), Span<const Photo>(photos)),
                    ValueError);
    RigData bare = scene.setup.rig;
    bare.body.faces.clear();
    const LitPerson points{&bare, &scene.setup.motion};
    CHECK_THROWS_AS((void)estimate_light(scene.backend, Span<const LitPerson>(&points, 1), Span<const Photo>(photos)),
                    ValueError);
    CHECK(scene.estimate({.light = {.points = 0, .directions = 12}}).light.points.empty());
    Capture empty = scene.capture;
    for (PixelImage& image : empty.images)
        for (std::size_t i = 3; i < image.data.size(); i += 4) image.data[i] = 0; // nothing is in the mask
    const std::vector<Photo> of_nobody = photos_of(empty, false);
    const Span<const LitPerson> alone(&person, 1);
    CHECK_THROWS_AS((void)estimate_light(scene.backend, alone, Span<const Photo>(of_nobody)), ValueError);
}

} // namespace gsh
