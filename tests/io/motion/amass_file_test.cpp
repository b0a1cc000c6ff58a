// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/motion/amass_file.hpp>

#include "io/npz_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"
#include "support/contains.hpp"

#include <functional>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// Members of the SMPL-X release's ..._stageii.npz.
struct AmassSample {
    static constexpr std::size_t T = 4; // frames
    std::map<std::string, std::pair<std::vector<double>, Shape>> arrays;

    AmassSample() {
        test::Rng rng(2);
        for (const auto& [key, width] : std::map<std::string, std::size_t>{{"trans", 3},
                                                                           {"root_orient", 3},
                                                                           {"pose_body", 63},
                                                                           {"pose_hand", 90},
                                                                           {"pose_jaw", 3},
                                                                           {"pose_eye", 6}})
            arrays[key] = {rng.numbers(T * width, -0.4, 0.4), {T, width}};
        std::vector<double> poses;
        for (std::size_t t = 0; t < T; ++t)
            for (const char* key : {"root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand"}) {
                const auto& [data, shape] = arrays[key];
                poses.insert(poses.end(), &data[t * shape[1]], &data[t * shape[1]] + shape[1]);
            }
        arrays["poses"] = {poses, {T, 165}};
        arrays["betas"] = {rng.numbers(16), {16}};
    }
    void write(const std::filesystem::path& path, const char* rate = "mocap_frame_rate") const {
        NpzWriter file(path);
        for (const auto& [key, array] : arrays) file.add(key, array.first, array.second);
        if (rate) file.add(rate, 120.0);
        file.add("num_betas", std::int64_t(16));
        file.add_text("gender", "female");
        file.add_text("surface_model_type", "smplx");
        file.commit();
    }
};

} // namespace

TEST_CASE("AMASS for SMPL-X: whole poses and split poses are the same motion") {
    constexpr auto T = AmassSample::T;
    const test::Temporary folder;
    const auto path = folder / "walk_stageii.npz";
    const BodyModel body = test::small_body(55, 16, 2, true);
    AmassSample sample;
    sample.write(path);
    std::vector<std::string> warnings;
    const Motion whole = load_amass_motion(path, body, {}, &warnings);
    REQUIRE(whole.frame_count() == T);
    CHECK(whole.pose[55 + 22].x == sample.arrays["pose_jaw"].first[3]);
    CHECK(whole.pose[55 + 24].x == sample.arrays["pose_eye"].first[6 + 3]);
    CHECK(whole.pose[55 + 40].x == sample.arrays["pose_hand"].first[90 + 45]); // no mean hand is added
    CHECK(whole.timestamps[2] == doctest::Approx(2.0 / 120));
    CHECK(whole.betas == sample.arrays["betas"].first);

    sample.arrays.erase("poses");
    sample.write(path, "mocap_framerate");
    const Motion split = load_amass_motion(path, body);
    CHECK(split.pose == whole.pose);
    CHECK(split.transl == whole.transl);
    CHECK(split.timestamps == whole.timestamps);
    // A file with the body alone.
    for (const char* key : {"pose_hand", "pose_jaw", "pose_eye", "betas"}) sample.arrays.erase(key);
    sample.write(path, nullptr);
    warnings.clear();
    MotionFileOptions options;
    options.fps = 20;
    const Motion bare = load_amass_motion(path, body, options, &warnings);
    CHECK(bare.pose[55 + 21] == split.pose[55 + 21]);
    CHECK(bare.pose[55 + 30] == vec3<double>(0));
    CHECK(bare.betas == std::vector<double>(16, 0.0));
    CHECK(bare.timestamps[1] == doctest::Approx(0.05));
    CHECK(warnings[0] == test::contains("betas are missing"));
}

TEST_CASE("other members of the family: SMPL+H, SMPL without a shape") {
    constexpr auto T = AmassSample::T;
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    test::Rng rng(1);
    for (const std::size_t joints : {std::size_t(52), std::size_t(24)}) {
        const std::vector<double> poses = rng.numbers(T * 3 * joints, -0.3, 0.3);
        {
            NpzWriter file(path);
            test::add_floats(file, "poses", poses, {T, 3 * joints});
            test::add_floats(file, "trans", rng.numbers(T * 3), {T, 3});
            file.add("dmpls", std::vector<double>(T * 8, 0.0), {T, 8});
            file.commit();
        }
        const Motion motion = load_amass_motion(path, test::small_body(joints));
        CHECK(motion.pose[2 * joints - 1].z == float(poses[6 * joints - 1]));
    }
}

TEST_CASE("z up becomes y up where that is asked for") {
    constexpr auto T = AmassSample::T;
    const test::Temporary folder;
    const BodyModel body = test::small_body(55, 16, 2);
    AmassSample sample;
    auto& poses = sample.arrays["poses"].first;
    for (std::size_t t = 0; t < T; ++t)
        poses[165 * t] = 1.5, poses[165 * t + 1] = 0.1, poses[165 * t + 2] = 0; // turns y into z
    sample.write(folder / "a.npz");
    MotionFileOptions options;
    const Motion stored = load_amass_motion(folder / "a.npz", body, options);
    options.world = MotionFileOptions::World::upright;
    const Motion upright = load_amass_motion(folder / "a.npz", body, options);
    for (std::size_t t = 0; t < T; ++t) {
        auto points = test::posed_points(body, stored, t);
        for (auto& p : points) p = {p.x, p.z, -p.y};
        CHECK(test::largest_distance(test::posed_points(body, upright, t), points) < 1e-12);
    }
}

TEST_CASE("bad AMASS files name the file and the member") {
    constexpr auto T = AmassSample::T;
    const test::Temporary folder;
    const auto path = folder / "a.npz";
    const BodyModel body = test::small_body(55, 16, 2);
    const auto expect = [&](const std::function<void(AmassSample&)>& change,
                            std::initializer_list<std::string_view> words) {
        AmassSample sample;
        sample.arrays.erase("poses");
        change(sample);
        sample.write(path);
        test::check_throws<Error>([&] { (void)load_amass_motion(path, body); }, {path.string()});
        test::check_throws<Error>([&] { (void)load_amass_motion(path, body); }, words);
    };
    expect([](AmassSample& s) { s.arrays.erase("root_orient"); }, {"poses is missing", "root_orient"});
    expect([](AmassSample& s) { s.arrays.erase("pose_body"); }, {"pose_body is missing"});
    expect([](AmassSample& s) { s.arrays.erase("trans"); }, {"trans is missing"});
    expect(
        [](AmassSample& s) {
            s.arrays["pose_hand"] = {std::vector<double>(T * 45), {T, 45}};
        },
        {"pose_hand", "(4, 45)", "(4, 90)"});
    expect([](AmassSample& s) { s.arrays["trans"] = {std::vector<double>(9), {3, 3}}; }, {"trans", "(3, 3)", "(4, 3)"});
    expect(
        [](AmassSample& s) {
            s.arrays["pose_body"] = {std::vector<double>(T * 60), {T, 60}};
        },
        {"pose_body has 60", "63"});
    expect([](AmassSample& s) { s.arrays["root_orient"] = {{}, {0, 3}}; }, {"root_orient", "(0, 3)"});
    expect(
        [](AmassSample& s) {
            s.arrays["fps"] = {{-1}, {}};
            s.arrays["mocap_framerate"] = {{0}, {}};
        },
        {"mocap_framerate", "above 0"});
    test::check_throws<IoError>([&] { (void)load_amass_motion(folder / "none.npz", body); }, {"none.npz"});
}
