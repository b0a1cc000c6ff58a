// SPDX-License-Identifier: Apache-2.0
/// @file  People of one scene are fitted with the same cameras: clocks, principal points and focal length.
#include <gsh/fit/fit_people.hpp>

#include "fit/filmed_person.hpp"
#include "support/contains.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/prior/mesh_rasterizer.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

using namespace gsh;

namespace {

Motion moved(Motion motion, const vec3<double>& from, const vec3<double>& step) {
    for (std::size_t t = 0; t < motion.frame_count(); ++t) motion.transl[t] += from + step * static_cast<double>(t);
    return motion;
}

/// Mean distance of joints in the world, millimetres.
double world_error_mm(const Motion& found, const Motion& truth) {
    return joint_errors(test::fitted_actor(), found, truth, RootAlignment::none).mean_mm;
}

} // namespace

TEST_CASE("people's own findings differ; a person who stands still gets those of one who walks") {
    const auto cameras = test::cameras_around(3, 4);
    const std::vector<Motion> truth{moved(actor_motion(ActorMotion::stride, 20), {-0.6, 0, 0}, {0.03, 0, 0}),
                                    moved(actor_motion(ActorMotion::talk, 20), {0.7, 0, 0.2}, {0, 0, 0})};
    std::vector<PersonToFit> people;
    for (std::size_t p = 0; p < 2; ++p) {
        people.push_back({test::seen(test::fitted_actor(), truth[p], cameras, 0.004, 3 + p)});
        for (PersonPhoto& photo : people[p].photos)
            if (photo.camera == 1) photo.frame = photo.frame == 0 ? 999 : photo.frame - 1; // it shows the next moment
        std::erase_if(people[p].photos, [](const PersonPhoto& photo) { return photo.frame == 999; });
    }
    const std::vector<MotionFit> fits =
        fit_people(test::fitted_actor(), cameras, people, truth[0].timestamps, {.betas = 2});
    REQUIRE(fits.size() == 2);
    CHECK(fits[0].time_offsets == fits[1].time_offsets);
    CHECK(fits[0].shifts == fits[1].shifts);
    CHECK(fits[0].time_offsets[1] - fits[0].time_offsets[0] == doctest::Approx(0.1).epsilon(0.2));
    for (std::size_t p = 0; p < 2; ++p) CHECK(world_error_mm(fits[p].motion, truth[p]) < 30);
}

TEST_CASE("findings are weighted by what is known, up to the mean of each person's clocks") {
    const std::vector<Camera<double>> cameras(3, {.width = 1000, .height = 800});
    std::vector<MotionFit> fits(2);
    fits[0].time_offsets = {0.0, 0.1, -0.05}, fits[1].time_offsets = {0.2, 0.3, 0.0};
    fits[0].time_errors = {0.01, 0.01, 0.01}, fits[1].time_errors = {0.01, 0.01, 1e9};
    fits[0].shifts.assign(3, vec2<double>(0)), fits[1].shifts = {{0, 0}, {0, 0}, {12, 0}};
    for (MotionFit& fit : fits) fit.camera_fit.assign(3, {.pixels = 1, .metres = 0.01, .count = 100});
    fits[0].camera_fit[2].count = 300;
    fits[0].focal = 1.1, fits[1].focal = 1 / 1.1;
    CameraFindings found = common_findings(fits, cameras, 0.1);
    // The clocks of the second person are those of the first, but for a common 0.2 s; his third is not known.
    CHECK(found.time_offsets[0] == 0);
    CHECK(found.time_offsets[1] == doctest::Approx(0.1));
    CHECK(found.time_offsets[2] == doctest::Approx(-0.05));
    CHECK(found.shifts[2] == vec2<double>(0)); // 3 pixels are less than 0.5%
    CHECK(found.focal == doctest::Approx(1));
    fits[1].camera_fit[2].count = 300;
    CHECK(common_findings(fits, cameras, 0.1).shifts[2].x == doctest::Approx(6));
}

TEST_CASE("one person is fitted once, and findings that are given are kept") {
    const auto cameras = test::cameras_around(3);
    const Motion truth = actor_motion(ActorMotion::stride, 8);
    const auto photos = test::seen(test::fitted_actor(), truth, cameras, 0.004);
    const auto alone = fit_people(test::fitted_actor(), cameras, {{photos}}, truth.timestamps, {.betas = 2});
    CHECK(alone[0].motion.pose ==
          fit_motion(test::fitted_actor(), cameras, photos, truth.timestamps, {.betas = 2}).motion.pose);
    const CameraFindings given{{0, 0, 0}, {{0, 0}, {7, 0}, {0, 0}}};
    const auto with =
        fit_people(test::fitted_actor(), cameras, {{photos}}, truth.timestamps, {.cameras = given, .betas = 2});
    CHECK(with[0].shifts == given.shifts);
    CHECK(with[0].camera_fit[1].pixels > alone[0].camera_fit[1].pixels + 2); // they are wrong, and used
    const auto refused = [&](const std::vector<PersonToFit>& people, const MotionFitParams& params) {
        try {
            (void)fit_people(test::fitted_actor(), cameras, people, truth.timestamps, params);
        } catch (const ValueError& error) {
            return std::string(error.what());
        }
        return std::string("none");
    };
    CHECK(refused({}, {}) == test::contains("there are no people"));
    CHECK(refused({{photos}}, {.cameras = CameraFindings{{0}, {{0, 0}}}}) ==
          test::contains("an offset and a shift for each of 3"));
}

TEST_CASE("one mask of two people who stand close shows the shape of each nearly as well as its own mask") {
    const BodyModel& body = test::fitted_actor();
    const auto cameras = test::cameras_around(2);
    std::vector<Motion> truth{moved(actor_motion(ActorMotion::talk, 6), {-0.2, 0, -0.1}, {0, 0, 0}),
                              moved(actor_motion(ActorMotion::talk, 6), {0.2, 0, 0.1}, {0, 0, 0})};
    for (std::size_t p = 0; p < 2; ++p) {
        truth[p].betas.assign(static_cast<std::size_t>(body.shape_count), 0.0);
        truth[p].betas[1] = p == 0 ? 3 : -3, truth[p].betas[2] = p == 0 ? -2 : 2;
    }
    cpu::Serial backend;
    std::vector<std::vector<PersonPhoto>> photos;
    std::vector<std::vector<std::uint8_t>> both;
    std::vector<std::vector<std::vector<std::uint8_t>>> own(2);
    for (std::size_t p = 0; p < 2; ++p) {
        photos.push_back(test::seen(body, truth[p], cameras, 0.004, 5 + p));
        for (std::size_t i = 0; i < photos[p].size(); ++i) {
            const PersonPhoto& photo = photos[p][i];
            const PosedBody posed =
                pose_body(body, truth[p].pose_at(photo.frame), truth[p].transl[photo.frame], truth[p].betas);
            const MeshImage image =
                rasterize_mesh(backend, Span<const vec3<double>>(posed.vertices), body.faces, cameras[photo.camera]);
            auto& mask = own[p].emplace_back(image.size(), std::uint8_t{0});
            if (p == 0) both.emplace_back(image.size(), std::uint8_t{0});
            for (std::size_t k = 0; k < mask.size(); ++k)
                if (image.covers(k)) mask[k] = both[i][k] = 255;
        }
    }
    const auto shape_error_mm = [&](std::size_t p, const std::vector<std::vector<std::uint8_t>>& masks) {
        auto mine = photos[p];
        for (std::size_t i = 0; i < mine.size(); ++i)
            mine[i].mask = {cameras[0].height, cameras[0].width, masks[i].data()};
        const MotionFit fit = fit_motion(body, cameras, mine, truth[p].timestamps, {.betas = 4});
        const auto a = shaped_vertices(body, fit.motion.betas), b = shaped_vertices(body, truth[p].betas);
        double sum = 0;
        for (std::size_t v = 0; v < a.size(); ++v) sum += length(a[v] - b[v]);
        return 1e3 * sum / static_cast<double>(a.size());
    };
    std::size_t shared = 0;
    for (std::size_t i = 0; i < both.size(); ++i)
        for (std::size_t k = 0; k < both[i].size(); ++k) shared += own[0][i][k] && own[1][i][k];
    REQUIRE(shared > 1000); // one hides a part of the other
    for (const std::size_t p : {0, 1}) {
        const double alone = shape_error_mm(p, own[p]), together = shape_error_mm(p, both);
        CAPTURE(p);
        CAPTURE(alone);
        CHECK(together < alone + 1.5);
    }
}
