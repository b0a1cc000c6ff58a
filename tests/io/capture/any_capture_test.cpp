// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/any_capture.hpp>

#include "io/npz_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"

#include <gsh/backend/serial.hpp>

#include <string>
#include <vector>

using namespace gsh;

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
    capture.motion = test::still_motion(body, 2);
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
    CHECK(load_any_motion(folder / "ours", body).pose == capture.motion.pose); // the motion of the capture itself

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
