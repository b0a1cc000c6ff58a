// SPDX-License-Identifier: Apache-2.0
#include "support/bodies.hpp"

#include <gsh/body/motion.hpp>

#include <limits>

namespace gsh {
namespace {

constexpr std::size_t motion_frames = 3;

BodyModel body_of(std::size_t joints) {
    BodyModel model = test::tube(joints, 60, 4);
    model.posedirs.clear();
    return model;
}

/// Row-major [motion_frames, width] numbers, all different.
std::vector<double> numbered(std::size_t width, double base) {
    std::vector<double> numbers(motion_frames * width);
    for (std::size_t n = 0; n < numbers.size(); ++n) numbers[n] = base + 0.001 * static_cast<double>(n);
    return numbers;
}

bool holds(const Motion& motion, const std::vector<double>& numbers, std::size_t first_joint) {
    const std::size_t width = numbers.size() / motion_frames;
    for (std::size_t t = 0; t < motion_frames; ++t)
        for (std::size_t n = 0; n < width; ++n)
            if (motion.pose_at(t)[first_joint + n / 3][static_cast<int>(n % 3)] != numbers[t * width + n]) return false;
    return true;
}

TEST_CASE("SMPL-X parts land on their joints") {
    const BodyModel model = body_of(55);
    const auto root = numbered(3, 1), body = numbered(63, 2), jaw = numbered(3, 3), left_eye = numbered(3, 4),
               right_eye = numbered(3, 5), left = numbered(45, 6), right = numbered(45, 7), shift = numbered(3, 8),
               expression = numbered(2, 9);
    const std::vector<double> times{0, 0.5, 2}, betas{1, 2};
    const Motion motion = assemble_motion(model, {.global_orient = root,
                                                  .body_pose = body,
                                                  .jaw_pose = jaw,
                                                  .leye_pose = left_eye,
                                                  .reye_pose = right_eye,
                                                  .left_hand_pose = left,
                                                  .right_hand_pose = right,
                                                  .expression = expression,
                                                  .transl = shift,
                                                  .timestamps = times,
                                                  .betas = betas});
    CHECK(motion.frame_count() == motion_frames);
    CHECK(holds(motion, root, 0));
    CHECK(holds(motion, body, 1));
    CHECK(holds(motion, jaw, 22));
    CHECK(holds(motion, left_eye, 23));
    CHECK(holds(motion, right_eye, 24));
    CHECK(holds(motion, left, 25));
    CHECK(holds(motion, right, 40));
    CHECK(motion.transl[1] == vec3<double>(shift[3], shift[4], shift[5]));
    CHECK(motion.expression_count == 2);
    CHECK(motion.expression_at(2)[1] == expression[5]);
    CHECK(motion.timestamps == times);
    CHECK(motion.betas == betas);
}

TEST_CASE("SMPL-H, SMPL and any other rig; parts left out are at rest") {
    const auto root = numbered(3, 1);
    const BodyModel h = body_of(52), smpl = body_of(24), seven = body_of(7);
    const auto left = numbered(45, 2), right = numbered(45, 3), body23 = numbered(69, 4), body6 = numbered(18, 5),
               all = numbered(21, 6);
    const Motion by_hands =
        assemble_motion(h, {.global_orient = root, .left_hand_pose = left, .right_hand_pose = right});
    CHECK(holds(by_hands, left, 22));
    CHECK(holds(by_hands, right, 37));
    CHECK(by_hands.pose_at(1)[5] == vec3<double>(0));
    CHECK(by_hands.transl[2] == vec3<double>(0));
    CHECK(by_hands.timestamps[2] == doctest::Approx(2.0 / 30));
    CHECK(holds(assemble_motion(smpl, {.global_orient = root, .body_pose = body23}), body23, 1));
    CHECK(holds(assemble_motion(seven, {.global_orient = root, .body_pose = body6}), body6, 1));
    CHECK(holds(assemble_motion(seven, {.poses = all}), all, 0));
    CHECK(assemble_motion(seven, {.frame_count = 4}).frame_count() == 4);
}

TEST_CASE("hands: mean added unless flat, principal components unfolded") {
    BodyModel model = body_of(55);
    test::Rng rng(1);
    model.hands_mean_left = rng.vecs(15), model.hands_mean_right = rng.vecs(15);
    model.hands_components_left = rng.numbers(45 * 45), model.hands_components_right = rng.numbers(45 * 45);
    const auto root = numbered(3, 1), left = numbered(45, 2), left6 = numbered(6, 3);
    const Motion curved = assemble_motion(model, {.global_orient = root, .left_hand_pose = left});
    const Motion flat = assemble_motion(model, {.global_orient = root, .left_hand_pose = left, .flat_hand = true});
    CHECK(holds(flat, left, 25));
    CHECK(length(curved.pose_at(1)[27] - flat.pose_at(1)[27] - model.hands_mean_left[2]) < 1e-15);
    CHECK(curved.pose_at(2)[40] == model.hands_mean_right[0]); // a hand at rest has the mean hand pose
    CHECK(flat.pose_at(2)[40] == vec3<double>(0));

    for (const auto& coefficients : {left6, left}) {
        const std::size_t width = coefficients.size() / motion_frames;
        const Motion motion = assemble_motion(
            model, {.global_orient = root, .left_hand_pose = coefficients, .flat_hand = true, .hand_components = true});
        for (std::size_t n = 0; n < 45; ++n) {
            double expected = 0;
            for (std::size_t c = 0; c < width; ++c)
                expected += coefficients[width + c] * model.hands_components_left[c * 45 + n];
            CHECK(motion.pose_at(1)[25 + n / 3][static_cast<int>(n % 3)] == doctest::Approx(expected));
        }
    }
    const auto whole = numbered(165, 4);
    const Motion all = assemble_motion(model, {.poses = whole});
    CHECK(length(all.pose_at(0)[40] - vec3<double>(whole[120], whole[121], whole[122]) - model.hands_mean_right[0]) <
          1e-15);
    CHECK(holds(assemble_motion(model, {.poses = whole, .flat_hand = true}), whole, 0));
}

TEST_CASE("parts that do not fit are refused") {
    const BodyModel model = body_of(55), smpl = body_of(24);
    const auto root = numbered(3, 1), body = numbered(63, 2), wide = numbered(69, 3), six = numbered(6, 4),
               nine = numbered(9, 5);
    const auto parts = [&](auto change) {
        MotionParts p{.global_orient = root, .body_pose = body};
        change(p);
        return p;
    };
    CHECK_NOTHROW((void)assemble_motion(model, parts([](auto&) {})));
    CHECK_THROWS_AS((void)assemble_motion(model, MotionParts{}), ValueError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.body_pose = wide; })), ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.frame_count = 4; })), ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.transl = six; })), ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.timestamps = six; })), ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.frames_per_second = 0; })), ValueError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.expression = nine; })), ShapeError); // 3 > 2
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.betas = nine; })), ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(model, parts([&](auto& p) { p.left_hand_pose = six; })),
                    ShapeError); // no components
    CHECK_THROWS_AS((void)assemble_motion(
                        model, parts([&](auto& p) { p.left_hand_pose = Span<const double>(body).subspan(0, 136); })),
                    ShapeError);
    CHECK_THROWS_AS((void)assemble_motion(smpl, parts([&](auto& p) { p.body_pose = wide, p.jaw_pose = root; })),
                    ValueError);
    CHECK_THROWS_AS((void)assemble_motion(smpl, parts([&](auto& p) { p.body_pose = wide, p.left_hand_pose = body; })),
                    ValueError);
}

TEST_CASE("validate looks at every array") {
    const BodyModel model = body_of(7);
    const auto all = numbered(21, 1), expression = numbered(2, 2);
    const Motion good = assemble_motion(model, {.poses = all, .expression = expression});
    const auto broken = [&](auto change) {
        Motion motion = good;
        change(motion);
        validate(motion, model, "here");
    };
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    CHECK_NOTHROW(broken([](auto&) {}));
    CHECK_THROWS_AS(broken([](auto& m) { m.joint_count = 6; }), ShapeError);
    CHECK_THROWS_AS(broken([](auto& m) { m.pose.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(broken([](auto& m) { m.expression.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(broken([](auto& m) { m.timestamps.pop_back(); }), ShapeError);
    CHECK_THROWS_AS(broken([](auto& m) { m.betas.assign(9, 0); }), ShapeError);
    CHECK_THROWS_AS(broken([](auto& m) { m.pose[3].y = nan; }), ValueError);
    CHECK_THROWS_AS(broken([](auto& m) { m.transl[0].y = nan; }), ValueError);
    CHECK_THROWS_AS(broken([](auto& m) { m.betas.assign(1, 0), m.betas[0] = nan; }), ValueError);
    CHECK_THROWS_AS(broken([](auto& m) { m.expression[0] = nan; }), ValueError);
    CHECK_THROWS_AS(broken([](auto& m) { m.timestamps[0] = nan; }), ValueError);
}

TEST_CASE("Euler angles, quaternions and matrices say the same rotations") {
    test::Rng rng(2);
    const auto angles = rng.vecs(20);
    std::vector<quat<double>> quats;
    std::vector<mat3<double>> matrices;
    for (const auto& a : angles) {
        matrices.push_back(rotation_from_euler(a, EulerOrder::zxy));
        auto q = quat_from_rotation(matrices.back());
        quats.push_back({2 * q.w, 2 * q.x, 2 * q.y, 2 * q.z});
    }
    const auto by_euler = axis_angles_from_euler(angles, EulerOrder::zxy);
    const auto by_quat = axis_angles_from_quats(quats), by_matrix = axis_angles_from_matrices(matrices);
    for (std::size_t i = 0; i < angles.size(); ++i) {
        CHECK(length(by_euler[i] - by_matrix[i]) < 1e-12);
        CHECK(length(by_quat[i] - by_matrix[i]) < 1e-12);
        const mat3<double> back = rotation_from_axis_angle(by_matrix[i]);
        for (int c = 0; c < 3; ++c) CHECK(length(back[c] - matrices[i][c]) < 1e-12);
    }
    CHECK_THROWS_AS((void)axis_angles_from_quats(std::vector<quat<double>>{{0, 0, 0, 0}}), ValueError);
    CHECK_THROWS_AS((void)axis_angles_from_matrices(std::vector<mat3<double>>{mat3<double>(2.0)}), ValueError);
    CHECK_THROWS_AS((void)axis_angles_from_matrices(std::vector<mat3<double>>{mat3<double>(-1.0)}),
                    ValueError); // a reflection
    mat3<double> bad(1.0);
    bad[1][1] = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_AS((void)axis_angles_from_matrices(std::vector<mat3<double>>{bad}), ValueError);
}

} // namespace
} // namespace gsh
