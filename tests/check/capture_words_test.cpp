// SPDX-License-Identifier: Apache-2.0
/// @file  Each remedy that a check names, followed to the letter, takes the fault away.
#include <gsh/check/capture_words.hpp>

#include "check/box_scene.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <numbers>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using namespace gsh::test::boxes;

namespace {

/// The number behind a word of a finding's text.
double number_after(const std::string& text, const std::string& word, std::size_t from = 0) {
    const auto at = text.find(word, from);
    INFO("looking for " << word << " in " << text);
    REQUIRE(at != std::string::npos);
    return std::stod(text.substr(at + word.size()));
}

/// The one finding of a spoiled capture. Its text has to hold these words.
CaptureFinding finding_of(const Capture& capture, const char* fault, const char* words,
                          const BodyModel& body = scene().body) {
    const CaptureCheck result = check(capture, body);
    INFO(texts(result));
    REQUIRE(result.findings.size() == 1);
    CHECK(result.findings[0].fault == fault);
    CHECK(result.findings[0].text == test::contains(words));
    return result.findings[0];
}

/// Checks that nothing is left to complain about.
void check_good(const Capture& capture, double least_iou = 0.97, const BodyModel& body = scene().body) {
    const CaptureCheck result = check(capture, body);
    CHECK(texts(result) == "");
    CHECK(result.mean_iou().value() > least_iou);
}

vec3<double> flipped(const vec3<double>& v) {
    return {v.x, -v.y, -v.z};
}

/// Applies a change to R and t of all cameras, which the text describes.
void follow(Capture capture, const std::function<void(Camera<double>&)>& change) {
    for (NamedCamera& named : capture.cameras) change(named.camera);
    check_good(capture);
}

Capture with_motion(const std::function<void(Motion&)>& change) {
    return spoiled([&](Capture& capture) { change(capture.motion); });
}

} // namespace

TEST_CASE("remedies for R and t") {
    const auto to_world = [](Camera<double>& c) { // what inverse() makes of it is the text's formula
        const vec3<double> t = -(transpose(c.R) * c.t);
        c.R = transpose(c.R), c.t = t;
    };
    const auto flip_rows = [](Camera<double>& c) {
        for (int k = 0; k < 3; ++k) c.R[k] = flipped(c.R[k]);
        c.t = flipped(c.t);
    };
    const auto given = [](const std::function<void(Camera<double>&)>& change) {
        return with_cameras([&](Camera<double>& c, std::size_t) { change(c); });
    };
    Capture capture = given(to_world);
    (void)finding_of(capture, "camera-to-world", "store R' = transpose(R), t' = -transpose(R) t");
    follow(capture, to_world);

    capture = given(flip_rows);
    (void)finding_of(capture, "opengl-cameras", "negate the second and third row of R and t");
    follow(capture, flip_rows);

    capture = given([&](Camera<double>& c) {
        c.t = c.center(), c.R = transpose(c.R);
        c.R[1] = -c.R[1], c.R[2] = -c.R[2];
    });
    (void)finding_of(capture, "opengl-cameras", "t' = -transpose(R) t, then negate the second and third row of both");
    follow(capture, [&](Camera<double>& c) { to_world(c), flip_rows(c); });

    capture = given([](Camera<double>& c) { c.R = transpose(c.R); });
    (void)finding_of(capture, "transposed-rotation", "store R row by row");
    follow(capture, [](Camera<double>& c) { c.R = transpose(c.R); });

    capture = given([](Camera<double>& c) { c.t = c.center(); });
    (void)finding_of(capture, "camera-position", "store t' = -R t");
    follow(capture, [](Camera<double>& c) { c.t = -(c.R * c.t); });

    capture = given([](Camera<double>& c) { c.t *= 1000; });
    (void)finding_of(capture, "camera-units", "store t in metres");
    follow(capture, [](Camera<double>& c) { c.t *= 0.001; });

    capture = given([&](Camera<double>& c) { to_world(c), c.t *= 100; });
    (void)finding_of(capture, "camera-to-world", "; t in metres");
    follow(capture, [&](Camera<double>& c) { c.t *= 0.01, to_world(c); });
}

TEST_CASE("remedies for K: the numbers that the text names, all of them") {
    Capture capture = with_cameras([](Camera<double>& c, std::size_t) {
        c.fx *= 2, c.fy *= 2, c.cx *= 2, c.cy *= 2; // of images of twice the size
    });
    std::string text = finding_of(capture, "other-resolution", "K is for images of another size").text;
    const auto store = [&](Capture& of, const std::string& from, const std::vector<std::string>& fields) {
        for (NamedCamera& named : of.cameras) {
            Camera<double>& c = named.camera;
            const auto at = of.cameras.size() == 1 ? text.find("store") : text.find(named.name + " store");
            if (at == std::string::npos) continue; // no fault of this camera
            for (const std::string& field : fields)
                (field == "fx"   ? c.fx
                 : field == "fy" ? c.fy
                 : field == "cx" ? c.cx
                                 : c.cy) = number_after(text, field + " ", at);
        }
        (void)from;
    };
    store(capture, text, {"fx", "fy", "cx", "cy"});
    check_good(capture, 0.93); // the factor brings the principal point to the middle

    capture = with_cameras([](Camera<double>& c, std::size_t k) { c.cx += 6.0 + double(k), c.cy -= 4; });
    text = finding_of(capture, "principal-point", "store cx").text;
    store(capture, text, {"cx", "cy"});
    check_good(capture);

    capture = with_cameras([](Camera<double>& c, std::size_t) { c.fx *= 1.15, c.fy *= 1.15; });
    text = finding_of(capture, "focal-length", "store fx").text;
    store(capture, text, {"fx", "fy"});
    check_good(capture, 0.95);
}

TEST_CASE("remedies for poses") {
    Capture capture = with_motion([](Motion& m) { exchange_sides(m, true); });
    (void)finding_of(capture, "mirrored-poses",
                     "exchange left and right joints, and negate y and z of each rotation but global_orient");
    const auto counterparts = joint_counterparts(scene().body);
    const auto exchanged = [&](Motion motion, bool negate) {
        const auto given = motion.pose;
        for (std::size_t t = 0; t < motion.frame_count(); ++t)
            for (std::size_t j = 1; j < motion.joint_count; ++j) { // all but global_orient
                const vec3<double> v = given[t * motion.joint_count + static_cast<std::size_t>(counterparts[j])];
                motion.pose[t * motion.joint_count + j] = negate ? flipped(v) : v;
            }
        return motion;
    };
    capture.motion = exchanged(capture.motion, true);
    check_good(capture);

    capture = with_motion([](Motion& m) { exchange_sides(m, false); });
    (void)finding_of(capture, "mirrored-poses", "list the joints in the body's order, left before right");
    capture.motion = exchanged(capture.motion, false);
    check_good(capture);

    capture = with_motion(write_degrees);
    (void)finding_of(capture, "degrees", "store axis-angle in radians");
    for (auto& v : capture.motion.pose) v *= std::numbers::pi / 180;
    check_good(capture);

    capture = with_motion([](Motion& m) { write_units(m, 1000); });
    (void)finding_of(capture, "translation-units", "store transl in metres");
    write_units(capture.motion, 0.001);
    check_good(capture);

    const vec3<double> J0 = resting_root(scene().capture.motion);
    capture = with_motion([&](Motion& m) { displace(m, J0); });
    (void)finding_of(capture, "translation-origin", "store transl' = transl - J0");
    displace(capture.motion, -J0);
    check_good(capture);

    const auto turned_root = [&](const Motion& m, std::size_t t) {
        return rotation_from_axis_angle(m.pose[t * m.joint_count]) * J0;
    };
    capture = with_motion([&](Motion& m) { // about the origin, as EasyMocap turns bodies; far from it
        for (std::size_t t = 0; t < m.frame_count(); ++t) m.transl[t] += J0 - turned_root(m, t);
    });
    (void)finding_of(capture, "translation-origin", "store transl' = transl + R J0 - J0");
    for (std::size_t t = 0; t < capture.frame_count(); ++t)
        capture.motion.transl[t] += turned_root(capture.motion, t) - J0;
    check_good(capture);

    capture = with_motion([](Motion& m) { displace(m, {0.05, 0.1, -0.06}); });
    const std::string moved = finding_of(capture, "displaced-body", "add it to transl").text;
    const auto at = moved.find("moved by (");
    const double x = number_after(moved, "(", at), y = number_after(moved, ", ", at);
    const double z = number_after(moved, ", ", moved.find(", ", at) + 2);
    displace(capture.motion, {x, y, z});
    check_good(capture, 0.95);
}

TEST_CASE("the remedy for a world with another axis upwards is a formula that holds") {
    using World = MotionReading::World;
    for (const auto& [world, words] :
         {std::pair(World::z_up, "(x, y, z) to (x, z, -y)"), std::pair(World::minus_z_up, "(x, y, z) to (x, -z, y)"),
          std::pair(World::y_down, "(x, y, z) to (x, -y, -z)")}) {
        const auto turn = [&, world = world](const vec3<double>& p) {
            return world == World::z_up         ? vec3<double>(p.x, p.z, -p.y)
                   : world == World::minus_z_up ? vec3<double>(p.x, -p.z, p.y)
                                                : vec3<double>(p.x, -p.y, -p.z);
        };
        const mat3<double> W(turn({1, 0, 0}), turn({0, 1, 0}), turn({0, 0, 1}));
        const auto apply = [&](Motion& m, const mat3<double>& by) {
            const vec3<double> J0 = resting_root(m);
            for (std::size_t t = 0; t < m.frame_count(); ++t) {
                vec3<double>& root = m.pose[t * m.joint_count];
                root = axis_angle_from_rotation(by * rotation_from_axis_angle(root));
                m.transl[t] = by * (m.transl[t] + J0) - J0;
            }
        };
        Capture capture = with_motion([&](Motion& m) { apply(m, transpose(W)); });
        const std::string text = finding_of(capture, "world-axes", words).text;
        CHECK(text == test::contains("global_orient' = W global_orient, transl' = W (transl + J0) - J0"));
        apply(capture.motion, W);
        check_good(capture);
    }
}

TEST_CASE("remedies for the body's size") {
    Capture capture = scene().capture;
    capture.motion.betas = {2.0};
    capture = film_boxes(scene().body, capture.motion);
    capture.motion.betas = {0.0};
    (void)finding_of(capture, "body-size", "betas are all zero: store the person's");
    capture.motion.betas = {2.0};
    check_good(capture);

    BodyModel body = scene().body;
    for (auto& v : body.v_template) v *= 1000.0;
    for (auto& v : body.shapedirs) v *= 1000.0;
    (void)finding_of(scene().capture, "body-size", "store v_template, shapedirs and posedirs in metres", body);
    for (auto& v : body.v_template) v *= 0.001;
    for (auto& v : body.shapedirs) v *= 0.001;
    check_good(scene().capture, 0.97, body);
}

TEST_CASE("remedies for hands: flat_hand as the text says, in the file") {
    const test::Temporary folder;
    for (const auto& [times, words] : {std::pair(-1.0, "store flat_hand = 0"), std::pair(1.0, "store flat_hand = 1")}) {
        const double by = times;
        Capture capture = spoiled([by](Capture& c) { add_mean_hands(c.motion, by); });
        (void)finding_of(capture, times < 0 ? "mean-hand-missing" : "mean-hand-twice", words);
        // The faulty file has the other value: whole hands said to count from the mean hand, or the reverse.
        Motion stored = capture.motion;
        if (times > 0) { // the reader added the mean hand to whole hands
            for (std::size_t t = 0; t < stored.frame_count(); ++t)
                for (std::size_t k = 0; k < 15; ++k) {
                    stored.pose[t * 55 + 25 + k] -= scene().body.hands_mean_left[k];
                    stored.pose[t * 55 + 40 + k] -= scene().body.hands_mean_right[k];
                }
        }
        save_motion(folder / "poses.npz", stored); // flat_hand = 1
        MotionFileOptions options;
        using Hands = MotionFileOptions::Hands;
        options.hands = times > 0 ? Hands::flat : Hands::add_mean;
        capture.motion = load_motion(folder / "poses.npz", scene().body, options);
        check_good(capture);
    }
}

TEST_CASE("remedies for the order of frames") {
    const auto shows = [](const std::function<std::size_t(std::size_t)>& pose_of) {
        return spoiled([&](Capture& c) {
            const Capture good = c;
            for (std::size_t k = 0; k < c.cameras.size(); ++k)
                for (std::size_t f = 0; f < 12; ++f) c.images[k * 12 + f] = good.images[k * 12 + pose_of(f)];
        });
    };
    Capture capture = shows([](std::size_t f) { return 11 - f; });
    (void)finding_of(capture, "frame-order", "reverse the poses or the images");
    for (std::size_t k = 0; k < 3; ++k)
        std::reverse(capture.images.begin() + static_cast<std::ptrdiff_t>(12 * k),
                     capture.images.begin() + static_cast<std::ptrdiff_t>(12 * k + 12));
    check_good(capture);

    std::vector<std::string> names; // unpadded, in the order in which a folder lists them
    for (std::size_t f = 1; f <= 12; ++f) names.push_back(std::to_string(f));
    std::sort(names.begin(), names.end());
    const auto number = [&](std::size_t f) { return std::stoul(names[f]) - 1; };
    capture = shows([&](std::size_t f) { return number(f); });
    (void)finding_of(capture, "frame-order", "pad the images' numbers with zeros");
    const Capture listed = capture;
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t f = 0; f < 12; ++f) capture.images[k * 12 + number(f)] = listed.images[k * 12 + f];
    check_good(capture);

    capture = shows([](std::size_t f) { return std::min<std::size_t>(f + 1, 11); });
    const CaptureCheck late = check(capture);
    REQUIRE(!late.findings.empty());
    CHECK(late.findings[0].text == test::contains("pair image n with pose n + 1"));
    Capture paired = capture; // the last image has no pose, and the first pose no image
    paired.images.clear();
    for (std::size_t k = 0; k < 3; ++k)
        for (std::size_t f = 0; f < 11; ++f) paired.images.push_back(capture.images[k * 12 + f]);
    Motion& m = paired.motion;
    m.pose.erase(m.pose.begin(), m.pose.begin() + static_cast<std::ptrdiff_t>(m.joint_count));
    m.transl.erase(m.transl.begin());
    m.timestamps.erase(m.timestamps.begin());
    check_good(paired);
}

TEST_CASE("remedies for images and masks, in files") {
    const test::Temporary folder;
    cpu::Threads threads(2);
    const auto again = [&](const Capture& capture) {
        save_capture(folder / "capture", capture);
        return load_capture(threads, folder / "capture", scene().body);
    };
    Capture capture = spoiled([](Capture& c) {
        for (auto& image : c.images) invert(image);
    });
    (void)finding_of(capture, "inverted-masks", "255 on the person, 0 elsewhere");
    for (auto& image : capture.images) invert(image);
    check_good(again(capture));

    capture = spoiled([](Capture& c) {
        for (auto& image : c.images) mirror(image);
    });
    (void)finding_of(capture, "mirrored-images", "flip images and masks back");
    for (auto& image : capture.images) mirror(image);
    check_good(again(capture));

    // An image that shows nobody: reading it again leaves it out, and so does an empty mask where a pose failed.
    capture = spoiled([](Capture& c) { c.images[14] = PixelImage(4, photo_size, photo_size); });
    (void)finding_of(capture, "empty-masks", "training leaves these images out; segment them again");
    Capture read = again(capture);
    CHECK(!read.is_taken({1, 2}));
    check_good(read);
    capture.images[14] = scene().capture.images[14];
    check_good(again(capture));

    capture = spoiled([](Capture& c) { std::swap(c.images[2], c.images[7]); });
    const CaptureFinding single =
        finding_of(capture, "single-images", "leave them out with an empty mask (black, or alpha 0 everywhere)");
    CHECK(single.views.size() == 2);
    for (const CaptureView& view : single.views) capture.image(view) = PixelImage(4, photo_size, photo_size);
    read = again(capture);
    CHECK(!read.is_taken(single.views[0]));
    check_good(read);

    // A person who is out of view has an empty mask, and that is no fault.
    capture = scene().capture;
    for (std::size_t k = 0; k < 3; ++k) {
        capture.motion.transl[5] = {0, 100, 0};
        capture.images[k * 12 + 5] = PixelImage(4, photo_size, photo_size);
    }
    CHECK(texts(check(capture)) == "");
    CHECK(texts(check(again(capture))) == "");
}
