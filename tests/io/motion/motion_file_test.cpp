// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/motion/motion_file.hpp>

#include "io/npz_files.hpp"
#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

using namespace gsh;

namespace {

/// The arrays of a motion file. Tests may change some.
struct MotionArrays {
    static constexpr std::size_t T = 3; // frames
    struct Array {
        std::vector<double> data;
        Shape shape;
    };
    std::map<std::string, Array> arrays;

    void set(const std::string& key, const Shape& shape, std::uint64_t seed = 0) {
        test::Rng rng(seed + key.size());
        arrays[key] = {rng.numbers(detail::element_count(shape), -0.3, 0.3), shape};
    }
    void write(const std::filesystem::path& path) const {
        NpzWriter file(path);
        for (const auto& [key, array] : arrays) file.add(key, array.data, array.shape);
        file.commit();
    }
    [[nodiscard]] vec3<double> at(const std::string& key, std::size_t frame, std::size_t joint) const {
        const Array& array = arrays.at(key);
        const double* v = &array.data[frame * array.data.size() / T + 3 * joint];
        return {v[0], v[1], v[2]};
    }
};

MotionArrays split_parts() {
    constexpr auto T = MotionArrays::T;
    MotionArrays parts;
    for (const char* key : {"global_orient", "jaw_pose", "leye_pose", "reye_pose", "transl"})
        parts.set(key, {T, 3}, std::size_t(key[0]));
    parts.set("body_pose", {T, 63});
    parts.set("left_hand_pose", {T, 45});
    parts.set("right_hand_pose", {T, 45});
    parts.set("betas", {3});
    parts.set("expression", {T, 2});
    parts.arrays["timestamps"] = {{0, 0.1, 0.3}, {T}};
    return parts;
}

} // namespace

TEST_CASE("a split file fills the joints of SMPL-X") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const BodyModel model = test::small_body(55, 3, 2);
    const MotionArrays parts = split_parts();
    parts.write(folder / "poses.npz");
    std::vector<std::string> warnings;
    const Motion motion = load_motion(folder / "poses.npz", model, {}, &warnings);
    CHECK(warnings.empty());
    REQUIRE(motion.frame_count() == T);
    REQUIRE(motion.pose.size() == T * 55);
    CHECK(motion.betas == parts.arrays.at("betas").data);
    CHECK(motion.expression == parts.arrays.at("expression").data);
    CHECK(motion.timestamps == std::vector<double>{0, 0.1, 0.3});
    for (std::size_t t = 0; t < T; ++t) {
        const auto pose = motion.pose_at(t);
        CHECK(pose[0] == parts.at("global_orient", t, 0));
        CHECK(pose[1] == parts.at("body_pose", t, 0));
        CHECK(pose[21] == parts.at("body_pose", t, 20));
        CHECK(pose[22] == parts.at("jaw_pose", t, 0));
        CHECK(pose[23] == parts.at("leye_pose", t, 0));
        CHECK(pose[24] == parts.at("reye_pose", t, 0));
        CHECK(pose[25] == parts.at("left_hand_pose", t, 0));
        CHECK(pose[54] == parts.at("right_hand_pose", t, 14));
        CHECK(motion.transl[t] == parts.at("transl", t, 0));
    }
}

TEST_CASE("a body of trunk and limbs takes its 22 joints from files of its relatives") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const BodyModel model = test::small_body(22, 3, 0);
    const auto check = [&](const char* what, const MotionArrays& parts, const char* body_key, std::size_t first,
                           const char* warning) {
        CAPTURE(what);
        parts.write(folder / what);
        std::vector<std::string> warnings;
        const Motion motion = load_motion(folder / what, model, {}, &warnings);
        REQUIRE(motion.pose.size() == T * 22);
        for (std::size_t t = 0; t < T; ++t)
            for (std::size_t j = 1; j < 22; ++j) CHECK(motion.pose_at(t)[j] == parts.at(body_key, t, j - first));
        bool warned = false;
        for (const std::string& text : warnings) warned = warned || text.find(warning) != std::string::npos;
        CHECK(warned);
    };
    MotionArrays split = split_parts();
    check("smplx.npz", split, "body_pose", 1, "expression holds 2 coefficients");
    split.set("body_pose", {T, 69});
    check("smpl.npz", split, "body_pose", 1, "last two joints (hands) are left out");
    MotionArrays whole;
    whole.set("poses", {T, 165}), whole.set("trans", {T, 3}), whole.set("betas", {3});
    check("amass.npz", whole, "poses", 0, "the common ones are taken");
    split.set("body_pose", {T, 60});
    split.write(folder / "bad.npz");
    test::check_throws<ShapeError>([&] { (void)load_motion(folder / "bad.npz", model); },
                                   {"body_pose has 60 numbers", "expected 63"});
}

TEST_CASE("motions come back as they were saved") {
    const test::Temporary folder;
    for (const std::size_t joints : {std::size_t(55), std::size_t(52), std::size_t(24), std::size_t(7)}) {
        const BodyModel model = test::small_body(joints, 3, 2, true);
        test::Rng rng(1);
        Motion motion;
        motion.joint_count = joints, motion.expression_count = 2;
        motion.betas = rng.numbers(3);
        motion.pose = rng.vecs(4 * joints);
        motion.expression = rng.numbers(8);
        motion.transl = rng.vecs(4);
        motion.timestamps = {0, 1, 2, 4};
        save_motion(folder / "a.npz", motion);
        const Motion read = load_motion(folder / "a.npz", model);
        CHECK(read.joint_count == joints);
        CHECK(read.betas == motion.betas);
        CHECK(read.pose == motion.pose);
        CHECK(read.expression == motion.expression);
        CHECK(read.transl == motion.transl);
        CHECK(read.timestamps == motion.timestamps);
        motion.transl.pop_back();
        CHECK_THROWS_AS(save_motion(folder / "b.npz", motion), ShapeError);
    }
}

TEST_CASE("whole files of AMASS, for the same body and for its relatives") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const auto path = folder / "amass.npz";
    MotionArrays parts;
    parts.set("trans", {T, 3});
    parts.set("betas", {16});
    parts.arrays["mocap_framerate"] = {{120}, {}};
    for (const std::size_t found : {std::size_t(55), std::size_t(52), std::size_t(24)})
        for (const std::size_t joints : {std::size_t(55), std::size_t(52), std::size_t(24)}) {
            parts.set("poses", {T, 3 * found});
            parts.write(path);
            std::vector<std::string> warnings;
            const Motion motion = load_motion(path, test::small_body(joints), {}, &warnings);
            CHECK(warnings.size() == (found == joints ? 1 : 2)); // too many betas; other joints
            CHECK(motion.betas.size() == 3);
            CHECK(motion.timestamps[1] == doctest::Approx(1.0 / 120));
            const auto pose = motion.pose_at(1);
            CHECK(pose[21] == parts.at("poses", 1, 21));
            if (found >= 52 && joints >= 52) {
                CHECK(pose[joints - 1] == parts.at("poses", 1, found - 1));
                CHECK(pose[joints - 30] == parts.at("poses", 1, found - 30));
            }
            if (found == 52 && joints == 55) CHECK(pose[22] == vec3<double>(0)); // no jaw
        }
    parts.set("poses", {T, 60});
    parts.write(path);
    test::check_throws<ShapeError>([&] { (void)load_motion(path, test::small_body(55)); },
                                   {path.string(), "poses has 60", "165"});
}

TEST_CASE("the mean hand is added as the file, the layout or the caller says") {
    const test::Temporary folder;
    const auto path = folder / "poses.npz";
    const BodyModel model = test::small_body(55, 3, 2, true);
    MotionArrays parts = split_parts();
    const auto added = [&](MotionFileOptions::Hands hands) {
        parts.write(path);
        MotionFileOptions options;
        options.hands = hands;
        const auto pose = load_motion(path, model, options).pose;
        const vec3<double> left = pose[25 + 3] - parts.at("left_hand_pose", 0, 3),
                           right = pose[40 + 3] - parts.at("right_hand_pose", 0, 3);
        const bool with_left = length(left - model.hands_mean_left[3]) < 1e-12,
                   with_right = length(right - model.hands_mean_right[3]) < 1e-12;
        CHECK(with_left == with_right);
        if (!with_left) CHECK(length(left) < 1e-12);
        return with_left;
    };
    using Hands = MotionFileOptions::Hands;
    CHECK(added(Hands::automatic));
    CHECK(added(Hands::add_mean));
    CHECK(!added(Hands::flat));
    // An integer flag, as save_motion writes it.
    {
        NpzWriter file(folder / "flat.npz");
        for (const auto& [key, array] : parts.arrays) file.add(key, array.data, array.shape);
        file.add("flat_hand", std::uint8_t(1));
        file.commit();
    }
    CHECK(load_motion(folder / "flat.npz", model).pose[28] == parts.at("left_hand_pose", 0, 3));
}

TEST_CASE("PCA coefficients become hand poses") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const BodyModel model = test::small_body(55, 3, 2, true);
    MotionArrays parts = split_parts();
    parts.set("left_hand_pose", {T, 2});
    parts.write(folder / "a.npz");
    MotionFileOptions options;
    options.hands = MotionFileOptions::Hands::flat;
    const Motion motion = load_motion(folder / "a.npz", model, options);
    const auto& c = parts.arrays.at("left_hand_pose").data;
    const auto& axes = model.hands_components_left;
    CHECK(motion.pose_at(1)[25 + 4].y == doctest::Approx(c[2] * axes[13] + c[3] * axes[45 + 13]));
    parts.set("left_hand_pose", {T, 46});
    parts.write(folder / "b.npz");
    for (const BodyModel& body : {model, test::small_body(55)})
        test::check_throws<ShapeError>([&] { (void)load_motion(folder / "b.npz", body); },
                                       {"b.npz", "left_hand_pose has 46", "45"});
    // A body without components: the rest of the motion is read, and the hand stays as the mean hand.
    for (const bool zero : {false, true}) {
        parts.set("left_hand_pose", {T, 2});
        if (zero) parts.arrays["left_hand_pose"].data.assign(2 * T, 0.0);
        parts.write(folder / "c.npz");
        std::vector<std::string> warnings;
        const Motion without = load_motion(folder / "c.npz", test::small_body(55), {}, &warnings);
        CHECK(without.pose_at(1)[25] == vec3<double>(0));
        CHECK(without.pose_at(1)[21] == motion.pose_at(1)[21]);
        CHECK(warnings.size() == (zero ? 0u : 1u));
        if (!zero) CHECK(warnings[0] == test::contains("left_hand_pose holds 2 principal components"));
    }
}

TEST_CASE("parts that are missing, left over or odd are warned of") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const auto path = folder / "poses.npz";
    const BodyModel model = test::small_body(55, 3, 2);
    const auto expect = [&](const std::function<void(MotionArrays&)>& change, std::string_view word) {
        MotionArrays parts = split_parts();
        change(parts);
        parts.write(path);
        std::vector<std::string> warnings;
        (void)load_motion(path, model, {}, &warnings);
        REQUIRE(warnings.size() == 1);
        INFO(warnings[0]);
        CHECK(warnings[0].find(path.string()) == 0);
        CHECK(warnings[0] == test::contains(word));
        (void)load_motion(path, model);
    };
    expect([](MotionArrays& p) { p.arrays.erase("jaw_pose"); }, "jaw_pose is missing");
    expect([](MotionArrays& p) { p.arrays.erase("left_hand_pose"); }, "left_hand_pose is missing");
    expect([](MotionArrays& p) { p.set("betas", {10}); }, "betas hold 10");
    expect([](MotionArrays& p) { p.set("betas", {T, 3}); }, "betas change");
    expect([](MotionArrays& p) { p.set("expression", {T, 10}); }, "expression holds 10");
    expect([](MotionArrays& p) { p.set("body_pose", {T, 69}); }, "body_pose is SMPL's");
    expect([](MotionArrays& p) { p.arrays["body_pose"].data[70] = 90; }, "degrees");
}

TEST_CASE("a mean hand forgotten or added twice is warned of") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const auto path = folder / "poses.npz";
    const BodyModel model = test::small_body(55, 3, 2, true);
    const auto warnings_with = [&](double mean_hands, MotionFileOptions::Hands hands) {
        MotionArrays parts = split_parts();
        for (std::size_t t = 0; t < T; ++t)
            for (std::size_t k = 0; k < 45; ++k)
                for (const bool left : {true, false}) {
                    const auto& mean = left ? model.hands_mean_left : model.hands_mean_right;
                    auto& value = parts.arrays[left ? "left_hand_pose" : "right_hand_pose"].data[t * 45 + k];
                    value = 0.1 * value + mean_hands * mean[k / 3][static_cast<int>(k % 3)];
                }
        parts.write(path);
        MotionFileOptions options;
        options.hands = hands;
        std::vector<std::string> warnings;
        (void)load_motion(path, model, options, &warnings);
        return warnings.empty() ? std::string() : warnings[0];
    };
    using Hands = MotionFileOptions::Hands;
    CHECK(warnings_with(0, Hands::add_mean).empty());
    CHECK(warnings_with(1, Hands::flat).empty());
    CHECK(warnings_with(1, Hands::add_mean) == test::contains("added twice"));
    CHECK(warnings_with(0, Hands::flat) == test::contains("left out"));
}

TEST_CASE("bad motion files name the file and the key") {
    constexpr auto T = MotionArrays::T;
    const test::Temporary folder;
    const auto path = folder / "poses.npz";
    const BodyModel model = test::small_body(55, 3, 2);
    const auto expect = [&](const std::function<void(MotionArrays&)>& change,
                            std::initializer_list<std::string_view> words) {
        MotionArrays parts = split_parts();
        change(parts);
        parts.write(path);
        test::check_throws<Error>([&] { (void)load_motion(path, model); }, {path.string()});
        test::check_throws<Error>([&] { (void)load_motion(path, model); }, words);
    };
    for (const char* key : {"global_orient", "body_pose", "transl", "betas"})
        expect([&](MotionArrays& p) { p.arrays.erase(key); },
               {key == std::string("global_orient") ? "global_orient is missing" : std::string_view(key), "missing"});
    for (const char* key : {"body_pose", "transl", "jaw_pose", "left_hand_pose", "expression"}) {
        expect([&](MotionArrays& p) { p.set(key, {T + 1, p.arrays[key].shape[1]}); }, {key, "(4, ", "expected (3, "});
        expect([&](MotionArrays& p) { p.arrays[key].data[1] = std::numeric_limits<double>::quiet_NaN(); },
               {std::string(key) + "[0, 1]", "NaN"});
    }
    // Numbers whose products are not finite.
    expect([](MotionArrays& p) { p.arrays["body_pose"].data[0] = 1e200; }, {"pose[3] is 1e+200", "at most 1e30"});
    expect([](MotionArrays& p) { p.arrays["betas"].data[1] = -1e200; }, {"betas[1] is -1e+200", "at most 1e30"});
    expect([](MotionArrays& p) { p.set("global_orient", {T, 4}); }, {"global_orient", "(3, 4)", "expected (*, 3)"});
    expect([](MotionArrays& p) { p.set("global_orient", {}); }, {"global_orient", "()"});
    expect([](MotionArrays& p) { p.set("body_pose", {T, 60}); }, {"body_pose has 60", "63"});
    expect([](MotionArrays& p) { p.set("body_pose", {T, 64}); }, {"body_pose has 64", "63"});
    expect([](MotionArrays& p) { p.set("transl", {T, 2}); }, {"transl", "(3, 2)", "expected (3, 3)"});
    expect([](MotionArrays& p) { p.set("betas", {}); }, {"betas", "()"});
    expect([](MotionArrays& p) { p.set("timestamps", {T + 1}); }, {"timestamps", "(4,)", "(3,)"});
    expect([](MotionArrays& p) { p.arrays["timestamps"].data = {0, 2, 1}; }, {"timestamps", "frame 2"});
    expect(
        [](MotionArrays& p) {
            for (auto& [key, array] : p.arrays)
                if (key != "betas") array = {{}, {0, array.shape.size() > 1 ? array.shape[1] : 1}};
        },
        {"global_orient", "no frames"});
    test::check_throws<IoError>([&] { (void)load_motion(folder / "none.npz", model); }, {"none.npz", "No such file"});
}
