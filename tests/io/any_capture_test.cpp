// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/any_capture.hpp>

#include "io/npz_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"

#include <gsh/backend/serial.hpp>

#include <string>
#include <vector>

using namespace gsh;

namespace {

Motion still(const BodyModel& body, std::size_t frames) {
    Motion motion;
    motion.joint_count = body.joint_count(), motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas.assign(static_cast<std::size_t>(body.shape_count), 0);
    motion.pose.assign(frames * body.joint_count(), vec3<double>(0.1, 0, 0));
    motion.expression.assign(frames * motion.expression_count, 0);
    motion.transl.assign(frames, vec3<double>(0, -0.8, 4));
    for (std::size_t t = 0; t < frames; ++t) motion.timestamps.push_back(static_cast<double>(t));
    return motion;
}

} // namespace

TEST_CASE("captures are known by their files, and our own come back") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(24, 3, 0);
    cpu::Serial serial;
    Capture capture;
    NamedCamera camera;
    camera.name = "front";
    camera.camera.fx = camera.camera.fy = 20, camera.camera.cx = 8, camera.camera.cy = 8,
    camera.camera.width = camera.camera.height = 16;
    capture.cameras = {camera};
    capture.motion = still(body, 2);
    capture.images.assign(2, PixelImage(4, 16, 16));
    for (PixelImage& image : capture.images) std::fill(image.data.begin(), image.data.end(), std::uint8_t(255));
    save_capture(folder / "ours", capture);
    CHECK(recognise_capture(folder / "ours") == CaptureLayout::gsh);
    const AnyCapture any = load_any_capture(serial, folder / "ours", &body);
    CHECK(any.layout == CaptureLayout::gsh);
    CHECK(any.capture.motion.pose == capture.motion.pose);
    CHECK(any.people.size() == 1);
    CHECK(!any.rig);
    test::check_throws<IoError>([&] { (void)load_any_capture(serial, folder / "ours", nullptr); },
                                {"ours", "body model"});
    CHECK(load_any_motion(folder / "ours", body).pose == capture.motion.pose); // a capture's own motion

    for (const char* name : {"a", "b/camera", "b/pose", "c", "d"}) std::filesystem::create_directories(folder / name);
    test::write_text(folder / "a/cameras.npz", "");
    test::write_text(folder / "c/intri.yml", "");
    CHECK(recognise_capture(folder / "a") == CaptureLayout::people_snapshot);
    CHECK(recognise_capture(folder / "b") == CaptureLayout::gala);
    CHECK(recognise_capture(folder / "c") == CaptureLayout::easymocap);
    CHECK(!recognise_capture(folder / "d"));
    test::check_throws<IoError>([&] { (void)load_any_capture(serial, folder / "b", nullptr); },
                                {"model/mesh.txt", "GalaBasketball"});
    for (const char* name : {"a", "c", "d", "none"})
        test::check_throws<IoError>([&] { (void)load_any_capture(serial, folder / name, &body); },
                                    {(folder / name).string()});
    test::check_throws<IoError>([&] { (void)load_any_capture(serial, folder / "d", &body); },
                                {"cameras.json", "is missing", "PeopleSnapshot"});
}

TEST_CASE("motions are known by their members or their folder") {
    const test::Temporary folder;
    const BodyModel body = test::small_body(24, 3, 0), smplx = test::small_body(55, 3, 2);
    const auto write = [&](const char* name, const std::vector<std::pair<const char*, std::size_t>>& members) {
        NpzWriter file(folder / name);
        for (const auto& [key, width] : members) file.add(key, std::vector<double>(2 * width, 0.125), {2, width});
        file.add("betas", std::vector<double>(3, 0.0));
        file.commit();
        return folder / name;
    };
    const auto amass = write("amass.npz", {{"poses", 72}, {"trans", 3}});
    CHECK(recognise_motion(amass) == MotionLayout::amass);
    CHECK(load_any_motion(amass, body).pose[3].x == 0.125);
    const auto split = write("split.npz", {{"root_orient", 3}, {"pose_body", 63}, {"trans", 3}});
    CHECK(recognise_motion(split) == MotionLayout::amass);
    CHECK(load_any_motion(split, smplx).pose[3].x == 0.125);
    const auto snapshot = write("snapshot.npz", {{"thetas", 72}, {"transl", 3}});
    CHECK(recognise_motion(snapshot) == MotionLayout::snapshot);
    CHECK(load_any_motion(snapshot, body).timestamps[1] == doctest::Approx(1 / 30.0));
    const auto fits = write("fits.npz", {{"global_orient", 3}, {"body_pose", 63}, {"camera_translation", 3}});
    CHECK(recognise_motion(fits) == MotionLayout::smplifyx);
    CHECK(load_any_motion(fits, smplx).transl[0].x == doctest::Approx(0.125));
    save_motion(folder / "ours.npz", still(body, 3));
    CHECK(recognise_motion(folder / "ours.npz") == MotionLayout::gsh);
    CHECK(load_any_motion(folder / "ours.npz", body).pose == still(body, 3).pose);

    const detail::Json none = detail::Json::array({0, 0, 0}), person = {{"id", 0},
                                                                        {"Rh", none},
                                                                        {"Th", none},
                                                                        {"poses", std::vector<double>(72, 0.0)},
                                                                        {"shapes", none}};
    std::filesystem::create_directories(folder / "easymocap");
    test::write_text(folder / "easymocap/000000.json", detail::Json::array({person}).dump());
    CHECK(recognise_motion(folder / "easymocap") == MotionLayout::easymocap);
    CHECK(load_any_motion(folder / "easymocap", body).frame_count() == 1);
    std::filesystem::create_directories(folder / "lhm");
    const detail::Json frame = {
        {"root_pose", none}, {"body_pose", std::vector<double>(63, 0.0)}, {"trans", none}, {"betas", none}};
    test::write_text(folder / "lhm/00001.json", frame.dump());
    CHECK(recognise_motion(folder / "lhm") == MotionLayout::smplx_json);
    CHECK(load_any_motion(folder / "lhm", smplx).frame_count() == 1);
    std::filesystem::create_directories(folder / "gala/pose");
    test::write_text(folder / "gala/pose/0000.txt", "0,0,0\n");
    CHECK(recognise_motion(folder / "gala") == MotionLayout::gala);
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "gala", body); }, {"model/jointParent.txt"});
    std::filesystem::create_directories(folder / "empty");
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "empty", body); }, {"empty", "no motion"});
    test::check_throws<IoError>([&] { (void)load_any_motion(folder / "none.npz", body); }, {"none.npz"});
}
