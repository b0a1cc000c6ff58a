// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/people_snapshot.hpp>

#include "io/people_snapshot_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"
#include "support/contains.hpp"

#include <gsh/backend/threads.hpp>

#include <functional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr int photo_width = 64, photo_height = 48, photo_count = 10;
constexpr std::size_t photo_pixels = photo_width * photo_height;

/// A video of ten frames, the poses of all of them, and refined poses of the split {0, 2, 4} and {6, 9}.
struct Subject : test::PeopleSnapshotFiles {
    BodyModel body = test::small_body(24, 10, 0);
    cpu::Serial serial;

    Subject() {
        test::Rng rng(12);
        thetas = rng.numbers(photo_count * 72, -0.1, 0.1);
        for (int f = 0; f < photo_count; ++f) {
            thetas[static_cast<std::size_t>(72 * f)] += 3.14159; // upright in a camera whose y is down
            for (const double v : {0.0, 0.6, 5.0}) transl.push_back(v + 0.01 * f);
        }
        write_cameras(1);
        for (int f = 0; f < photo_count; ++f) {
            const PixelImage photo = test::numbered_image(photo_width, photo_height, 0, f);
            write_photo(f, test::masked(photo, [](int y, int x) {
                return y >= 1 && y < photo_height - 2 && x >= 5 && x < photo_width - 5;
            }));
        }
        write_all(0.5);
        write_refined("anim_nerf_train.npz", {0, 2, 4});
        write_refined("anim_nerf_test.npz", {6, 9});
        test::write_text(path / "split.json", R"({"train": [0, 5, 2], "test": [6, 9, 3]})");
    }
    void write_cameras(double scale) const {
        Camera<double> camera;
        camera.fx = 120 * scale, camera.fy = 121, camera.cx = 33.5, camera.cy = 26.5;
        camera.width = photo_width, camera.height = photo_height;
        write_camera(camera);
    }
    void write_refined(const std::string& name, const std::vector<int>& frames) const {
        write_split(name, frames, 0.25, 0.125);
    }
    [[nodiscard]] Capture load(std::vector<std::string>* warnings = nullptr, const CaptureOptions& options = {}) {
        return load_people_snapshot(serial, path, body, options, warnings);
    }
};

} // namespace

TEST_CASE_FIXTURE(Subject, "the frames of the split with their refined poses, at full size") {
    std::vector<std::string> warnings;
    const Capture capture = load(&warnings);
    for (const std::string& w : warnings) MESSAGE(w);
    CHECK(warnings.empty());
    CHECK(capture.name == "anna");
    REQUIRE(capture.frame_count() == 5);
    CHECK(capture.test_frames == std::vector<int>{3, 4});
    CHECK(capture.views(false).size() == 3);
    const int source[] = {0, 2, 4, 6, 9};
    for (std::size_t i = 0; i < 5; ++i) {
        const auto f = static_cast<std::size_t>(source[i]);
        CHECK(int(capture.images[i].pixel(3, 9)[2]) == source[i]);
        CHECK(capture.motion.pose_at(i)[0].x == float(thetas[72 * f]));
        CHECK(capture.motion.pose_at(i)[23].z == float(thetas[72 * f + 71]));
        CHECK(capture.motion.transl[i].z == doctest::Approx(transl[3 * f + 2] + 0.125));
        CHECK(capture.motion.timestamps[i] == doctest::Approx(source[i] / 30.0));
    }
    CHECK(capture.motion.betas == std::vector<double>(10, 0.25));
    const Camera<double>& camera = capture.cameras[0].camera;
    CHECK(camera.fx == 120);
    CHECK(camera.fy == 121);
    CHECK(camera.cx == 33.5); // the principal point is kept; pixels count from the corner
    CHECK(camera.cy == 26.5);
    CHECK(int(capture.images[0].pixel(0, 9)[3]) == 0);
    CHECK(int(capture.images[0].pixel(3, 9)[3]) == 255);
    for (const std::size_t count : {2, 5}) {
        cpu::Threads threads(count);
        const Capture other = load_people_snapshot(threads, path, body);
        for (std::size_t i = 0; i < 5; ++i) CHECK(other.images[i].data == capture.images[i].data);
    }
}

TEST_CASE_FIXTURE(Subject, "halved: a mean of four pixels, colours and mask on their own") {
    CaptureOptions options;
    options.downscale = 2;
    const Capture capture = load(nullptr, options);
    const Camera<double>& camera = capture.cameras[0].camera;
    CHECK(camera.width == 32);
    CHECK(camera.fx == 60);
    CHECK(camera.cx == 17);
    CHECK(camera.cy == 13.5);
    const PixelImage& image = capture.images[0];
    CHECK(int(image.pixel(1, 2)[0]) == 72); // columns 4 and 5
    CHECK(int(image.pixel(1, 2)[1]) == 40); // rows 2 and 3
    CHECK(int(image.pixel(1, 2)[3]) == 128);
    CHECK(int(image.pixel(0, 4)[3]) == 128);
    CHECK(int(image.pixel(0, 2)[3]) == 64);
    options.downscale = 5;
    test::check_throws<ValueError>([&] { (void)load(nullptr, options); }, {"anna", "64 x 48", "by 5"});
}

TEST_CASE("the four subjects' split, and sizes that are halved") {
    using detail::known_split;
    const auto count = [](const FrameRange& r) { return (r.last - r.first) / r.step + 1; };
    const std::pair<const char*, std::pair<int, int>> subjects[] = {{"male-3-casual", {114, 55}},
                                                                    {"male-4-casual", {110, 36}},
                                                                    {"female-3-casual", {112, 51}},
                                                                    {"female-4-casual", {84, 48}}};
    for (const auto& [name, counts] : subjects) {
        const auto split = known_split(name);
        CHECK(count(*split.train) == counts.first);
        CHECK(count(*split.test) == counts.second);
        for (int f = split.test->first; f <= split.test->last; f += split.test->step) CHECK(!split.train->contains(f));
    }
    CHECK(!known_split("anna").train);
}

TEST_CASE_FIXTURE(Subject, "poses of all frames, a split by options, by the reader, and masks as pictures") {
    std::filesystem::remove_all(path / "poses");
    CaptureOptions options;
    options.train_frames = FrameRange{1, 5, 4};
    options.test_frames = FrameRange{7, 99, 1};
    const Capture chosen = load(nullptr, options);
    REQUIRE(chosen.frame_count() == 5); // 1, 5, 7, 8, 9
    CHECK(chosen.motion.pose_at(1)[3].y == float(thetas[72 * 5 + 10]));
    CHECK(chosen.motion.betas == std::vector<double>(10, 0.5));

    std::filesystem::remove(path / "split.json");
    std::filesystem::rename(path / "poses.npz", path / "poses_optimized.npz"); // the user's own videos
    std::filesystem::remove_all(path / "masks");
    std::filesystem::create_directories(path / "masks");
    for (int f = 0; f < photo_count; ++f) {
        PixelImage mask(1, photo_height, photo_width);
        std::fill(mask.data.begin() + photo_width * 4, mask.data.end(), std::uint8_t(255));
        write_png(path / "masks" / (test::padded(f) + ".png"), mask);
    }
    std::vector<std::string> warnings;
    const Capture own = load(&warnings);
    CHECK(own.frame_count() == 10);
    CHECK(own.test_frames == std::vector<int>{8, 9});
    REQUIRE(!warnings.empty());
    CHECK(warnings[0] == test::contains("split.json"));
    CHECK(int(own.images[1].pixel(3, 9)[3]) == 0);
    CHECK(int(own.images[1].pixel(4, 9)[3]) == 255);
}

TEST_CASE_FIXTURE(Subject, "a body of 55 joints takes SMPL-X fits where they are, and is warned of SMPL's where not") {
    const BodyModel smplx = test::small_body(55, 10, 2, true);
    std::vector<std::string> warnings;
    const Capture without = load_people_snapshot(serial, path, smplx, {}, &warnings);
    CHECK(without.motion.joint_count == 55);
    REQUIRE(!warnings.empty());
    CHECK(warnings[0] == test::contains("fitted to SMPL"));

    test::Rng rng(1);
    const std::vector<double> root = rng.numbers(photo_count * 3), hands = rng.numbers(photo_count * 45);
    const auto write = [&](std::size_t rows, const std::vector<int>& ids, bool camera) {
        NpzWriter file(path / "smplx.npz");
        test::add_floats(file, "global_orient", {root.begin(), root.begin() + static_cast<std::ptrdiff_t>(3 * rows)},
                         {rows, 3});
        test::add_floats(file, "body_pose", std::vector<double>(rows * 63, 0.1), {rows, 63});
        test::add_floats(file, "left_hand_pose",
                         {hands.begin(), hands.begin() + static_cast<std::ptrdiff_t>(45 * rows)}, {rows, 45});
        test::add_floats(file, "transl", std::vector<double>(rows * 3, 1.0), {rows, 3});
        test::add_floats(file, "betas", std::vector<double>(10, 0.75), {10});
        if (!ids.empty()) file.add("frame_ids", ids);
        if (camera) file.add("focal_length", 5000.0);
        file.commit();
    };
    write(photo_count, {}, false); // of all images
    const Capture all = load_people_snapshot(serial, path, smplx);
    CHECK(all.motion.betas[0] == 0.75);
    CHECK(all.cameras[0].camera.fx == 120);
    const int source[] = {0, 2, 4, 6, 9};
    for (std::size_t i = 0; i < 5; ++i)
        CHECK(length(all.motion.pose_at(i)[0] -
                     vec3<double>(float(root[3 * static_cast<std::size_t>(source[i])]),
                                  float(root[3 * static_cast<std::size_t>(source[i]) + 1]),
                                  float(root[3 * static_cast<std::size_t>(source[i]) + 2]))) < 1e-7);
    write(5, {}, true); // of the split, with a camera of their own
    const Capture five = load_people_snapshot(serial, path, smplx);
    CHECK(length(five.motion.pose_at(4)[0] - vec3<double>(float(root[12]), float(root[13]), float(root[14]))) < 1e-7);
    CHECK(five.cameras[0].camera.fx == 5000);
    CHECK(five.cameras[0].camera.cx == 32);
    write(6, {9, 6, 4, 2, 0, 1}, false); // by number
    CHECK(length(load_people_snapshot(serial, path, smplx).motion.pose_at(4)[0] -
                 vec3<double>(float(root[0]), float(root[1]), float(root[2]))) < 1e-7);
    write(6, {}, false);
    test::check_throws<ShapeError>([&] { (void)load_people_snapshot(serial, path, smplx); },
                                   {"smplx.npz", "6 poses", "10", "frame_ids"});
    write(4, {0, 2, 4, 6}, false);
    test::check_throws<IoError>([&] { (void)load_people_snapshot(serial, path, smplx); }, {"frame_ids lacks frame 9"});
    CaptureOptions named;
    named.poses = "none.npz";
    test::check_throws<IoError>([&] { (void)load_people_snapshot(serial, path, smplx, named); }, {"none.npz"});
    named.poses = "lhm"; // any other layout; files of some frames count by their numbers
    std::filesystem::create_directories(path / "lhm");
    const detail::Json none = detail::Json::array({0, 0, 0});
    for (const int number : {9, 6, 4, 2, 1, 0}) {
        const detail::Json frame = {{"root_pose", {0.01 * number, 0, 0}},
                                    {"body_pose", std::vector<double>(63, 0.0)},
                                    {"trans", none},
                                    {"betas", std::vector<double>(10, 0.5)}};
        test::write_text(path / "lhm" / (std::to_string(number) + ".json"), frame.dump());
    }
    const Motion numbered = load_people_snapshot(serial, path, smplx, named).motion;
    for (std::size_t i = 0; i < 5; ++i) CHECK(numbered.pose_at(i)[0].x == doctest::Approx(0.01 * source[i]));
    CHECK(numbered.betas[0] == 0.5);
}

TEST_CASE_FIXTURE(Subject, "a photograph whose mask is empty is not taken; system files do not count") {
    const Capture whole = load();
    test::write_array<std::uint8_t>(mask_file(2), std::vector<std::uint8_t>(photo_pixels, 0),
                                    {photo_height, photo_width});
    for (const char* name : {"images/._image_0000.png", "images/.DS_Store", "masks/._mask_0000.npy"})
        write_file(path / name, "x");
    std::vector<std::string> warnings;
    cpu::Serial executor;
    const Capture read = load_people_snapshot(executor, path, body, {}, &warnings);
    CHECK(std::any_of(warnings.begin(), warnings.end(), [](const std::string& text) {
        return text.find("1 of ") != std::string::npos &&
               text.find("have an empty mask and are left out: images/image_0002.png") != std::string::npos;
    }));
    REQUIRE(read.frame_count() == whole.frame_count());
    CHECK(read.motion.pose == whole.motion.pose);
    std::size_t missing = 0;
    for (std::size_t f = 0; f < read.frame_count(); ++f) missing += !read.is_taken({0, f});
    CHECK(missing == 1);
}

TEST_CASE_FIXTURE(Subject, "a number far from the others does not make a video of a billion frames") {
    std::filesystem::rename(mask_file(9), path / "masks/mask_999999999.npy");
    std::filesystem::remove(mask_file(2)); // so that the numbers tell which mask is missing
    test::check_throws<ShapeError>([&] { (void)load(); }, {"anna/images", "from 0 to 999999999", "only 10 files"});
}

TEST_CASE_FIXTURE(Subject, "files that do not belong together") {
    const auto fails = [&](std::initializer_list<std::string_view> words) {
        test::check_throws<Error>([&] { (void)load(); }, words);
    };
    SUBCASE("no camera") {
        std::filesystem::remove(path / "cameras.npz");
        fails({"cameras.npz"});
    }
    SUBCASE("a camera without a focal length") {
        write_cameras(0);
        fails({"cameras.npz", "singular"});
    }
    SUBCASE("a mask is missing") {
        std::filesystem::remove(mask_file(2));
        std::vector<std::string> warnings;
        const Capture read = load(&warnings);
        CHECK(!read.is_taken({0, 1})); // the split is 0, 2, 4 and 6, 9
        CHECK(read.is_taken({0, 2}));
        CHECK(std::any_of(warnings.begin(), warnings.end(), [](const std::string& text) {
            return text.ends_with("1 of 5 photographs have no mask and are left out: images/image_0002.png");
        }));
        std::filesystem::remove(mask_file(9)); // image_0009 tells that there are ten
        CHECK(!load().is_taken({0, 4}));
        std::filesystem::remove(path / "images/image_0009.png");
        fails({"anim_nerf_test.npz", "holds 2 poses, expected 1"});
    }
    SUBCASE("a mask is missing that no number tells") {
        std::filesystem::remove(mask_file(2));
        std::filesystem::rename(mask_file(3), path / "masks/mask_three.npy");
        fails({"masks", "9 images, expected 10", "end in numbers"});
    }
    SUBCASE("no masks") {
        std::filesystem::remove_all(path / "masks");
        fails({"masks", "folder of masks"});
    }
    SUBCASE("no images") {
        std::filesystem::remove_all(path / "images");
        fails({"images"});
    }
    SUBCASE("a mask of another size") {
        test::write_array<std::uint8_t>(
            mask_file(2), std::vector<std::uint8_t>(photo_pixels, 1), {photo_width, photo_height});
        fails({mask_file(2).string(), "48 x 64", "64 x 48"});
    }
    SUBCASE("labels of several objects") {
        std::vector<std::uint8_t> labels(photo_pixels, 1);
        labels[0] = 2, labels[1] = 0;
        test::write_array<std::uint8_t>(mask_file(2), labels, {photo_height, photo_width});
        fails({mask_file(2).string(), "labels 0, 1, 2"});
    }
    SUBCASE("a mask of odd numbers") {
        test::write_array<float>(mask_file(2), std::vector<float>(photo_pixels, -1),
                                 {photo_height, photo_width});
        fails({mask_file(2).string(), "0 to 255"});
    }
    SUBCASE("an image of another size") {
        write_png(image(4), PixelImage(3, photo_width, photo_height));
        fails({image(4).string(), "48 x 64"});
    }
    SUBCASE("poses of another split") {
        write_refined("anim_nerf_train.npz", {0, 2});
        fails({"anim_nerf_train.npz", "2 poses, expected 3", "split"});
    }
    SUBCASE("poses of fewer frames") {
        std::filesystem::remove_all(path / "poses");
        thetas.resize(9 * 72), transl.resize(9 * 3);
        write_all(0.5);
        fails({"poses.npz", "9 poses, expected 10"});
    }
    SUBCASE("no poses") {
        std::filesystem::remove_all(path / "poses");
        std::filesystem::remove(path / "poses.npz");
        fails({"poses_optimized.npz"});
    }
    SUBCASE("a member of another width") {
        NpzWriter file(path / "poses/anim_nerf_test.npz");
        file.add("betas", std::vector<double>(10, 0.0));
        file.add("global_orient", std::vector<double>(6, 0.0), {2, 3});
        file.add("body_pose", std::vector<double>(126, 0.0), {2, 63});
        file.add("transl", std::vector<double>(6, 0.0), {2, 3});
        file.commit();
        fails({"anim_nerf_test.npz", "body_pose", "(2, 63)", "(2, 69)"});
    }
    SUBCASE("a frame on both sides") {
        test::write_text(path / "split.json", R"({"train": [0, 8, 2], "test": [6, 9, 3]})");
        fails({"frame 6", "test split"});
    }
    SUBCASE("a split of nothing") {
        test::write_text(path / "split.json", R"({"train": [0, 8, 0]})");
        fails({"split.json", "train", "step"});
    }
    SUBCASE("a split of two numbers") {
        test::write_text(path / "split.json", R"({"train": [0, 8]})");
        fails({"split.json", "train has 2"});
    }
}
