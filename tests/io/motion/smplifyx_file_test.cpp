// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/motion/smplifyx_file.hpp>

#include "io/npz_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"

#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// results/ID/000.pkl of three images, stacked.
struct SmplifyxSample {
    static constexpr std::size_t T = 3; // frames
    std::map<std::string, std::pair<std::vector<double>, Shape>> arrays;

    SmplifyxSample() {
        test::Rng rng(9);
        for (const auto& [key, width] : std::map<std::string, std::size_t>{{"global_orient", 3},
                                                                           {"body_pose", 63},
                                                                           {"jaw_pose", 3},
                                                                           {"leye_pose", 3},
                                                                           {"reye_pose", 3},
                                                                           {"left_hand_pose", 12},
                                                                           {"right_hand_pose", 12},
                                                                           {"expression", 2},
                                                                           {"camera_translation", 3}})
            arrays[key] = {rng.numbers(T * width, -0.3, 0.3), {T, 1, width}}; // pickles hold (1, n)
        arrays["betas"] = {{1, 2, 3, 3, 2, 1, 2, 2, 2}, {T, 3}};
        std::vector<double> rotations;
        for (std::size_t t = 0; t < T; ++t) {
            const mat3<double> R = rotation_from_axis_angle(rng.vec());
            for (int row = 0; row < 3; ++row)
                for (int column = 0; column < 3; ++column) rotations.push_back(R[column][row]);
        }
        arrays["camera_rotation"] = {rotations, {T, 1, 3, 3}};
        arrays["focal_length"] = {{5000}, {}};
        arrays["camera_center"] = {{270, 280, 270, 280, 270, 280}, {T, 2}};
    }
    void write(const std::filesystem::path& path) const {
        NpzWriter file(path);
        for (const auto& [key, array] : arrays) file.add(key, array.first, array.second);
        file.commit();
    }
    /// World to camera of a frame.
    [[nodiscard]] vec3<double> seen(std::size_t t, const vec3<double>& x) const {
        const double* R = &arrays.at("camera_rotation").first[9 * t];
        const double* c = &arrays.at("camera_translation").first[3 * t];
        return {R[0] * x.x + R[1] * x.y + R[2] * x.z + c[0], R[3] * x.x + R[4] * x.y + R[5] * x.z + c[1],
                R[6] * x.x + R[7] * x.y + R[8] * x.z + c[2]};
    }
};

} // namespace

TEST_CASE("SMPLify-X: the body in its camera's frame, the mean hand added, one shape") {
    constexpr auto T = SmplifyxSample::T;
    const test::Temporary folder;
    const auto path = folder / "smplx.npz";
    const BodyModel body = test::small_body(55, 3, 2, true);
    SmplifyxSample sample;
    sample.write(path);
    const SmplifyxFits fits = load_smplifyx_fits(path, body);
    REQUIRE(fits.motion.frame_count() == T);
    CHECK(fits.motion.betas == std::vector<double>{2, 2, 2});
    double x = body.hands_mean_left[0].x;
    for (std::size_t c = 0; c < 12; ++c)
        x += sample.arrays["left_hand_pose"].first[c] * body.hands_components_left[45 * c];
    CHECK(fits.motion.pose[25].x == doctest::Approx(x));
    CHECK(fits.frame_ids.empty());
    REQUIRE(fits.has_camera());
    const Camera<double> camera = fits.camera(540, 540);
    CHECK(camera.fx == 5000);
    CHECK(camera.cy == 280);

    // The same file without the camera's pose. Its motion is then in the world.
    SmplifyxSample bare = sample;
    bare.arrays.erase("camera_rotation"), bare.arrays.erase("camera_translation"), bare.arrays.erase("camera_center");
    bare.write(path);
    const SmplifyxFits in_world = load_smplifyx_fits(path, body);
    CHECK(in_world.camera(540, 541).cy == 270.5);
    for (std::size_t t = 0; t < T; ++t) {
        auto points = test::posed_points(body, in_world.motion, t);
        for (auto& p : points) p = sample.seen(t, p);
        CHECK(test::largest_distance(test::posed_points(body, fits.motion, t), points) < 1e-12);
    }
}

TEST_CASE("HAHA: transl, camera_transform, a normalised camera_matrix, and the images' numbers") {
    constexpr auto T = SmplifyxSample::T;
    const test::Temporary folder;
    const auto path = folder / "smplx.npz";
    const BodyModel body = test::small_body(55, 3, 2, true);
    SmplifyxSample sample, plain;
    std::vector<double> transform, matrix;
    for (std::size_t t = 0; t < T; ++t) {
        for (std::size_t row = 0; row < 3; ++row) {
            for (std::size_t column = 0; column < 3; ++column)
                transform.push_back(sample.arrays["camera_rotation"].first[9 * t + 3 * row + column]);
            transform.push_back(sample.arrays["camera_translation"].first[3 * t + row]);
        }
        for (const double v : {0, 0, 0, 1}) transform.push_back(v);
        for (const double v :
             {4.93, 0.0, -0.05, 0.0, 0.0, 4.94, 0.05, 0.0, 0.0, 0.0, 1.0001, -0.0101, 0.0, 0.0, 1.0, 0.0})
            matrix.push_back(v);
    }
    for (SmplifyxSample* s : {&sample, &plain}) s->arrays["transl"] = {{0, 1, 2, 3, 4, 5, 6, 7, 8}, {T, 1, 3}};
    sample.arrays.erase("camera_rotation"), sample.arrays.erase("camera_translation");
    sample.arrays["camera_transform"] = {transform, {T, 4, 4}};
    sample.arrays["camera_matrix"] = {matrix, {T, 4, 4}};
    {
        NpzWriter file(path);
        for (const auto& [key, array] : sample.arrays) file.add(key, array.first, array.second);
        file.add("frame_ids", std::vector<std::int64_t>{0, 4, 8});
        file.add("flat_hand_mean", std::uint8_t(1));
        file.commit();
    }
    const SmplifyxFits fits = load_smplifyx_fits(path, body);
    CHECK(fits.frame_ids == std::vector<int>{0, 4, 8});
    const Camera<double> camera = fits.camera(1080, 1080);
    CHECK(camera.fx == doctest::Approx(2662.2));
    CHECK(camera.cx == doctest::Approx(513));
    CHECK(camera.cy == doctest::Approx(567));
    double x = 0;
    for (std::size_t c = 0; c < 12; ++c)
        x += sample.arrays["left_hand_pose"].first[c] * body.hands_components_left[45 * c];
    CHECK(fits.motion.pose[25].x == doctest::Approx(x)); // flat hands, as the file states

    plain.write(path);
    MotionFileOptions flat;
    flat.hands = MotionFileOptions::Hands::flat;
    const SmplifyxFits other = load_smplifyx_fits(path, body, flat);
    for (std::size_t t = 0; t < T; ++t)
        CHECK(test::largest_distance(test::posed_points(body, fits.motion, t),
                                     test::posed_points(body, other.motion, t)) < 1e-12);
}

TEST_CASE("bad fits name the file and the member") {
    constexpr auto T = SmplifyxSample::T;
    const test::Temporary folder;
    const auto path = folder / "smplx.npz";
    const BodyModel body = test::small_body(55, 3, 2, true);
    const auto expect = [&](const std::function<void(SmplifyxSample&)>& change,
                            std::initializer_list<std::string_view> words) {
        SmplifyxSample sample;
        change(sample);
        sample.write(path);
        test::check_throws<Error>([&] { (void)load_smplifyx_fits(path, body); }, {path.string()});
        test::check_throws<Error>([&] { (void)load_smplifyx_fits(path, body); }, words);
    };
    expect([](SmplifyxSample& s) { s.arrays.erase("global_orient"); }, {"global_orient is missing"});
    expect([](SmplifyxSample& s) { s.arrays.erase("body_pose"); }, {"body_pose is missing"});
    expect(
        [](SmplifyxSample& s) {
            s.arrays["body_pose"] = {std::vector<double>(T * 32), {T, 32}};
        },
        {"body_pose", "VPoser", "decode"});
    expect([](SmplifyxSample& s) { s.arrays["camera_rotation"].first[0] += 0.1; }, {"camera_rotation[0]", "rotation"});
    expect(
        [](SmplifyxSample& s) {
            s.arrays["camera_translation"] = {std::vector<double>(6), {2, 3}};
        },
        {"camera_translation", "(2, 3)"});
    expect([](SmplifyxSample& s) { s.arrays["focal_length"] = {{5000, 5000, 4000}, {T}}; },
           {"focal_length", "changes"});
    expect([](SmplifyxSample& s) { s.arrays["focal_length"] = {{-1}, {1}}; }, {"focal_length", "above 0"});
    expect([](SmplifyxSample& s) { s.arrays["camera_center"] = {{1, 2, 3}, {3}}; }, {"camera_center", "(3,)"});
    expect([](SmplifyxSample& s) { s.arrays["jaw_pose"] = {std::vector<double>(T * 9), {T, 9}}; },
           {"jaw_pose", "(3, 9)"});
}
