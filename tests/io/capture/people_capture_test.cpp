// SPDX-License-Identifier: Apache-2.0
#include <gsh/io/capture/people_capture.hpp>

#include "io/gala_files.hpp"
#include "io/sample_files.hpp"
#include "io/small_body.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

namespace fs = std::filesystem;

/// A capture of two frames with poses of ann and bob, a training camera and a test camera in front of them. bob stands
/// 10 cm beside ann.
struct StoredPeople {
    static constexpr int size = 16;
    test::Temporary folder;
    fs::path path = folder / "scene", masks = path / "person_masks";
    BodyModel body = test::small_body(24, 3, 0);
    Motion ann = test::still_motion(body, 2), bob = ann;
    std::vector<NamedCamera> cameras{2};
    cpu::Serial serial;

    StoredPeople() {
        for (auto& transl : bob.transl) transl.x += 0.1;
        cameras[0].name = "left", cameras[1].name = "right";
        cameras[1].role = NamedCamera::Role::test;
        Capture capture;
        for (NamedCamera& named : cameras) {
            Camera<double>& camera = named.camera;
            camera.fx = camera.fy = 20, camera.cx = camera.cy = 8, camera.width = camera.height = size;
        }
        capture.cameras = cameras;
        capture.motion = ann;
        capture.images.assign(4, PixelImage(4, size, size));
        for (PixelImage& image : capture.images) { // a mask with a hole, which causes no warning
            std::fill(image.data.begin(), image.data.end(), std::uint8_t(255));
            image.pixel(0, 0)[3] = 0;
        }
        save_capture(path, capture);
        save_motion(path / "ann.npz", ann);
        save_motion(path / "bob.npz", bob);
    }
    [[nodiscard]] PeopleCapture load(const std::vector<fs::path>& poses, std::vector<std::string>* warnings = nullptr) {
        return load_people_capture(serial, path, Span<const BodyModel>(&body, 1), poses, {}, warnings);
    }
    /// White in one half of the image: the left one in the first frame, the right one in the second.
    void store_masks(const std::string& person, const std::string& camera, std::uint8_t white = 255) const {
        fs::create_directories(masks / person / camera);
        for (const int frame : {0, 1}) {
            PixelImage mask(1, size, size);
            for (int y = 0; y < size; ++y)
                for (int x = 8 * frame; x < 8 * frame + 8; ++x) *mask.pixel(y, x) = white;
            write_png(masks / person / camera / (std::to_string(frame) + ".png"), mask);
        }
    }
};

bool same_motion(const Motion& a, const Motion& b) { return a.pose == b.pose && a.transl == b.transl; }

} // namespace

TEST_CASE("people are called as their pose files are, and told apart by numbers") {
    const test::Temporary folder;
    fs::create_directories(folder / "take.one");
    using Names = std::vector<std::string>;
    CHECK(person_names({}) == Names{});
    CHECK(person_names({folder / "ann.npz", folder / "ann.smith.npz"}) == Names{"ann", "ann.smith"});
    CHECK(person_names({folder / "take.one", folder / "none.two"}) == Names{"take.one", "none"}); // a folder, no folder
    CHECK(person_names({folder / "take.one/"}) == Names{"take.one"});
    CHECK(person_names({folder / "a/poses.npz", folder / "b/poses.npz", folder / "c/poses.npz"}) ==
          Names{"poses", "poses-2", "poses-3"});
    CHECK(person_names({folder / "a/poses.npz", folder / "poses-2.npz", folder / "b/poses.npz"}) ==
          Names{"poses", "poses-2", "poses-3"}); // the number is taken
    const std::vector<fs::path> twice{folder / "a.npz", folder / "b.npz", folder / "x/../a.npz"};
    test::check_throws<ValueError>([&] { (void)person_names(twice); }, {"x/../a.npz", "named twice"});
}

TEST_CASE_FIXTURE(StoredPeople, "one person is the capture's own, with the file's name or none") {
    std::vector<std::string> warnings;
    const PeopleCapture unnamed = load({}, &warnings), named = load({"bob.npz"});
    REQUIRE(unnamed.people.size() == 1);
    CHECK(unnamed.people[0].name == "person");
    CHECK(same_motion(unnamed.people[0].motion, ann)); // of poses.npz
    CHECK(unnamed.any.layout == CaptureLayout::gsh);
    CHECK(unnamed.any.capture.images.size() == 4);
    CHECK(warnings.empty());
    REQUIRE(named.people.size() == 1);
    CHECK(named.people[0].name == "bob");
    CHECK(named.people[0].body == 0);
    CHECK(same_motion(named.people[0].motion, bob));
    CHECK(same_motion(named.any.capture.motion, bob));

    store_masks("bob", "right"); // a person alone needs no masks beside the photographs'
    CHECK(load({"bob.npz"}).people[0].masks.empty());
}

TEST_CASE_FIXTURE(StoredPeople, "several people have a pose file each, and one body or one each") {
    fs::create_directories(folder / "other");
    fs::rename(path / "bob.npz", folder / "other/bob.npz");
    const std::vector<fs::path> poses{"ann.npz", folder / "other/bob.npz"}; // in the capture, and elsewhere
    const PeopleCapture two = load(poses);
    REQUIRE(two.people.size() == 2);
    CHECK(two.people[0].name == "ann");
    CHECK(two.people[1].name == "bob");
    CHECK(same_motion(two.people[0].motion, ann));
    CHECK(same_motion(two.people[1].motion, bob));
    CHECK(same_motion(two.any.capture.motion, ann));
    CHECK(two.people[1].body == 0);
    CHECK(two.people[1].mask({1, 0}) == nullptr);

    const std::vector<BodyModel> bodies{body, test::small_body(24, 2, 0)};
    Motion other = bob;
    other.betas = {0, 0};
    save_motion(folder / "other/bob.npz", other);
    const PeopleCapture each = load_people_capture(serial, path, bodies, poses);
    CHECK(each.people[0].body == 0);
    CHECK(each.people[1].body == 1);
    CHECK(each.people[1].motion.betas.size() == 2);
}

TEST_CASE_FIXTURE(StoredPeople, "people who do not belong into one capture") {
    test::check_throws<ValueError>([&] { (void)load({"ann.npz", "bob.npz", "ann.npz"}); }, {"ann.npz", "named twice"});
    test::check_throws<IoError>([&] { (void)load({"ann.npz", "cleo.npz"}); }, {"cleo.npz"});
    save_motion(path / "long.npz", test::still_motion(body, 3));
    test::check_throws<ShapeError>([&] { (void)load({"ann.npz", "long.npz"}); },
                                   {"long.npz", "3", "expected 2", "as in", "ann.npz"});
    for (const std::size_t count : {2, 3}) {
        const std::vector<BodyModel> bodies(count, body);
        const std::vector<fs::path> poses(5 - count, "ann.npz");
        test::check_throws<ValueError>(
            [&] { (void)load_people_capture(serial, path, bodies, poses); },
            {std::to_string(count) + " body models for " + std::to_string(5 - count) + " people", "one each"});
    }
    test::write_text(folder / "intri.yml", ""); // EasyMocap's
    test::check_throws<ValueError>(
        [&] {
            (void)load_people_capture(serial, folder / "", Span<const BodyModel>(&body, 1), {"ann.npz", "bob.npz"});
        },
        {"our own layout", "GalaBasketball", "several pose files"});
}

TEST_CASE_FIXTURE(StoredPeople, "warnings begin with the name of whom they are about, where there are several") {
    for (auto& transl : bob.transl) transl.x = 100;
    save_motion(path / "bob.npz", bob);
    const auto warned = [&](const std::vector<fs::path>& poses) {
        std::vector<std::string> warnings;
        (void)load(poses, &warnings);
        return warnings;
    };
    CHECK(warned({"ann.npz"}).empty());
    for (const bool first : {false, true}) {
        const auto warnings = first ? warned({"bob.npz", "ann.npz"}) : warned({"ann.npz", "bob.npz"});
        REQUIRE(warnings.size() == 2); // one per camera
        CHECK(warnings[0].starts_with("bob: " + path.string() + ": camera 'left' is far off the body"));
        CHECK(warnings[1].starts_with("bob: " + path.string() + ": camera 'right' is far off the body"));
    }
    REQUIRE(warned({"bob.npz"}).size() == 2);
    CHECK(warned({"bob.npz"})[0].starts_with(path.string() + ": camera 'left'"));
}

TEST_CASE_FIXTURE(StoredPeople, "masks say which pixels are whose, in the views to judge by") {
    for (const char* camera : {"left", "right"}) store_masks("bob", camera, 128); // white enough
    test::write_text(masks / "notes.txt", "");                                    // no person
    test::write_text(masks / "bob/notes.txt", "");                                // no camera
    const PeopleCapture loaded = load({"ann.npz", "bob.npz"});
    CHECK(loaded.people[0].masks.empty());
    CHECK(loaded.people[0].mask({1, 0}) == nullptr);
    const CapturePerson& person = loaded.people[1];
    REQUIRE(person.masks.size() == 4);
    for (const std::size_t frame : {0, 1}) {
        CAPTURE(frame);
        CHECK(person.mask({0, frame}) == nullptr); // trained on
        const Image<std::uint8_t>* mask = person.mask({1, frame});
        REQUIRE(mask != nullptr);
        REQUIRE((mask->channels == 1 && mask->height == size && mask->width == size));
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) CHECK(int(mask->at(0, y, x)) == int(std::size_t(x) / 8 == frame));
    }
    store_masks("bob", "right", 1); // a label image
    const PeopleCapture label = load({"ann.npz", "bob.npz"});
    CHECK(label.people[1].mask({1, 0})->data == person.mask({1, 0})->data);
    write_png(masks / "bob/right/1.png", PixelImage(1, size, size)); // not seen in one frame
    const PeopleCapture hidden = load({"ann.npz", "bob.npz"});
    CHECK(hidden.people[1].mask({1, 0})->data == person.mask({1, 0})->data);
    for (const std::uint8_t pixel : hidden.people[1].mask({1, 1})->data) CHECK(int(pixel) == 0);
    cpu::Threads threads(3);
    store_masks("ann", "right");
    const PeopleCapture again =
        load_people_capture(threads, path, Span<const BodyModel>(&body, 1), {"ann.npz", "bob.npz"});
    CHECK(again.people[0].mask({1, 1})->data == person.mask({1, 1})->data);

    // A frame that is reserved for tests is a test view in all cameras.
    write_cameras(path / "cameras.json", {cameras, 0, {}, {1}});
    const PeopleCapture kept = load({"ann.npz", "bob.npz"});
    CHECK(kept.people[1].mask({0, 0}) == nullptr);
    CHECK(kept.people[1].mask({0, 1}) != nullptr);
    CHECK(kept.people[0].mask({0, 1}) == nullptr); // ann has no masks of that camera
    CHECK(kept.people[0].mask({1, 0}) != nullptr);
}

TEST_CASE_FIXTURE(StoredPeople, "masks are opaque and white, or alpha, and are straightened as the photographs are") {
    cameras[1].distortion = Distortion<double>{-0.8, 0.05, 0.002, -0.001, 0};
    write_cameras(path / "cameras.json", {cameras, 0, {}, {}});
    fs::create_directories(masks / "bob/right");
    PixelImage picture(4, size, size);
    for (int y = 0; y < size; ++y)
        for (int x = 0; x < size; ++x) picture.pixel(y, x)[3] = (x - 11) * (x - 11) + (y - 4) * (y - 4) < 20 ? 255 : 0;
    for (const int frame : {0, 1})
        for (const fs::path& place : {path / "images/right", masks / "bob/right"})
            write_png(place / test::padded(frame).append(".png"), picture);
    const PeopleCapture loaded = load({"ann.npz", "bob.npz"});
    const PixelImage& straight = loaded.any.capture.image({1, 0});
    const Image<std::uint8_t>* mask = loaded.people[1].mask({1, 0});
    REQUIRE(mask != nullptr);
    std::size_t inside = 0, moved = 0;
    for (std::size_t i = 0; i < mask->data.size(); ++i) {
        CHECK(int(mask->data[i]) == int(straight.data[4 * i + 3] > 127));
        inside += mask->data[i], moved += mask->data[i] != (picture.data[4 * i + 3] > 127);
    }
    CHECK(inside > 10);
    CHECK(moved > 0);
}

TEST_CASE_FIXTURE(StoredPeople, "masks of nobody, by no camera, too few or of another size") {
    const auto refuse = [&](std::initializer_list<std::string_view> words) {
        test::check_throws([&] { (void)load({"ann.npz", "bob.npz"}); }, words);
        fs::remove_all(masks);
    };
    store_masks("cleo", "right");
    refuse({"person_masks/cleo", "no such person", "ann, bob"});
    store_masks("bob", "roof");
    refuse({"person_masks/bob/roof", "no camera 'roof'", "cameras.json"});
    store_masks("bob", "right");
    fs::remove(masks / "bob/right/1.png");
    refuse({"person_masks/bob/right", "holds 1 images, expected 2", "bob.npz"});
    store_masks("bob", "right");
    write_png(masks / "bob/right/1.png", PixelImage(1, size, size + 1));
    refuse({"person_masks/bob/right/1.png", "17 x 16", "16 x 16", "'right'"});
}

TEST_CASE_FIXTURE(test::Gala, "in a layout that holds several people all of them come, on its own body") {
    const PeopleCapture loaded = load_people_capture(serial, scene, {}, {});
    REQUIRE(loaded.people.size() == 2);
    REQUIRE(loaded.any.rig);
    for (const std::size_t p : {0, 1}) {
        CHECK(loaded.people[p].name == "person-" + std::to_string(p));
        CHECK(loaded.people[p].body == 0);
        CHECK(same_motion(loaded.people[p].motion, loaded.any.people[p]));
        CHECK(loaded.people[p].masks.empty());
    }
    CHECK(!same_motion(loaded.people[0].motion, loaded.people[1].motion));
    CHECK(same_motion(loaded.any.capture.motion, loaded.people[0].motion));
    CaptureOptions second;
    second.person = 1;
    const PeopleCapture other = load_people_capture(serial, scene, {}, {}, second);
    CHECK(same_motion(other.any.capture.motion, loaded.people[1].motion));
    CHECK(same_motion(other.people[0].motion, loaded.people[0].motion));
    // Each person causes one warning. The person whose motion is the capture's comes first.
    test::write_text(scene / "camera/1.txt", "40,32,24\n90,0,0\n0,0,0,1\n1,1,1\n");
    for (const int first : {0, 1}) {
        std::vector<std::string> warnings;
        CaptureOptions options;
        options.person = first;
        (void)load_people_capture(serial, scene, {}, {}, options, &warnings);
        REQUIRE(warnings.size() == 2);
        for (const int place : {0, 1}) {
            const std::string name = "person-" + std::to_string(place == 0 ? first : 1 - first);
            CHECK(warnings[std::size_t(place)].starts_with(name + ": " + scene.string() + ": camera '1' is far off"));
        }
    }
}

TEST_CASE_FIXTURE(test::Gala, "GalaBasketball's people take motions of another body, one each") {
    const BodyModel body = test::small_body(); // SMPL-X's 55 joints, with triangles
    const BodyModel bodies[] = {body, test::small_body(55, 2)};
    Motion ann = test::still_motion(body, frames), bob = test::still_motion(bodies[1], frames);
    for (auto& transl : bob.transl) transl.x += 1;
    save_motion(scene / "ann.npz", ann);
    save_motion(folder / "bob.npz", bob);
    const std::vector<fs::path> poses{"ann.npz", folder / "bob.npz"};
    const PeopleCapture loaded = load_people_capture(serial, scene, Span<const BodyModel>(bodies, 2), poses);
    CHECK(loaded.any.layout == CaptureLayout::gala);
    CHECK(!loaded.any.rig);
    REQUIRE(loaded.people.size() == 2);
    CHECK(loaded.people[0].name == "ann");
    CHECK(loaded.people[1].name == "bob");
    CHECK(loaded.people[0].body == 0);
    CHECK(loaded.people[1].body == 1);
    CHECK(same_motion(loaded.people[0].motion, ann));
    CHECK(same_motion(loaded.people[1].motion, bob));
    CHECK(loaded.people[1].motion.betas.size() == 2);
    CHECK(same_motion(loaded.any.capture.motion, ann));
    // From the photographs, not from the file.
    CHECK(loaded.people[0].motion.timestamps[1] == doctest::Approx(1 / 30.0));
    CHECK(loaded.any.capture.backgrounds.size() == cameras);

    // One body for all people, and other motions of the data set's own rig.
    save_motion(folder / "bob.npz", ann);
    CHECK(load_people_capture(serial, scene, Span<const BodyModel>(&body, 1), poses).people[1].body == 0);
    const GalaScene own = load_gala_scene(serial, scene);
    save_motion(scene / "ann.npz", own.people[1]);
    save_motion(folder / "bob.npz", own.people[0]);
    const PeopleCapture swapped = load_people_capture(serial, scene, {}, poses);
    REQUIRE(swapped.any.rig);
    CHECK(same_motion(swapped.people[0].motion, own.people[1]));
    CHECK(same_motion(swapped.people[1].motion, own.people[0]));
    CHECK(swapped.people[1].body == 0);
}

TEST_CASE_FIXTURE(test::Gala, "motions that do not belong to GalaBasketball's people") {
    const BodyModel body = test::small_body();
    const Span<const BodyModel> one(&body, 1);
    save_motion(scene / "ann.npz", test::still_motion(body, frames));
    save_motion(scene / "bob.npz", test::still_motion(body, frames));
    using Files = std::vector<fs::path>;
    const auto refuse = [&]<class E>(E*, Span<const BodyModel> bodies, const Files& files,
                                     std::initializer_list<std::string_view> words) {
        test::check_throws<E>([&] { (void)load_people_capture(serial, scene, bodies, files); }, words);
    };
    constexpr ValueError* value = nullptr;
    constexpr ShapeError* shape = nullptr;
    refuse(value, one, {}, {scene.string(), "of its own rig", "each of the 2 people", "leave the body out"});
    refuse(value, one, {"poses.npz"}, {"each of the 2 people"}); // the default name; there is no such file
    refuse(shape, one, {"ann.npz"}, {"the list of motions has 1", "expected 2", "used whole"});
    refuse(shape, {}, {"ann.npz", "bob.npz"}, {"ann.npz", "27 joints", "needs that body"});
    refuse(shape, {}, {"ann.npz"}, {"ann.npz", "27 joints", "needs that body"});
    save_motion(scene / "bob.npz", test::still_motion(body, frames + 1));
    refuse(shape, one, {"ann.npz", "bob.npz"}, {"bob.npz", "5", "expected 4", "each frame of the split"});
    const std::vector<BodyModel> three(3, body);
    refuse(value, three, {"ann.npz", "bob.npz"}, {"3 body models for 2 people"});
    GalaMotions motions{three, {"ann.npz", "ann.npz"}};
    test::check_throws<ValueError>([&] { (void)load_gala_scene(serial, scene, motions); },
                                   {"3 body models for 2 people", "one each"});
}
