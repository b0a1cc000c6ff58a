// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/threads.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/check/capture_check.hpp>
#include <gsh/synthetic/actor_skeleton.hpp>

#include "check/box_scene.hpp"
#include "io/temporary.hpp"
#include "support/chunks_alone.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::test::boxes;

namespace {

/// Checks that exactly this fault is found and that its text states the improvement.
CaptureFinding only(const CaptureCheck& result, const std::string& fault) {
    INFO(texts(result));
    REQUIRE(result.findings.size() == 1);
    const CaptureFinding& finding = result.findings[0];
    CHECK(finding.fault == fault);
    CHECK(finding.text.starts_with(fault + " ("));
    CHECK(finding.text == test::contains(" as given, "));
    CHECK(finding.text.find('\n') == std::string::npos);
    return finding;
}
CaptureFinding mended(const CaptureCheck& result, const std::string& fault, double at_least = 0.97) {
    const CaptureFinding finding = only(result, fault);
    CHECK(finding.mended > at_least);
    CHECK(finding.given < finding.mended - 0.04);
    return finding;
}

/// Two people side by side with different motions.
struct Two {
    Motion ann = placed(5, {-0.6, 0, -0.3}), bob = placed(9, {0.6, 0.05, 0.3});
    Capture capture = film_boxes(people(), 2, 4.4);

    [[nodiscard]] static Motion placed(std::uint64_t seed, const vec3<double>& place) {
        Motion motion = dance(scene().body, 6, seed);
        displace(motion, place);
        return motion;
    }
    [[nodiscard]] std::vector<CheckedPerson> people() const {
        return {{"ann", &scene().body, &ann}, {"bob", &scene().body, &bob}};
    }
    [[nodiscard]] CaptureCheck check() const { return test::boxes::check(capture, people()); }
};
const Two& two() {
    static const Two instance;
    return instance;
}

} // namespace

TEST_CASE("silhouettes: areas, middles, overlaps of moved ones") {
    PixelImage image(4, 6, 9);
    for (int y = 1; y < 4; ++y)
        for (int x = 2; x < 6; ++x) image.pixel(y, x)[3] = 200;
    const Silhouette full = mask_silhouette(image);
    CHECK(full.area() == 12);
    CHECK(full.share() == doctest::Approx(12.0 / 54));
    CHECK(full.border_share() == 0);
    CHECK(full.centroid().x == doctest::Approx(4.0));
    CHECK(full.centroid().y == doctest::Approx(2.5));
    CHECK(overlap(full, full).iou() == 1);
    CHECK(overlap(full, full, 1, 0).iou() == doctest::Approx(9.0 / 15));
    CHECK(overlap(full, full, 0, -2).both == 4); // one row lies outside the image
    CHECK(overlap(full, full, 0, -2).either == 16);
    CHECK(overlap(full, full, 50, 0).iou() == 0);
    Silhouette mirrored = full;
    mirrored.mirror();
    CHECK(mirrored.centroid().x == doctest::Approx(5.0));
    Silhouette inverted = full;
    inverted.invert();
    CHECK(inverted.area() == 42);
    CHECK(inverted.border_share() == 1);

    const Silhouette small = mask_silhouette(image, 2); // 3 x 4, without the last column
    CHECK(small.height == 3);
    CHECK(small.width == 4);
    CHECK(small.inside == std::vector<std::uint8_t>{0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0});
    CHECK(mask_silhouette(PixelImage(4, 0, 0)).area() == 0);
    CHECK(Silhouette{}.share() == 0);
    CHECK(Silhouette{}.border_share() == 0);
    CHECK(Overlap{}.iou() == 0);
    test::check_throws<ValueError>([] { (void)mask_silhouette(PixelImage(3, 2, 2)); },
                                   {"mask_silhouette", "3 channels"});
    test::check_throws<ValueError>([&] { (void)mask_silhouette(image, 0); }, {"reduction"});
    test::check_throws<ShapeError>([&] { (void)overlap(full, small); }, {"overlap", "rows"});

    const Camera<double> camera = scene().capture.cameras[0].camera, half = reduced_camera(camera, 2);
    const vec2<double> a = to_pixel(camera, vec3<double>(0.2, 0.1, 2)), b = to_pixel(half, vec3<double>(0.2, 0.1, 2));
    CHECK(length(vec3<double>(a - 2.0 * b, 0)) < 1e-12);
    CHECK(half.width == photo_size / 2);
}

TEST_CASE("orders of frames") {
    using Kind = FrameOrder::Kind;
    const auto all = [](FrameOrder order, std::size_t frames) {
        std::vector<int> poses;
        for (std::size_t f = 0; f < frames; ++f)
            poses.push_back(order.pose_of(f, frames) ? static_cast<int>(*order.pose_of(f, frames)) : -1);
        return poses;
    };
    CHECK(all({}, 3) == std::vector<int>{0, 1, 2});
    CHECK(all({Kind::offset, 2}, 3) == std::vector<int>{2, -1, -1});
    CHECK(all({Kind::offset, -1}, 3) == std::vector<int>{-1, 0, 1});
    CHECK(all({Kind::reversed, 0}, 3) == std::vector<int>{2, 1, 0});
    CHECK(all({Kind::names_from_0, 0}, 12) == std::vector<int>{0, 1, 10, 11, 2, 3, 4, 5, 6, 7, 8, 9});
    CHECK(all({Kind::names_from_1, 0}, 12) == std::vector<int>{0, 9, 10, 11, 1, 2, 3, 4, 5, 6, 7, 8});
}

TEST_CASE("readings of cameras are what their names say") {
    const Camera<double> camera = scene().capture.cameras[1].camera;
    const mat3<double> turn(vec3<double>(1, 0, 0), vec3<double>(0, -1, 0), vec3<double>(0, 0, -1));
    const auto check_same = [&](Camera<double> written, CameraReading reading) {
        const Camera<double> read = read_as(written, reading);
        for (int c = 0; c < 3; ++c) CHECK(length(read.R[c] - camera.R[c]) < 1e-12);
        CHECK(length(read.t - camera.t) < 1e-12);
        CHECK(read.fx == doctest::Approx(camera.fx));
        CHECK(read.cy == doctest::Approx(camera.cy));
    };
    Camera<double> other = camera;
    check_same(other, {});
    other.t *= 1000;
    check_same(other, {.unit = 0.001});
    other = camera, other.R = transpose(camera.R), other.t = camera.center();
    check_same(other, {.extrinsics = Extrinsics::camera_to_world});
    other.R = other.R * turn;
    check_same(other, {.extrinsics = Extrinsics::opengl_camera_to_world});
    other = camera, other.R = turn * camera.R, other.t = turn * camera.t;
    check_same(other, {.extrinsics = Extrinsics::opengl});
    other = camera, other.R = transpose(camera.R);
    check_same(other, {.extrinsics = Extrinsics::transposed});
    other = camera, other.t = camera.center();
    check_same(other, {.extrinsics = Extrinsics::position});
    other = camera, other.fx *= 2, other.fy *= 2, other.cx = 2 * (camera.cx - 3), other.cy = 2 * (camera.cy + 1);
    check_same(other, {.resolution = 2, .shift = {3, -1}});
    other = camera, other.fx /= 1.5, other.fy /= 1.5;
    check_same(other, {.zoom = 1.5});
}

TEST_CASE("counterparts of joints, and poses read so") {
    const BodyModel& body = scene().body;
    const Motion& motion = scene().capture.motion;
    const std::vector<int> counterparts = joint_counterparts(body);
    for (std::size_t j = 0; j < body.joint_count(); ++j) {
        std::string name(actor_joints[j].name);
        if (const auto at = name.find("left"); at != std::string::npos)
            name.replace(at, 4, "right");
        else if (const auto other = name.find("right"); other != std::string::npos)
            name.replace(other, 5, "left");
        CHECK(name == actor_joints[static_cast<std::size_t>(counterparts[j])].name);
    }
    const PosedBody plain = pose_body(body, motion.pose_at(3), motion.transl[3], motion.betas);
    CHECK(pose_as(body, motion, 3, {}, counterparts).vertices == plain.vertices);
    // Mirroring twice restores the pose. A body without rotation and translation mirrors in x.
    Motion mirrored = motion;
    for (std::size_t j = 1; j < body.joint_count(); ++j) {
        const vec3<double> v = motion.pose_at(3)[static_cast<std::size_t>(counterparts[j])];
        mirrored.pose[3 * body.joint_count() + j] = {v.x, -v.y, -v.z};
    }
    const auto back = pose_as(body, mirrored, 3, {.sides = MotionReading::Sides::mirrored}, counterparts);
    for (std::size_t j = 0; j < body.joint_count(); ++j) CHECK(length(back.joints[j] - plain.joints[j]) < 1e-12);
    // With transl as the position of the root joint, the joint is at transl.
    const auto rooted =
        pose_as(body, motion, 3, {.translation = MotionReading::Translation::of_root_joint}, counterparts);
    CHECK(length(rooted.joints[0] - motion.transl[3]) < 1e-12);
    const auto large = pose_as(body, motion, 3, {.size = 2, .offset = {1, 0, 0}}, counterparts);
    CHECK(length(large.joints[20] - (2.0 * plain.joints[20] - motion.transl[3] + vec3<double>(1, 0, 0))) < 1e-12);
    CHECK(first_hand_joint(55) == 25);
    CHECK(first_hand_joint(52) == 22);
    CHECK(!first_hand_joint(24));
    test::check_throws<ShapeError>([&] { (void)pose_as(body, motion, 0, {}, {}); }, {"pose_as", "counterparts"});
}

TEST_CASE("a good capture has no fault, and its figures are those of the masks") {
    const CaptureCheck result = check(scene().capture);
    CHECK(texts(result) == "");
    CHECK(result.views.size() == 36);
    CHECK(result.mean_iou().value() == 1);
    for (const ViewCheck& v : result.views) CHECK(v.inside > 0.99);

    CaptureCheckParams params;
    params.frames = 5;
    cpu::Threads threads(3);
    const CaptureCheck five = check_capture(threads, scene().capture, scene().body, params);
    CHECK(five.views.size() == 15);
    CHECK(five.views[0].view.frame == 0);
    CHECK(five.views[4].view.frame == 11);
    params.frames = 1;
    CHECK(check_capture(threads, scene().capture, scene().body, params).views[0].view.frame == 6);
}

TEST_CASE("loose clothes and an estimator's errors are no faults") {
    const Motion& motion = scene().capture.motion;
    const Capture clothed = film_boxes(box_person(1.25), motion);
    CaptureCheck result = check(clothed);
    CHECK(texts(result) == "");
    CHECK(result.mean_iou().value() < 0.85);
    CHECK(result.mean_iou().value() > 0.7);

    Capture noisy = scene().capture;
    test::Rng rng(3);
    for (vec3<double>& v : noisy.motion.pose) v += rng.vecs(1, -0.05, 0.05)[0];
    for (vec3<double>& v : noisy.motion.transl) v += rng.vecs(1, -0.008, 0.008)[0];
    result = check(noisy);
    CHECK(texts(result) == "");
    CHECK(result.mean_iou().value() < 0.93);
}

TEST_CASE("faults of images and masks") {
    CHECK(mended(check(spoiled([](Capture& c) {
                     for (auto& image : c.images) invert(image);
                 })),
                 "inverted-masks")
              .cameras.size() == 3);
    CHECK(mended(check(spoiled([](Capture& c) {
                     for (auto& image : c.images) mirror(image);
                 })),
                 "mirrored-images")
              .cameras.size() == 3);
    const CaptureFinding one = mended(check(spoiled([](Capture& c) {
                                          for (std::size_t f = 0; f < 12; ++f) mirror(c.images[12 + f]);
                                      })),
                                      "mirrored-images");
    CHECK(one.cameras == std::vector<std::size_t>{1});
    CHECK(one.text == test::contains("(cam01)"));

    const CaptureFinding empty = only(check(spoiled([](Capture& c) {
                                          for (const std::size_t i : {std::size_t(3), std::size_t(20)})
                                              c.images[i] = PixelImage(4, photo_size, photo_size);
                                      })),
                                      "empty-masks");
    CHECK(empty.views.size() == 2);
    CHECK(empty.text == test::contains("cam00/3, cam01/8"));
    const auto fill = [](PixelImage& image) {
        for (std::size_t i = 3; i < image.data.size(); i += 4) image.data[i] = 255;
    };
    const Capture opaque = spoiled([&](Capture& c) {
        for (auto& image : c.images) fill(image);
    });
    CHECK(only(check(opaque), "no-masks").given == 1);
    Capture over_background = opaque; // opaque photographs with a plate need no masks
    over_background.backgrounds.assign(3, opaque.images[0]);
    CHECK(texts(check(over_background)) == "");

    const CaptureFinding single = only(
        check(spoiled([](Capture& c) { std::swap(c.images[2], c.images[7]), mirror(c.images[30]); })), "single-images");
    CHECK(single.views.size() >= 2);
    CHECK(single.given < 0.6);
    CHECK(single.mended == 1);
}

TEST_CASE("faults of cameras") {
    const auto D = [](vec3<double> v) { return vec3<double>(v.x, -v.y, -v.z); };
    mended(check(with_cameras([](Camera<double>& c, std::size_t) { c.t = c.center(), c.R = transpose(c.R); })),
           "camera-to-world");
    mended(check(with_cameras([&](Camera<double>& c, std::size_t) {
               for (int k = 0; k < 3; ++k) c.R[k] = D(c.R[k]);
               c.t = D(c.t);
           })),
           "opengl-cameras");
    mended(check(with_cameras([&](Camera<double>& c, std::size_t) {
               c.t = c.center(), c.R = transpose(c.R);
               c.R[1] = -c.R[1], c.R[2] = -c.R[2];
           })),
           "opengl-cameras");
    mended(check(with_cameras([](Camera<double>& c, std::size_t) { c.R = transpose(c.R); })), "transposed-rotation");
    mended(check(with_cameras([](Camera<double>& c, std::size_t) { c.t = c.center(); })), "camera-position");
    const CaptureFinding units =
        mended(check(with_cameras([](Camera<double>& c, std::size_t) { c.t *= 1000; })), "camera-units");
    CHECK(units.text == test::contains("millimetres"));
    mended(check(with_cameras([](Camera<double>& c, std::size_t) { c.fx *= 2, c.fy *= 2, c.cx *= 2, c.cy *= 2; })),
           "other-resolution", 0.93);
    const CaptureFinding focal = mended(check(with_cameras([](Camera<double>& c, std::size_t k) {
                                            if (k == 2) c.fx *= 1.15, c.fy *= 1.15;
                                        })),
                                        "focal-length", 0.95);
    CHECK(focal.cameras == std::vector<std::size_t>{2});

    const CaptureCheck result =
        check(with_cameras([](Camera<double>& c, std::size_t k) { c.cx += k == 1 ? 6 : 0, c.cy -= k == 1 ? 4 : 0; }));
    const CaptureFinding center = mended(result, "principal-point");
    CHECK(center.cameras == std::vector<std::size_t>{1});
    CHECK(result.reading.cameras[1].shift == vec2<double>(-6, 4));
    const auto& truth = scene().capture.cameras[1].camera;
    CHECK(center.text ==
          test::contains("store cx " + detail::digits(truth.cx, 1) + ", cy " + detail::digits(truth.cy, 1)));

    // All cameras have the image's middle in place of the principal point.
    CHECK(mended(check(with_cameras(
                     [](Camera<double>& c, std::size_t k) { c.cx = c.cy = photo_size / 2 + 12.0 * double(k) - 12; })),
                 "principal-point")
              .cameras.size() >= 2);

    const CaptureFinding far = only(check(with_cameras([](Camera<double>& c, std::size_t k) {
                                        if (k == 0) c.t.x += 40;
                                    })),
                                    "camera-far-off");
    CHECK(far.cameras == std::vector<std::size_t>{0});
    CHECK(far.given == 0);
}

TEST_CASE("faults of poses") {
    const auto with_motion = [](const auto& change) { return spoiled([&](Capture& c) { change(c.motion); }); };
    CHECK(mended(check(with_motion([](Motion& m) { exchange_sides(m, true); })), "mirrored-poses").cameras.empty());
    CHECK(mended(check(with_motion([](Motion& m) { exchange_sides(m, false); })), "mirrored-poses").text ==
          test::contains("exchanged"));
    mended(check(with_motion(write_degrees)), "degrees");
    mended(check(with_motion([](Motion& m) { write_units(m, 1000); })), "translation-units");
    mended(check(with_motion([](Motion& m) { displace(m, resting_root(m)); })), "translation-origin");
    mended(check(with_motion(turn_z_up)), "world-axes");
    const CaptureFinding moved = mended(check(with_motion([](Motion& m) {
                                            displace(m, {0.05, 0.1, -0.06});
                                        })),
                                        "displaced-body");
    CHECK(moved.text == test::contains("(-0.05"));
}

TEST_CASE("betas that are missing, and a body in millimetres") {
    Capture capture = scene().capture;
    capture.motion.betas = {2.0};
    capture = film_boxes(scene().body, capture.motion);
    capture.motion.betas = {0.0};
    const CaptureFinding finding = mended(check(capture), "body-size", 0.9);
    CHECK(finding.text == test::contains("scaled by 1.2"));
    CHECK(finding.text == test::contains("betas are all zero"));

    BodyModel large = scene().body;
    for (auto& v : large.v_template) v *= 1000.0;
    for (auto& v : large.shapedirs) v *= 1000.0;
    CHECK(mended(check(scene().capture, large), "body-size").text == test::contains("not in metres"));
}

TEST_CASE("frames in another order") {
    const auto in_order = [](FrameOrder order) { // image n shows pose_of(n)
        return spoiled([&](Capture& c) {
            const Capture good = c;
            for (std::size_t k = 0; k < c.cameras.size(); ++k)
                for (std::size_t f = 0; f < 12; ++f)
                    if (const auto pose = order.pose_of(f, 12)) c.images[k * 12 + f] = good.images[k * 12 + *pose];
        });
    };
    using Kind = FrameOrder::Kind;
    CHECK(mended(check(in_order({Kind::reversed, 0})), "frame-order").text == test::contains("reverse"));
    CHECK(mended(check(in_order({Kind::names_from_1, 0})), "frame-order").text == test::contains("zeros"));
    const Capture later = in_order({Kind::offset, 1});
    const CaptureCheck result = check(later);
    INFO(texts(result));
    REQUIRE(!result.findings.empty());
    CHECK(result.findings[0].fault == "frame-order");
    CHECK(result.findings[0].text == test::contains("pair image n with pose n + 1"));
    CHECK(texts(result) != test::contains("no-overlap")); // the last image has no pose and is not counted
    // Only one camera started late.
    Capture one = scene().capture;
    std::copy(later.images.begin() + 12, later.images.begin() + 24, one.images.begin() + 12);
    const CaptureCheck single = check(one);
    REQUIRE(!single.findings.empty());
    CHECK(single.findings[0].fault == "frame-order");
    CHECK(single.findings[0].cameras == std::vector<std::size_t>{1});
}

TEST_CASE("mean hands that were forgotten, or added twice") {
    const auto add = [](double times) { return spoiled([&](Capture& c) { add_mean_hands(c.motion, times); }); };
    CHECK(mended(check(add(-1)), "mean-hand-missing").text == test::contains("flat_hand = 0"));
    CHECK(mended(check(add(1)), "mean-hand-twice").text == test::contains("flat_hand = 1"));
    CHECK(only(check(add(-1)), "mean-hand-missing").measure == "IoU around the hands");
}

TEST_CASE("faults that come together, and what nobody can explain") {
    const CaptureCheck both = check(spoiled([](Capture& c) {
        for (auto& image : c.images) invert(image);
        for (auto& named : c.cameras)
            named.camera.t = named.camera.center(), named.camera.R = transpose(named.camera.R);
    }));
    INFO(texts(both));
    REQUIRE(both.findings.size() == 2);
    CHECK(both.findings[0].fault == "inverted-masks");
    CHECK(both.findings[1].fault == "camera-to-world");
    CHECK(both.findings[1].mended == 1);

    Capture other = scene().capture; // masks of something else: a square in a corner
    for (auto& image : other.images) {
        image = PixelImage(4, photo_size, photo_size);
        for (int y = 45; y < 52; ++y)
            for (int x = 0; x < photo_size; ++x) image.pixel(y, x)[3] = 255;
    }
    const CaptureFinding apart = only(check(other), "no-overlap");
    CHECK(apart.given < 0.6);
    CHECK(apart.cameras.size() == 3);
}

TEST_CASE("another body, and captures that are none") {
    Capture capture = scene().capture;
    capture.motion.joint_count = 24;
    capture.motion.pose.resize(12 * 24);
    const CaptureFinding finding = only(check(capture), "another-body");
    CHECK(finding.given == 24);
    CHECK(finding.mended == 55);
    CHECK(finding.text == test::contains("--body"));

    capture = scene().capture;
    capture.images.pop_back();
    test::check_throws<ShapeError>([&] { (void)check(capture); }, {"check_capture", "images"});
    test::check_throws<ValueError>([&] { (void)check(Capture{}); }, {"check_capture", "no cameras"});
    // One camera and one frame are too little evidence for a finding.
    const Motion still = dance(scene().body, 1);
    CHECK(texts(check(film_boxes(scene().body, still, 1))) == "");
    // A camera lacks one frame.
    capture = scene().capture;
    capture.images[5] = {};
    const CaptureCheck result = check(capture);
    CHECK(texts(result) == "");
    CHECK(result.views.size() == 35);
}

TEST_CASE("two people: good poses have no fault, and each of them is seen") {
    const CaptureCheck result = two().check();
    CHECK(texts(result) == "");
    CHECK(result.mean_iou().value() == 1);
    CHECK(result.reading.motions.size() == 2);
    for (const ViewCheck& v : result.views) {
        REQUIRE(v.people.size() == 2);
        for (const ViewCheck::Person& person : v.people) {
            CHECK(person.inside > 0.9);
            CHECK(person.covered == 1);
        }
    }
    // Checked alone, each person has masks that also show the other one, and the check reports no overlap.
    CHECK(texts(check(two().capture, scene().body)) == test::contains("no-overlap"));
}

TEST_CASE("two people: a fault in the poses of one of them is found there") {
    const std::vector<std::pair<std::string, std::function<void(Motion&)>>> faults{
        {"mirrored-poses", [](Motion& m) { exchange_sides(m, true); }},
        {"mirrored-poses", [](Motion& m) { exchange_sides(m, false); }},
        {"degrees", write_degrees},
        {"translation-units", [](Motion& m) { write_units(m, 1000); }},
        {"translation-origin", [](Motion& m) { displace(m, resting_root(m)); }},
        {"world-axes", turn_z_up},
        {"body-size", [](Motion& m) { m.betas = {-1.2}; }},
        {"displaced-body",
         [](Motion& m) {
             displace(m, {0.1, 0.15, -0.1});
         }},
        {"mean-hand-missing", [](Motion& m) { add_mean_hands(m, -1); }},
        {"mean-hand-twice", [](Motion& m) { add_mean_hands(m, 1); }},
    };
    for (std::size_t k = 0; k < faults.size(); ++k) {
        Two spoiled = two();
        faults[k].second(k % 2 ? spoiled.ann : spoiled.bob);
        const std::string name = k % 2 ? "ann" : "bob";
        const CaptureFinding finding = mended(spoiled.check(), faults[k].first, 0.9);
        CHECK(finding.people == std::vector<std::string>{name});
        CHECK(finding.cameras.empty());
        CHECK(finding.text == test::contains("(poses of " + name + ")"));
    }
}

TEST_CASE("two people: loose clothes and an estimator's errors are no faults, and hide none") {
    const BodyModel clothes = box_person(1.25);
    Two clothed = two();
    clothed.capture = film_boxes({{"", &clothes, &clothed.ann}, {"", &clothes, &clothed.bob}}, 2, 4.4);
    test::Rng rng(3);
    for (Motion* motion : {&clothed.ann, &clothed.bob}) {
        for (vec3<double>& v : motion->pose) v += rng.vecs(1, -0.03, 0.03)[0];
        for (vec3<double>& v : motion->transl) v += rng.vecs(1, -0.005, 0.005)[0];
    }
    const CaptureCheck result = clothed.check();
    CHECK(texts(result) == "");
    CHECK(result.mean_iou().value() < 0.85);
    displace(clothed.bob, {0.15, 0.2, -0.1});
    const CaptureFinding moved = mended(clothed.check(), "displaced-body", 0.7);
    CHECK(moved.people == std::vector<std::string>{"bob"});
}

TEST_CASE("two people: what both have in common, and faults that come together") {
    Two both = two();
    write_degrees(both.ann), write_degrees(both.bob);
    const CaptureFinding degrees = mended(both.check(), "degrees");
    CHECK(degrees.people.empty());
    CHECK(degrees.text == test::contains("(poses)"));

    Two each = two();
    write_degrees(each.ann), write_units(each.bob, 100);
    const CaptureCheck result = each.check();
    INFO(texts(result));
    REQUIRE(result.findings.size() == 2);
    CHECK(result.findings[0].fault == "degrees");
    CHECK(result.findings[0].people == std::vector<std::string>{"ann"});
    CHECK(result.findings[1].fault == "translation-units");
    CHECK(result.findings[1].people == std::vector<std::string>{"bob"});
    CHECK(result.findings[1].mended == 1);
}

TEST_CASE("two people: faults of cameras concern everybody") {
    Two inverse = two();
    for (NamedCamera& named : inverse.capture.cameras)
        named.camera.t = named.camera.center(), named.camera.R = transpose(named.camera.R);
    const CaptureFinding finding = mended(inverse.check(), "camera-to-world");
    CHECK(finding.cameras.size() == 2);
    CHECK(finding.people.empty());

    Two moved = two();
    moved.capture.cameras[1].camera.cx += 6;
    CHECK(mended(moved.check(), "principal-point").cameras == std::vector<std::size_t>{1});
}

TEST_CASE("poses of somebody who is not in the images") {
    const Motion nobody = Two::placed(3, {-0.2, 0, 1.1});
    std::vector<CheckedPerson> people = two().people();
    people.push_back({"cleo", &scene().body, &nobody});
    const auto absent = [&](const Capture& capture) {
        const CaptureCheck result = check(capture, people);
        const CaptureFinding finding = only(result, "absent-person");
        CHECK(finding.people == std::vector<std::string>{"cleo"});
        CHECK(finding.text == test::contains("(poses of cleo)"));
        CHECK(finding.mended == 1);
        for (const ViewCheck& v : result.views) CHECK(v.people[0].covered == 1);
        return finding;
    };
    CHECK(absent(two().capture).measure == "IoU");

    BodyModel doll = scene().body; // too small to change the overlap noticeably
    for (auto& v : doll.v_template) v *= 0.15;
    for (auto& v : doll.shapedirs) v *= 0.15;
    people[2].body = &doll;
    CHECK(absent(two().capture).given < 0.5);
    Motion away = nobody; // outside all images
    displace(away, {100, 0, 0});
    people[2].motion = &away;
    CHECK(absent(two().capture).given == 0);
    CHECK(absent(two().capture).measure == test::contains("in the masks"));
}

TEST_CASE("people who do not fit the capture or their bodies") {
    Two other = two();
    other.bob.joint_count = 24;
    other.bob.pose.resize(6 * 24);
    const CaptureFinding finding = only(other.check(), "another-body");
    CHECK(finding.people == std::vector<std::string>{"bob"});
    CHECK(finding.text == test::contains("(poses of bob)"));

    other.bob = dance(scene().body, 5);
    test::check_throws<ShapeError>([&] { (void)other.check(); }, {"check_capture", "5", "6"});
    test::check_throws<ValueError>([&] { (void)check(two().capture, std::vector<CheckedPerson>{}); },
                                   {"check_capture", "no person"});
}

TEST_CASE("low overlaps that no mistake explains are advice to register poses, not findings") {
    const Capture capture = scene().capture;
    CaptureCheck check;
    CHECK(advice(capture, check).empty()); // no image has a mask
    check.views.resize(2);
    check.views[0].iou = 0.86, check.views[1].iou = 0.8; // loose clothes
    CHECK(advice(capture, check).empty());
    check.views[0].iou = 0.7, check.views[1].iou = 0.72;
    const std::vector<CaptureAdvice> lines = advice(capture, check);
    REQUIRE(lines.size() == 1);
    CHECK(lines[0].text == test::contains("overlap by 0.71"));
    CHECK(lines[0].text == test::contains("--refine"));
    check.findings.emplace_back();
    CHECK(advice(capture, check).empty()); // the mistake explains it
}

TEST_CASE("a frame whose overlap lies far below the others is named") {
    const Capture capture = scene().capture;
    CaptureCheck check;
    for (std::size_t t = 0; t < 6; ++t)
        for (std::size_t c = 0; c < 2; ++c)
            check.views.push_back({.view = {c, t}, .iou = t == 4 ? 0.7 : 0.9 + 0.01 * static_cast<double>(c)});
    const auto frames = frame_overlaps(check);
    CHECK(frames.size() == 6);
    CHECK(frames.at(1) == doctest::Approx(0.905));
    CHECK(frames.at(4) == doctest::Approx(0.7));
    const std::vector<CaptureAdvice> lines = advice(capture, check);
    REQUIRE(lines.size() == 1);
    CHECK(lines[0].text.find("frames 4 (0.70): ") == 0);
    CHECK(lines[0].text == test::contains("others (0.91)"));
    check.views.erase(check.views.begin() + 6, check.views.end());
    check.views[0].iou = check.views[1].iou = 0.8; // three frames do not show what is usual
    CHECK(advice(capture, check).empty());
}

TEST_CASE("a silhouette without its border") {
    Silhouette square{7, 9, std::vector<std::uint8_t>(63, 0)};
    for (int y = 1; y < 7; ++y)
        for (int x = 2; x < 8; ++x) square.inside[static_cast<std::size_t>(9 * y + x)] = 1; // to the lower border
    const Silhouette inner = eroded(square, 2);
    for (int y = 0; y < 7; ++y)
        for (int x = 0; x < 9; ++x) CHECK(inner.row(y)[x] == (y >= 3 && x >= 4 && x < 6));
    CHECK(eroded(square, 0).inside == square.inside);
    CHECK(eroded(square, 3).area() == 0);
    const Silhouette full{3, 3, std::vector<std::uint8_t>(9, 1)};
    CHECK(eroded(full, 5).area() == 9);
}
