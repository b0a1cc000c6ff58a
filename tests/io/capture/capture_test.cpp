// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/capture.hpp>

#include "io/exif_files.hpp"
#include "io/small_body.hpp"
#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/skip.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/io/capture/photos.hpp>
#include <gsh/io/file/npz.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr std::size_t capture_frames = 3;

Camera<double> front_camera(double turn) {
    const double c = std::cos(turn), s = std::sin(turn);
    Camera<double> camera;
    camera.R = mat3<double>(vec3<double>(c, 0, s), vec3<double>(0, -1, 0), vec3<double>(s, 0, -c)); // columns
    camera.t = {0, 1.3, 5};
    camera.fx = 100, camera.fy = 101, camera.cx = 33, camera.cy = 30;
    camera.width = 64, camera.height = 60;
    return camera;
}

/// A person of 55 joints in a column, seen by two training cameras and one test camera.
Capture make_capture(const BodyModel& body) {
    Capture capture;
    test::Rng rng(4);
    for (int i = 0; i < 3; ++i) {
        NamedCamera camera;
        camera.name = "cam" + std::to_string(i);
        camera.role = i == 2 ? NamedCamera::Role::test : NamedCamera::Role::train;
        camera.camera = front_camera(0.4 * i);
        capture.cameras.push_back(camera);
    }
    capture.fps = 10;
    capture.floor_y = 0;
    Motion& motion = capture.motion;
    motion.joint_count = body.joint_count(), motion.expression_count = static_cast<std::size_t>(body.expression_count);
    motion.betas.assign(static_cast<std::size_t>(body.shape_count), 0.1);
    motion.pose = rng.vecs(capture_frames * body.joint_count(), -0.01, 0.01);
    motion.expression.assign(capture_frames * motion.expression_count, 0.0);
    for (std::size_t f = 0; f < capture_frames; ++f) {
        motion.transl.emplace_back(0.05 * static_cast<double>(f), 0, 0);
        motion.timestamps.push_back(0.1 * static_cast<double>(f));
    }
    for (const NamedCamera& camera : capture.cameras)
        for (std::size_t f = 0; f < capture_frames; ++f) {
            PixelImage image(4, camera.camera.height, camera.camera.width);
            for (const auto& point : detail::bone_points(body, motion, f)) {
                const vec2<double> p = to_pixel(camera.camera, to_camera(camera.camera, point));
                for (int y = std::max(0, int(p.y) - 2); y <= std::min(image.height - 1, int(p.y) + 2); ++y)
                    for (int x = std::max(0, int(p.x) - 2); x <= std::min(image.width - 1, int(p.x) + 2); ++x) {
                        image.pixel(y, x)[0] = static_cast<std::uint8_t>(100 + 10 * f);
                        image.pixel(y, x)[3] = 255;
                    }
            }
            capture.images.push_back(image);
        }
    return capture;
}

struct StoredCapture {
    test::Temporary folder;
    BodyModel body = test::small_body(55, 3, 2);
    Capture capture = make_capture(body);
    std::filesystem::path path = folder / "person";
    cpu::Serial serial;

    StoredCapture() { save_capture(path, capture); }
    [[nodiscard]] Capture load(std::vector<std::string>* warnings = nullptr) {
        return load_capture(serial, path, body, {}, warnings);
    }
    [[nodiscard]] std::string only_warning() {
        std::vector<std::string> warnings;
        (void)load(&warnings);
        REQUIRE(!warnings.empty());
        CHECK(warnings[0].find(path.string()) == 0);
        return warnings[0];
    }
    [[nodiscard]] std::string image(int camera, int frame) const {
        return (path / "images" / ("cam" + std::to_string(camera)) / ("000" + std::to_string(frame) + ".png")).string();
    }
};

} // namespace

TEST_CASE_FIXTURE(StoredCapture, "a capture comes back as it was saved, on any number of threads") {
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    CHECK(warnings.empty());
    CHECK(read.name == "person");
    REQUIRE(read.cameras.size() == 3);
    CHECK(read.cameras[1].name == "cam1");
    CHECK(read.fps == 10);
    CHECK(read.floor_y == 0.0);
    CHECK(read.motion.pose == capture.motion.pose);
    REQUIRE(read.images.size() == 9);
    for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data == capture.images[i].data);
    CHECK(read.views(false).size() == 6);
    CHECK(read.views(true).size() == 3);
    CHECK(read.is_test({2, 0}));
    CHECK(!read.is_test({1, 2}));
    for (const std::size_t count : {1, 2, 3, 7}) {
        cpu::Threads threads(count);
        const Capture other = load_capture(threads, path, body);
        for (std::size_t i = 0; i < 9; ++i) CHECK(other.images[i].data == read.images[i].data);
    }
}

TEST_CASE_FIXTURE(StoredCapture, "images that take more than the memory for them are read when they are needed") {
    constexpr std::uint64_t bytes = 9 * 64 * 60 * 4;
    // Masks of 0 and 1, a hidden pixel, a camera with distortion, a missing mask and an empty one.
    for (int c = 0; c < 3; ++c)
        for (int f = 0; f < 3; ++f) {
            PixelImage mask(1, 60, 64);
            const PixelImage& taken = capture.images[static_cast<std::size_t>(3 * c + f)];
            for (std::size_t i = 0; i < mask.data.size(); ++i)
                mask.data[i] = taken.data[4 * i + 3] == 0 || (c == 0 && f == 2) ? 0 : c == 1 ? 1 : 255;
            const auto place = path / "masks" / ("cam" + std::to_string(c));
            std::filesystem::create_directories(place);
            if (c != 0 || f != 1) write_png(place / ("000" + std::to_string(f) + ".png"), mask);
        }
    capture.cameras[1].distortion.emplace();
    capture.cameras[1].distortion->k1 = 0.1;
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
    std::filesystem::create_directories(path / "hidden/cam2");
    PixelImage hidden(1, 60, 64);
    hidden.pixel(20, 30)[0] = 255;
    write_png(path / "hidden/cam2/0001.png", hidden);

    std::vector<std::string> warnings, others;
    const Capture held = load(&warnings);
    CHECK(!held.stored);
    cpu::Threads threads(3);
    const Capture read = load_capture(threads, path, body, {.image_memory = bytes - 64 * 60 * 4 - 1}, &others);
    REQUIRE(read.stored);
    CHECK(read.images.empty());
    CHECK(others == warnings);
    CHECK(warnings.size() >= 3); // small numbers, a missing mask, an empty one
    CHECK(!load_capture(serial, path, body, {.image_memory = bytes - 64 * 60 * 4}).stored); // one is missing
    for (const bool test : {false, true}) {
        const std::vector<Photo> photos = photos_of(held, test), stored = photos_of(read, test);
        REQUIRE(photos.size() == stored.size());
        for (std::size_t k = 0; k < photos.size(); ++k) {
            const CaptureView view{photos[k].camera_index, photos[k].frame};
            CAPTURE(photos[k].name);
            CHECK(read.read_image(view).data == held.image(view).data);
            CHECK(read.shows_person(view));
            const StoredImages::Facts& facts = read.stored->facts[read.index(view)];
            CHECK(facts.mask == box_of_mask(photos[k].rgba, 60, 64));
            CHECK(facts.half_chroma == has_half_chroma(photos[k].rgba, 60, 64));
            CHECK(stored[k].name == photos[k].name);
            Photo cropped = photos[k];
            const std::vector<std::uint8_t> pixels = crop_photo(cropped);
            for (int time = 0; time < 2; ++time) { // of the file, then of what is kept
                const HeldPhoto one(stored[k]);
                CHECK(std::vector<std::uint8_t>(one->rgba.begin(), one->rgba.end()) == pixels);
                CHECK(one->box == cropped.box);
                CHECK(one->unknown.size() == (view.camera == 2 && view.frame == 1 ? 1 : 0));
            }
        }
    }
    const StoredPhotos shared(read, 0, 10'000); // several threads read, and keep some
    std::vector<PhotoContents> contents(9), again(9);
    for (auto* into : {&contents, &again})
        threads.for_chunks(9, 1, [&](std::size_t, std::size_t begin, std::size_t end) {
            for (std::size_t i = begin; i < end; ++i)
                if (read.stored->facts[i].taken) (*into)[i] = shared.read(i);
        });
    for (std::size_t i = 0; i < 9; ++i) CHECK(contents[i].rgba == again[i].rgba);
    save_capture(folder / "again", read);
    CHECK(load_capture(serial, folder / "again", body).image({1, 1}).data == held.image({1, 1}).data);

    // A file that is lost later is told by its name; a photograph that was kept is not read again.
    StoredPhotos kept(read, 0, std::uint64_t(1) << 20), none(read, 0, 0);
    const std::size_t index = read.index({0, 0});
    (void)kept.read(index), (void)none.read(index);
    std::filesystem::remove(image(0, 0));
    CHECK(kept.read(index).box == read.stored->facts[index].mask);
    test::check_throws<IoError>([&] { (void)none.read(index); }, {image(0, 0)});
}

TEST_CASE_FIXTURE(StoredCapture, "so many photographs are kept as fit, those that were read first") {
    const Capture read = load_capture(serial, path, body, {.image_memory = 1});
    StoredPhotos photos(read, 0, 0);
    const auto bytes = [&](std::size_t index) { return photos.read(index).rgba.size() + sizeof(PhotoContents); };
    const std::uint64_t two = bytes(3) + bytes(4);
    photos.keep_within(two);
    for (const std::size_t index : {4, 3, 5}) (void)photos.read(index);
    std::filesystem::remove_all(path / "images");
    CHECK_NOTHROW((void)photos.read(3));
    CHECK_NOTHROW((void)photos.read(4));
    CHECK_THROWS_AS((void)photos.read(5), IoError);
}

TEST_CASE_FIXTURE(StoredCapture, "test frames leave training in every camera") {
    capture.test_frames = {1};
    capture.cameras[2].role = NamedCamera::Role::train;
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, capture.test_frames});
    const Capture read = load();
    CHECK(read.views(false).size() == 6);
    CHECK(read.views(true).size() == 3);
    CHECK(read.views(true)[1].camera == 1);
    CHECK(read.views(true)[1].frame == 1);
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {3}});
    test::check_throws<ValueError>([&] { (void)load(); }, {"cameras.json", "test_frames holds 3", "below 3"});
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {0, 1, 2}});
    test::check_throws<ValueError>([&] { (void)load(); }, {"cameras.json", "no view", "training"});
}

TEST_CASE_FIXTURE(StoredCapture, "a span of the motion leaves training in every camera; test cameras judge it") {
    using Places = std::vector<std::pair<std::size_t, std::size_t>>; // camera, frame
    const auto places = [](const Capture& of, bool test) {
        Places found;
        for (const Photo& photo : photos_of(of, test)) found.emplace_back(photo.camera_index, photo.frame);
        return found;
    };
    const Capture read = load_capture(serial, path, body, {.hold_out = MotionSpan{.share = 0.3}});
    CHECK(read.held_out_frames == std::vector<std::size_t>{2});
    CHECK(places(read, false) == Places{{0, 0}, {0, 1}, {1, 0}, {1, 1}});
    CHECK(places(read, true) == Places{{2, 0}, {2, 1}, {2, 2}});
    CHECK(load().held_out_frames.empty());

    // Frames in another order than their times: frame 0 is the last one.
    Capture other = capture;
    other.motion.timestamps = {0.3, 0.1, 0.2};
    hold_out_motion(other, {.share = 0.6});
    CHECK(other.held_out_frames == std::vector<std::size_t>{0, 2});
    CHECK(places(other, false) == Places{{0, 1}, {1, 1}});
    hold_out_motion(other, {.first = 1, .last = 2}); // in place of the other span
    CHECK(other.held_out_frames == std::vector<std::size_t>{1, 2});
    CHECK(places(other, false) == Places{{0, 0}, {1, 0}});

    // Test frames stay what they are; training cameras judge the span only if no camera is for the test.
    hold_out_motion(other, {.first = 0, .last = 0});
    other.test_frames = {1};
    CHECK(places(other, false) == Places{{0, 2}, {1, 2}});
    CHECK(places(other, true) == Places{{0, 1}, {1, 1}, {2, 0}, {2, 1}, {2, 2}});
    other.cameras[2].role = NamedCamera::Role::train;
    CHECK(places(other, false) == Places{{0, 2}, {1, 2}, {2, 2}});
    CHECK(places(other, true) == Places{{0, 0}, {0, 1}, {1, 0}, {1, 1}, {2, 0}, {2, 1}});

    other.test_frames = {1, 2};
    test::check_throws<ValueError>([&] { hold_out_motion(other, {.first = 0, .last = 0, .name = "the span"}); },
                                   {"the span", "no view for training"});
    test::check_throws<ValueError>(
        [&] { (void)load_capture(serial, path, body, {.hold_out = MotionSpan{.last = 3, .name = "the span"}}); },
        {"the span", "frame 3 of 3 frames"});
}

TEST_CASE("the last quarter of a capture with six cameras leaves no photograph for training") {
    const std::filesystem::path folder =
        std::filesystem::path(GSH_SOURCE_DIR).parent_path() / "shared/data/captures/A_multi";
    if (test::skip_without({folder / "cameras.json", folder / "poses.npz"})) return;
    Capture capture; // without its images: all count as taken
    capture.cameras = read_cameras(folder / "cameras.json").cameras;
    capture.motion.timestamps = NpzReader(folder / "poses.npz").read<double>("timestamps", {-1}, Numbers::any).data;
    capture.motion.transl.resize(capture.motion.timestamps.size(), vec3<double>(0));
    hold_out_motion(capture, {.share = 0.25});
    CHECK(capture.held_out_frames == std::vector<std::size_t>{22, 23, 24, 25, 26, 27, 28, 29});
    CHECK(capture.views(false).size() == 6 * 22);
    for (const CaptureView& view : capture.views(false)) CHECK(view.frame < 22);
    CHECK(capture.views(true).size() == 30);
}

TEST_CASE_FIXTURE(StoredCapture, "poses of another name, in the folder or elsewhere") {
    Motion noisy = capture.motion;
    noisy.transl[0].x += 0.125;
    save_motion(path / "poses_noisy.npz", noisy);
    CHECK(load_capture(serial, path, body, {"poses_noisy.npz", {}}).motion.transl[0].x == 0.125);
    save_motion(folder / "else.npz", noisy);
    CHECK(load_capture(serial, path, body, {(folder / "else.npz").string(), {}}).motion.transl[0].x == 0.125);
}

TEST_CASE_FIXTURE(StoredCapture, "poses without times: the rate of the caller, of cameras.json, or 30 with a warning") {
    NpzWriter file(path / "untimed.npz");
    for (const auto& [key, width] : {std::pair<const char*, std::size_t>{"global_orient", 3},
                                     {"body_pose", 63},
                                     {"jaw_pose", 3},
                                     {"leye_pose", 3},
                                     {"reye_pose", 3},
                                     {"left_hand_pose", 45},
                                     {"right_hand_pose", 45},
                                     {"transl", 3}})
        file.add(key, std::vector<double>(capture_frames * width), {capture_frames, width});
    file.add("betas", std::vector<double>(3));
    file.add("flat_hand", std::uint8_t(1));
    file.commit();
    const auto seconds = [&](double input_fps, std::size_t expected) {
        CaptureOptions options;
        options.poses = "untimed.npz", options.input_fps = input_fps;
        std::vector<std::string> warnings;
        const Capture read = load_capture(serial, path, body, options, &warnings);
        std::size_t count = 0;
        for (const std::string& warning : warnings) count += warning.find("frames per second") != std::string::npos;
        CHECK(count == expected);
        return read.motion.timestamps[2];
    };
    CHECK(seconds(0, 0) == doctest::Approx(0.2)); // fps of cameras.json
    CHECK(seconds(50, 0) == doctest::Approx(0.04));
    write_cameras(path / "cameras.json", {capture.cameras, 0, capture.floor_y, capture.test_frames});
    CHECK(seconds(0, 1) == doctest::Approx(2 / 30.0));
    CHECK(seconds(50, 0) == doctest::Approx(0.04));
}

TEST_CASE_FIXTURE(StoredCapture, "masks from a folder of their own replace alpha") {
    for (int c = 0; c < 3; ++c) {
        std::filesystem::create_directories(path / "masks" / ("cam" + std::to_string(c)));
        for (int f = 0; f < 3; ++f) {
            PixelImage mask(1, 60, 64);
            for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = static_cast<std::uint8_t>(i % 251);
            write_png(path / "masks" / ("cam" + std::to_string(c)) / ("000" + std::to_string(f) + ".png"), mask);
        }
    }
    const Capture read = load();
    CHECK(int(read.images[4].pixel(1, 7)[3]) == 71);
    CHECK(read.images[4].pixel(1, 7)[0] == capture.images[4].pixel(1, 7)[0]);
}

TEST_CASE_FIXTURE(StoredCapture, "a missing photograph is left out, with a warning, and its frame stays") {
    const auto others_are_theirs = [&](const Capture& read, std::initializer_list<std::size_t> absent) {
        REQUIRE(read.images.size() == 9);
        for (std::size_t i = 0; i < 9; ++i) {
            const bool is_absent = std::find(absent.begin(), absent.end(), i) != absent.end();
            CHECK(read.images[i].data == (is_absent ? std::vector<std::uint8_t>() : capture.images[i].data));
        }
        CHECK(read.motion.pose == capture.motion.pose);
    };
    std::filesystem::remove(image(0, 1)); // in the row
    std::filesystem::remove(image(1, 0)); // the first, which other cameras have
    std::filesystem::remove(image(1, 2)); // the last
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    others_are_theirs(read, {1, 3, 5});
    CHECK(read.views(false).size() == 3);
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == path.string() + ": 3 of 9 photographs are missing and are left out: camera 'cam0' frame 1, "
                                         "camera 'cam1' frame 0, camera 'cam1' frame 2");
    CHECK(read.image_names[0] == "0000");
    CHECK(read.image_names[1].empty());

    // Numbers may begin with 1, and may end longer names.
    for (int c = 0; c < 3; ++c)
        for (const int f : {2, 1, 0})
            if (std::filesystem::exists(image(c, f)))
                std::filesystem::rename(image(c, f), path / "images" / ("cam" + std::to_string(c)) /
                                                         ("img_" + std::to_string(f + 1) + ".png"));
    others_are_theirs(load(), {1, 3, 5});

    // A moment that no camera shows keeps its pose.
    std::filesystem::remove(path / "images/cam1/img_2.png");
    std::filesystem::remove(path / "images/cam2/img_2.png");
    test::check_throws<ShapeError>([&] { (void)load(); }, {"images/cam1", "0 images"});
    write_png(path / "images/cam1/img_3.png", capture.images[5]);
    others_are_theirs(load(), {1, 3, 4, 7});
}

TEST_CASE_FIXTURE(StoredCapture, "what is in front of the person is read, and stored again") {
    std::filesystem::create_directories(path / "hidden/cam1");
    PixelImage white(1, 60, 64);
    for (const std::size_t i : {5u, 64u * 59u + 63u}) white.data[i] = 255;
    write_png(path / "hidden/cam1/0002.png", white);
    const Capture read = load();
    CHECK(read.hidden_in({0, 2}).empty());
    CHECK(read.hidden_in({1, 1}).empty());
    REQUIRE(read.hidden_in({1, 2}).size() == 2);
    CHECK(read.hidden_in({1, 2})[1].index == 64 * 59 + 63);
    CHECK(read.hidden_in({1, 2})[1].hidden == 1);
    CHECK(photos_of(read, false)[5].unknown.data() == read.hidden_in({1, 2}).data());
    save_capture(folder / "copy", read);
    CHECK(load_capture(serial, folder / "copy", body).hidden_in({1, 2}).size() == 2);

    write_png(path / "hidden/cam1/0007.png", white);
    test::check_throws<IoError>([&] { (void)load(); },
                                {"hidden/cam1/0007.png", "no image of this name", "images/cam1"});
    std::filesystem::remove(path / "hidden/cam1/0007.png");
    write_png(path / "hidden/cam1/0001.png", PixelImage(1, 60, 60));
    test::check_throws<ShapeError>([&] { (void)load(); }, {"hidden/cam1/0001.png", "60 x 60", "64 x 60", "'cam1'"});
    std::filesystem::rename(path / "hidden/cam1", path / "hidden/cam7");
    test::check_throws<IoError>([&] { (void)load(); }, {"hidden/cam7", "no camera of this name"});
}

TEST_CASE_FIXTURE(StoredCapture, "a photograph without its mask is left out, with a warning") {
    PixelImage white(1, 60, 64);
    white.data.assign(white.data.size(), 255);
    for (int c = 0; c < 3; ++c) {
        std::filesystem::create_directories(path / "masks" / ("cam" + std::to_string(c)));
        for (int f = 0; f < 3; ++f)
            if (c != 1 || f != 2)
                write_png(path / "masks" / ("cam" + std::to_string(c)) / ("mask" + std::to_string(f) + ".png"), white);
    }
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data.empty() == (i == 5));
    REQUIRE(!warnings.empty());
    CHECK(warnings[0] == path.string() + ": 1 of 9 photographs have no mask and are left out: images/cam1/0002.png");
    for (int c : {0, 1})
        for (int f = 0; f < 3; ++f) std::filesystem::remove(image(c, f));
    write_png(image(0, 0), PixelImage(4, 60, 64)), write_png(image(1, 2), capture.images[5]);
    std::filesystem::remove(path / "masks/cam0/mask0.png");
    test::check_throws<ValueError>([&] { (void)load(); }, {path.string(), "both its image and its mask"});
}

TEST_CASE_FIXTURE(StoredCapture, "files that operating systems add are none of the capture's") {
    const Capture expected = load();
    for (const char* name : {"images/cam0/._0000.png", "images/cam0/.DS_Store", "images/cam1/Thumbs.db",
                             "images/cam1/desktop.ini", "images/cam2/.0003.png"})
        write_file(path / name, "x");
    std::filesystem::create_directories(path / "images/cam0/__MACOSX");
    const Capture read = load();
    for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data == expected.images[i].data);
}

TEST_CASE_FIXTURE(StoredCapture, "a photograph without a person is left out, with a warning, and its frame stays") {
    write_png(image(1, 1), PixelImage(4, 60, 64)); // one of a training camera
    PixelImage faint = capture.images[6];
    for (std::size_t i = 3; i < faint.data.size(); i += 4) faint.data[i] = i % 3 ? 0 : 40;
    write_png(image(2, 0), faint); // one of the test camera, where a network left traces
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    REQUIRE(warnings.size() == 1);
    CHECK(warnings[0] == path.string() + ": 2 of 9 photographs have an empty mask and are left out: "
                                         "images/cam1/0001.png, images/cam2/0000.png");
    CHECK(!read.is_taken({1, 1}));
    CHECK(!read.is_taken({2, 0}));
    CHECK(read.frame_count() == 3);
    CHECK(read.motion.pose == capture.motion.pose);
    CHECK(read.views(false).size() == 5);
    CHECK(read.views(true).size() == 2);
    CHECK(photos_of(read, false).size() == 5);
    const Capture all = load_capture(serial, path, body, {.empty_masks = true});
    CHECK(all.views(false).size() == 6);
    CHECK(all.views(true).size() == 3);

    // It is stored as a picture that is transparent everywhere, and comes back as it was.
    save_capture(folder / "copy", read);
    const Capture copy = load_capture(serial, folder / "copy", body);
    for (std::size_t i = 0; i < 9; ++i) CHECK(copy.images[i].data == read.images[i].data);

    // A frame that no camera shows keeps its pose.
    write_png(image(0, 1), PixelImage(4, 60, 64));
    write_png(image(2, 1), PixelImage(4, 60, 64));
    const Capture gap = load();
    CHECK(gap.views(false).size() == 4);
    CHECK(gap.motion.pose == capture.motion.pose);
}

TEST_CASE_FIXTURE(StoredCapture, "label images: one number is the person, several are refused") {
    const auto write_masks = [&](int camera, const auto& value) {
        const auto place = path / "masks" / ("cam" + std::to_string(camera));
        std::filesystem::create_directories(place);
        for (std::size_t f = 0; f < 3; ++f) {
            PixelImage mask(1, 60, 64);
            const PixelImage& photo = capture.images[static_cast<std::size_t>(camera) * 3 + f];
            for (std::size_t i = 0; i < mask.data.size(); ++i)
                mask.data[i] = photo.data[4 * i + 3] ? static_cast<std::uint8_t>(value(f, i)) : 0;
            write_png(place / ("000" + std::to_string(f) + ".png"), mask);
        }
    };
    for (const int camera : {0, 2}) write_masks(camera, [](std::size_t, std::size_t) { return 255; });
    for (const int label : {1, 128}) {
        write_masks(1, [&](std::size_t, std::size_t) { return label; });
        std::vector<std::string> warnings;
        const Capture read = load(&warnings);
        for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data == capture.images[i].data);
        REQUIRE(warnings.size() == 1);
        CHECK(warnings[0] ==
              test::contains("camera 'cam1' hold 0, " + std::to_string(label) + " instead of 0 and 255"));
    }
    write_masks(1, [](std::size_t f, std::size_t) { return f == 2 ? 2 : 1; });
    test::check_throws<ValueError>([&] { (void)load(); },
                                   {"masks/cam1/0000.png", "camera 'cam1'", "labels 0, 1, 2", "255"});
    // Masks may be soft and faint in single frames.
    write_masks(1, [](std::size_t f, std::size_t i) { return f == 2 ? 130 + i % 90 : 255; });
    CHECK(load().views(false).size() == 6);
    write_masks(1, [](std::size_t, std::size_t i) { return 1 + i % 200; });
    test::check_throws<ValueError>([&] { (void)load(); }, {"masks/cam1/0000.png", "values", "white"});

    // The same holds for alpha.
    std::filesystem::remove_all(path / "masks");
    for (int f = 0; f < 3; ++f) {
        PixelImage photo = capture.images[static_cast<std::size_t>(3 + f)];
        for (std::size_t i = 3; i < photo.data.size(); i += 4) photo.data[i] /= 255;
        write_png(image(1, f), photo);
    }
    const Capture read = load();
    for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data == capture.images[i].data);
}

TEST_CASE_FIXTURE(StoredCapture, "photographs lie as their Exif data state; half a turn is warned of") {
    for (int f = 0; f < 3; ++f) {
        const PixelImage& visible = capture.images[static_cast<std::size_t>(f)];
        write_file(image(0, f),
                   test::with_exif(encode_png(test::stored_lying(visible, 3 + f)), test::orientation_tiff(3 + f)));
    }
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    for (std::size_t i = 0; i < 9; ++i) CHECK(read.images[i].data == capture.images[i].data);
    REQUIRE(warnings.size() == 1); // orientation 5 shows in the size
    CHECK(warnings[0] == test::contains("2 of 9 photographs were turned"));
    CHECK(warnings[0] == test::contains("images/cam0/0000.png, images/cam0/0001.png"));

    // Plates are turned, too.
    for (int c = 0; c < 3; ++c) {
        PixelImage plate(3, 60, 64);
        for (std::size_t i = 0; i < plate.data.size(); ++i) plate.data[i] = static_cast<std::uint8_t>(i % 253);
        std::filesystem::create_directories(path / "backgrounds");
        write_file(path / ("backgrounds/cam" + std::to_string(c) + ".png"),
                   test::with_exif(encode_png(test::stored_lying(plate, 6)), test::orientation_tiff(6)));
    }
    const Capture plated = load();
    CHECK(plated.background(1)->width == 64);
    CHECK(int(plated.background(1)->pixel(1, 2)[1]) == (64 * 3 + 2 * 3 + 1) % 253);
}

TEST_CASE_FIXTURE(StoredCapture, "backgrounds are opaque, one per camera, and make a whole photograph no mistake") {
    for (PixelImage& image : capture.images)
        for (std::size_t i = 3; i < image.data.size(); i += 4) image.data[i] = 255;
    save_capture(path, capture);
    CHECK(only_warning() == test::contains("without a mask"));
    for (int c = 0; c < 3; ++c) {
        PixelImage plate(4, 60, 64);
        for (std::size_t i = 0; i < plate.data.size(); ++i)
            plate.data[i] = i % 4 == 3 ? 255 : static_cast<std::uint8_t>(40 * c + 1);
        capture.backgrounds.push_back(plate);
    }
    save_capture(path, capture);
    std::vector<std::string> warnings;
    const Capture read = load(&warnings);
    CHECK(warnings.empty());
    REQUIRE(read.backgrounds.size() == 3);
    CHECK(read.background(2)->data == capture.backgrounds[2].data);
    CHECK(make_capture(body).background(2) == nullptr);

    // The plate is undistorted like the photographs. Pixels from outside of it stay opaque.
    capture.cameras[0].distortion = Distortion<double>{0.8, 0, 0, 0, 0};
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
    const Capture straight = load();
    CHECK(straight.background(0)->data != capture.backgrounds[0].data);
    CHECK(int(straight.background(0)->pixel(0, 0)[3]) == 255);
    capture.cameras[0].distortion.reset();
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});

    PixelImage hole = capture.backgrounds[1];
    hole.pixel(3, 3)[3] = 254;
    write_png(path / "backgrounds/cam1.png", hole);
    test::check_throws<ValueError>([&] { (void)load(); }, {"backgrounds/cam1.png", "transparent"});
    write_png(path / "backgrounds/cam1.png", PixelImage(4, 64, 60));
    test::check_throws<ShapeError>([&] { (void)load(); }, {"backgrounds/cam1.png", "60 x 64"});
    std::filesystem::remove(path / "backgrounds/cam1.png");
    test::check_throws<IoError>([&] { (void)load(); }, {"backgrounds/cam1.png"});
    capture.backgrounds.pop_back();
    CHECK_THROWS_AS(save_capture(folder / "b", capture), ShapeError);
}

TEST_CASE_FIXTURE(StoredCapture, "an image that was not taken is in no view") {
    capture.images[0] = PixelImage();
    capture.images[4] = PixelImage();
    CHECK(capture.views(false).size() == 4);
    CHECK(capture.views(true).size() == 3);
    CHECK(!capture.is_taken({1, 1}));
    CHECK(capture_warnings(capture, body).empty());
    for (std::size_t f = 0; f < 3; ++f) capture.images[f] = PixelImage();
    CHECK(capture_warnings(capture, body).empty());
}

TEST_CASE_FIXTURE(StoredCapture, "distorted images are straightened when they are loaded") {
    // Undistortion moves a point to where a pinhole camera shows it.
    const Distortion<double> lens{-0.8, 0.05, 0.002, -0.001, 0};
    const Camera<double>& camera = capture.cameras[0].camera;
    const vec2<double> straight(8.5, 10.5);
    const vec2<double> bent =
        distort(lens, vec2<double>((straight.x - camera.cx) / camera.fx, (straight.y - camera.cy) / camera.fy));
    const int x = int(camera.fx * bent.x + camera.cx), y = int(camera.fy * bent.y + camera.cy);
    CHECK(std::abs(x - 8) + std::abs(y - 10) >= 2);
    PixelImage photo(4, 60, 64);
    for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) photo.pixel(y + dy, x + dx)[1] = photo.pixel(y + dy, x + dx)[3] = 255;
    write_png(image(0, 0), photo);
    capture.cameras[0].distortion = lens;
    write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
    const Capture read = load();
    CHECK(!read.cameras[0].distortion);
    CHECK(int(read.images[0].pixel(10, 8)[3]) == 255);
    CHECK(int(read.images[0].pixel(10, 8)[1]) == 255);
    CHECK(read.images[3].data == capture.images[3].data);
}

TEST_CASE_FIXTURE(StoredCapture, "files that do not belong together") {
    SUBCASE("no folder") {
        test::check_throws<IoError>([&] { (void)load_capture(serial, folder / "none", body); },
                                    {"none", "not a folder"});
    }
    SUBCASE("no cameras") {
        std::filesystem::remove(path / "cameras.json");
        test::check_throws<IoError>([&] { (void)load(); }, {"cameras.json", "No such file"});
    }
    SUBCASE("no poses") {
        std::filesystem::remove(path / "poses.npz");
        test::check_throws<IoError>([&] { (void)load(); }, {"poses.npz", "No such file"});
    }
    SUBCASE("no images of a camera") {
        std::filesystem::remove_all(path / "images/cam1");
        test::check_throws<IoError>([&] { (void)load(); }, {"images/cam1", "No such file"});
    }
    SUBCASE("every camera's last image is missing") {
        for (const int camera : {0, 1, 2}) std::filesystem::remove(image(camera, 2));
        test::check_throws<ShapeError>([&] { (void)load(); },
                                       {"images/cam0", "2 images, expected 3", "poses.npz", "go from 0 to 1"});
    }
    SUBCASE("as many images as poses, but with a gap in their numbers") {
        std::filesystem::rename(image(1, 2), path / "images/cam1/0003.png");
        test::check_throws<ShapeError>([&] { (void)load(); }, {"images/cam1", "3 images with a gap",
                                                               "expected 3, one per pose", "go from 0 to 3"});
    }
    SUBCASE("names do not tell which image is missing") {
        for (const int frame : {0, 2}) std::filesystem::rename(image(1, frame), image(1, frame) + "_a.png");
        std::filesystem::remove(image(1, 1));
        test::check_throws<ShapeError>([&] { (void)load(); },
                                       {"images/cam1", "2 images, expected 3", "names end in numbers"});
    }
    SUBCASE("a frame has two images") {
        for (const int frame : {0, 2}) std::filesystem::remove(image(1, frame));
        std::filesystem::rename(image(1, 1), path / "images/cam1/a1.png");
        write_png(path / "images/cam1/b1.png", capture.images[0]);
        test::check_throws<IoError>([&] { (void)load(); }, {"images/cam1/b1.png", "its number is that of a1.png"});
    }
    SUBCASE("a camera without images") {
        for (const int frame : {0, 1, 2}) std::filesystem::remove(image(1, frame));
        test::check_throws<ShapeError>([&] { (void)load(); }, {"images/cam1", "0 images, expected 3"});
    }
    SUBCASE("more poses than frames") {
        Motion& m = capture.motion;
        m.pose.resize(4 * 55), m.expression.resize(8), m.transl.resize(4), m.timestamps.push_back(1);
        save_motion(path / "poses.npz", m);
        test::check_throws<ShapeError>([&] { (void)load(); }, {"images/cam0", "3 images, expected 4", "poses.npz"});
    }
    SUBCASE("an image of another size") {
        write_png(image(1, 1), PixelImage(4, 64, 60));
        test::check_throws<ShapeError>([&] { (void)load(); }, {image(1, 1), "60 x 64", "64 x 60", "cam1"});
    }
    SUBCASE("images that are none; the first in order is named on any number of threads") {
        for (const int frame : {1, 2}) write_file(image(0, frame), "none");
        test::check_throws<IoError>([&] { (void)load(); }, {image(0, 1), "not a PNG"});
        cpu::Threads threads(3);
        test::check_throws<IoError>([&] { (void)load_capture(threads, path, body); }, {image(0, 1), "not a PNG"});
    }
    SUBCASE("every mask for training is empty") {
        for (const int camera : {0, 1})
            for (const int frame : {0, 1, 2}) write_png(image(camera, frame), PixelImage(4, 60, 64));
        test::check_throws<ValueError>([&] { (void)load(); }, {image(0, 0), "mask", "empty", "all photographs"});
    }
    SUBCASE("images of another format") {
        for (const int frame : {0, 1, 2}) {
            std::filesystem::remove(image(1, frame));
            write_file(path / ("images/cam1/000" + std::to_string(frame) + ".webp"), "RIFF....WEBP");
        }
        test::check_throws<IoError>([&] { (void)load(); },
                                    {"images/cam1", "3 images such as 0000.webp", "PNG or JPEG", "*.webp"});
    }
    SUBCASE("numbers whose names are in another order") {
        const auto name = [&](const char* number) { return path / "images/cam1" / (std::string(number) + ".png"); };
        std::filesystem::rename(image(1, 0), name("1"));
        std::filesystem::rename(image(1, 1), name("10"));
        std::filesystem::rename(image(1, 2), name("2"));
        test::check_throws<IoError>([&] { (void)load(); }, {"images/cam1/2.png", "after 10.png", "pad", "zeros"});
    }
    SUBCASE("a truncated image") {
        test::truncate_file(image(2, 0), 30);
        test::check_throws<IoError>([&] { (void)load(); }, {image(2, 0), "truncated"});
    }
}

TEST_CASE_FIXTURE(StoredCapture, "what is probably wrong is warned of with its likely cause") {
    SUBCASE("a camera that looks away") {
        capture.cameras[1].camera.t = {20, 1.3, 5};
        write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
        const std::string text = only_warning();
        CHECK(text == test::contains("cam1"));
        CHECK(text == test::contains("far off the body"));
    }
    SUBCASE("a camera behind the body") {
        capture.cameras[1].camera.t = {0, 1.3, -5};
        write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
        CHECK(only_warning() == test::contains("far off the body"));
    }
    SUBCASE("millimetres") {
        capture.cameras[1].camera.t = {0, 1300, 5000};
        capture.cameras[1].camera.cy = 4;
        write_cameras(path / "cameras.json", {capture.cameras, 10, {}, {}});
        CHECK(only_warning() == test::contains("metres"));
    }
    SUBCASE("an inverted mask") {
        for (int f = 0; f < 3; ++f) {
            PixelImage inverted = capture.images[static_cast<std::size_t>(3 + f)];
            for (std::size_t i = 3; i < inverted.data.size(); i += 4)
                inverted.data[i] = static_cast<std::uint8_t>(255 - inverted.data[i]);
            write_png(image(1, f), inverted);
        }
        const std::string text = only_warning();
        CHECK(text == test::contains("cam1"));
        CHECK(text == test::contains("inverted"));
    }
    SUBCASE("no mask at all") {
        for (int f = 0; f < 3; ++f) {
            PixelImage opaque = capture.images[static_cast<std::size_t>(f)];
            for (std::size_t i = 3; i < opaque.data.size(); i += 4) opaque.data[i] = 255;
            write_png(image(0, f), opaque);
        }
        CHECK(only_warning() == test::contains("without a mask"));
    }
    SUBCASE("masks of somebody else") {
        for (int f = 0; f < 3; ++f) {
            PixelImage other(4, 60, 64);
            for (int y = 0; y < 60; ++y) other.pixel(y, 60)[3] = 255;
            write_png(image(0, f), other);
        }
        CHECK(only_warning() == test::contains("belong together"));
    }
}

TEST_CASE_FIXTURE(StoredCapture, "a capture that cannot be saved") {
    capture.images.pop_back();
    CHECK_THROWS_AS(save_capture(folder / "b", capture), ShapeError);
    capture.images.push_back(PixelImage(4, 3, 3));
    CHECK_THROWS_AS(save_capture(folder / "b", capture), ShapeError);
    write_file(folder / "file", "");
    test::check_throws<IoError>([&] { save_capture(folder / "file", make_capture(body)); },
                                {"file", "cannot be created"});
}
