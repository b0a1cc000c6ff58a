// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-check as a user runs it: pictures, figures, findings and exit codes.
#include "io/gala_files.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using test::check_refused;
using test::json_of;
using test::run;
using test::studio;
namespace fs = std::filesystem;

namespace {

std::vector<std::string> words(const fs::path& capture, const fs::path& out, std::vector<std::string> more = {}) {
    std::vector<std::string> result{"gsh-check", capture.string(), "--body", studio().body_file.string(),
                                    "--out",     out.string()};
    result.insert(result.end(), more.begin(), more.end());
    return result;
}

/// Whether a picture shows a colour somewhere.
bool shows(const PixelImage& image, int red, int green, int blue) {
    for (std::size_t i = 0; i < image.data.size(); i += 4)
        if (image.data[i] == red && image.data[i + 1] == green && image.data[i + 2] == blue) return true;
    return false;
}

/// Runs gsh-check on a capture with a fault. Expects exit code 1 and returns check.json.
nlohmann::json check_of(const std::function<void(Capture&)>& spoil) {
    const test::Temporary folder;
    Capture capture = studio().capture;
    spoil(capture);
    save_capture(folder / "capture", capture);
    const test::Outcome outcome = run(words(folder / "capture", folder / "out"));
    INFO(outcome.err);
    INFO(outcome.out);
    CHECK(outcome.code == 1);
    CHECK(outcome.err.empty());
    const auto json = json_of(folder / "out/check.json");
    for (const auto& finding : json.at("findings")) {
        CHECK(outcome.out == test::contains(finding.at("text").get<std::string>()));
        CHECK(finding.at("help").get<std::string>().starts_with("docs/README.md#"));
    }
    CHECK(outcome.out == test::contains("\nread docs/README.md, \""));
    return json;
}
nlohmann::json findings(const std::function<void(Capture&)>& spoil) {
    return check_of(spoil).at("findings");
}

} // namespace

TEST_CASE("a good capture: figures, pictures, and nothing to complain about") {
    const test::Temporary folder;
    const fs::path out = folder / "out", other = folder / "other";
    const test::Outcome outcome = run(words(studio().path, out, {"--threads", "1"}));
    test::check_done(outcome);
    CHECK(outcome.out == test::contains("6 images of 3 cameras, mean IoU"));
    CHECK(outcome.out == test::contains("nothing suspicious"));
    const auto json = json_of(out / "check.json");
    CHECK(json.at("mean_iou") > 0.93); // images of 64 pixels
    CHECK(json.at("findings").empty());
    CHECK(json.at("warnings").empty());
    REQUIRE(json.at("images").size() == 6);
    REQUIRE(json.at("frames").size() == 2);
    CHECK(json.at("frames")[1].at("frame") == 1);
    CHECK(json.at("frames")[1].at("iou") > 0.9);
    CHECK(json["advice"].empty());
    CHECK(test::files_below(out) == 7);
    for (const auto& image : json.at("images")) {
        CHECK(image.at("iou") > 0.9);
        CHECK(image.at("mask") == "usable");
        CHECK(image.at("inside") == 1.0);
        CHECK(image.at("missing") == 0.0);
        CHECK(image.at("exposure").size() == 3);
        CHECK(image.at("background_removed") == true);
        const PixelImage overlay = read_image(out / image.at("overlay").get<std::string>());
        CHECK(overlay.width == 64);
        CHECK(shows(overlay, 255, 64, 64)); // bones of the left side
        CHECK(shows(overlay, 48, 224, 80)); // bones of the right side
        CHECK(shows(overlay, 0, 229, 255)); // the body's outline
    }
    // Results do not depend on the number of threads, nor on whether images are read when they are needed. Fewer frames
    // can be chosen. A run replaces earlier results.
    for (const auto& option : {std::vector<std::string>{"--threads", "2"}, {"--image-memory", "1"}}) {
        test::check_done(run(words(studio().path, other, option)));
        for (const auto& image : json.at("images")) {
            const auto name = image.at("overlay").get<std::string>();
            CHECK(read_file(out / name) == read_file(other / name));
        }
        CHECK(read_file(out / "check.json") == read_file(other / "check.json"));
    }
    test::check_done(run(words(studio().path, other, {"--frames", "1"})));
    CHECK(json_of(other / "check.json").at("images").size() == 3);
    CHECK(test::files_below(other) == 4); // pictures of the earlier run are gone
}

TEST_CASE("faults are named, and the exit code says that there are some") {
    const auto inverse = findings([](Capture& capture) {
        for (NamedCamera& named : capture.cameras)
            named.camera.t = named.camera.center(), named.camera.R = transpose(named.camera.R);
    });
    REQUIRE(inverse.size() == 1);
    CHECK(inverse[0].at("fault") == "camera-to-world");
    CHECK(inverse[0].at("given") < 0.3);
    CHECK(inverse[0].at("mended") > 0.93);
    CHECK(inverse[0].at("cameras").size() == 3);

    const auto opaque = check_of([](Capture& capture) {
        for (PixelImage& image : capture.images)
            for (std::size_t i = 3; i < image.data.size(); i += 4) image.data[i] = 255;
    });
    CHECK(opaque.at("mean_iou").is_null());

    const auto empty = findings([](Capture& capture) { capture.images[3] = PixelImage(4, 64, 64); });
    REQUIRE(empty.size() == 1);
    CHECK(empty[0].at("fault") == "empty-masks");
    REQUIRE(empty[0].at("images").size() == 1);
    CHECK(empty[0].at("images")[0].at("camera") == "cam01");
    CHECK(empty[0].at("images")[0].at("frame") == 1);
}

TEST_CASE("masks whose numbers are unclear are named by both programs, and an empty one costs only its photograph") {
    const test::Temporary folder;
    const fs::path path = folder / "capture", out = folder / "out", trained = folder / "trained";
    Capture capture = studio().capture;
    save_capture(path, capture);
    const auto write_masks = [&](std::uint8_t first, std::uint8_t second) { // one for each of two frames
        for (std::size_t i = 0; i < capture.images.size(); ++i) {
            const PixelImage& image = capture.images[i];
            PixelImage mask(1, image.height, image.width);
            for (std::size_t p = 0; p < mask.data.size(); ++p)
                mask.data[p] = image.data[4 * p + 3] < 128 ? std::uint8_t(0) : i % 2 ? second : first;
            const fs::path place = path / "masks" / capture.cameras[i / 2].name;
            fs::create_directories(place);
            write_png(place / (i % 2 ? "0001.png" : "0000.png"), mask);
        }
    };
    const std::vector<std::string> train = studio().reconstruct(trained, {"--steps", "5"}, path);
    write_masks(1, 2);
    for (const auto& line : {words(path, out), train})
        check_refused(run(line), line[0], {"masks/cam00/0000.png", "labels 0, 1, 2", "255 for the labels of people"});
    write_masks(128, 128);
    test::Outcome outcome = run(words(path, out));
    CHECK(outcome.code == 0);
    CHECK(outcome.err == test::contains("the masks of camera 'cam00' hold 0, 128 instead of 0 and 255"));
    CHECK(outcome.out == test::contains("nothing suspicious"));

    write_masks(255, 255);
    write_png(path / "masks/cam01/0001.png", PixelImage(1, 64, 64));
    outcome = run(words(path, out));
    CHECK(outcome.code == 1);
    CHECK(outcome.out == test::contains("empty-masks (cam01/1)"));
    CHECK(outcome.out == test::contains("training leaves these images out"));
    outcome = run(train);
    INFO(outcome.err);
    CHECK(outcome.code == 0);
    CHECK(outcome.err ==
          test::contains("1 of 6 photographs have an empty mask and are left out: images/cam01/0001.png"));
    CHECK(fs::exists(trained / "avatar.gsh"));
}

TEST_CASE("exposure that drifts is advice: printed, in the file, and no fault") {
    const test::Temporary folder;
    Capture capture = studio().capture;
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) { // the second of two images is darker by about a stop
        PixelImage& image = capture.images[2 * c + 1];
        for (std::size_t i = 0; i < image.data.size(); ++i)
            if (i % 4 != 3) image.data[i] = static_cast<std::uint8_t>(image.data[i] * 0.73);
    }
    save_capture(folder / "capture", capture);
    const test::Outcome outcome = run(words(folder / "capture", folder / "out"));
    test::check_done(outcome);
    CHECK(outcome.out == test::contains("exposure drifts from -0."));
    CHECK(outcome.out != test::contains("nothing suspicious"));
    const auto json = json_of(folder / "out/check.json");
    CHECK(json.at("findings").empty());
    REQUIRE(json.at("advice").size() == 1);
    CHECK(outcome.out == test::contains(json.at("advice")[0].at("text").get<std::string>()));
    CHECK(json.at("advice")[0].at("help") == "docs/README.md#brightness-and-colours-change-between-photographs");
    for (const auto& image : json.at("images"))
        CHECK(image.at("exposure")[1].get<double>() * (image.at("frame") == 0 ? 1 : -1) > 0.25);
}

TEST_CASE("several people are checked together, one of them alone if so wished") {
    const test::Temporary folder;
    const fs::path path = folder / "capture", out = folder / "out";
    Motion ann = actor_motion(ActorMotion::talk, 2), bob = actor_motion(ActorMotion::stride, 2);
    for (auto& v : ann.transl) v.x -= 0.6;
    for (auto& v : bob.transl) v.x += 0.6;
    cpu::Threads backend;
    StudioParams params;
    params.train_cameras = 2, params.image_size = 64, params.samples = 4, params.distance = 4;
    save_capture(path, film(backend, {{&studio().body, &ann}, {&studio().body, &bob}}, params));
    fs::remove(path / "poses.npz");
    save_motion(path / "ann.npz", ann);
    save_motion(path / "bob.npz", bob);
    test::check_done(run(words(path, out, {"--poses", "ann.npz,bob.npz"})));
    auto json = json_of(out / "check.json");
    CHECK(json.at("findings").empty());
    CHECK(json.at("warnings").empty());
    CHECK(json.at("mean_iou") > 0.9);
    REQUIRE(json.at("images").size() == 6);
    for (const auto& image : json.at("images")) {
        REQUIRE(image.at("people").size() == 2);
        CHECK(image.at("people")[1].at("name") == "bob");
        CHECK(image.at("people")[1].at("inside") > 0.95);
        CHECK(image.at("people")[1].at("covered") > 0.9);
    }

    for (auto& v : bob.transl) v *= 100.0; // centimetres
    save_motion(path / "bob.npz", bob);
    const test::Outcome outcome = run(words(path, out, {"--poses", "ann.npz", "--poses", "bob.npz"}));
    CHECK(outcome.code == 1);
    CHECK(outcome.err.empty());
    CHECK(outcome.out == test::contains("translation-units (poses of bob)"));
    CHECK(outcome.out == test::contains("\nperson "));
    json = json_of(out / "check.json");
    REQUIRE(json.at("findings").size() == 1);
    CHECK(json.at("findings")[0].at("people") == nlohmann::json{"bob"});
    CHECK(!json.at("findings")[0].contains("cameras"));

    // The masks show two people, so one alone does not match them.
    CHECK(run(words(path, out, {"--poses", "ann.npz,bob.npz", "--person", "0"})).code == 1);
    CHECK(!json_of(out / "check.json").at("images")[0].contains("people"));
    const auto refuse = [&](const std::vector<std::string>& more, std::initializer_list<std::string_view> said) {
        check_refused(run(words(path, folder / "none", more)), "gsh-check", said);
        CHECK(!fs::exists(folder / "none"));
    };
    refuse({"--poses", "ann.npz,bob.npz", "--person", "2"}, {"--person 2", "2 people"});
    refuse({"--poses", "ann.npz,bob.npz,ann.npz"}, {"ann.npz", "named twice"});
    refuse({"--poses", "ann.npz,,bob.npz"}, {"--poses", "empty"});
    refuse({"--poses", "ann.npz,cleo.npz"}, {"cleo.npz"});
    refuse({"--poses", "ann.npz," + studio().dance.string()}, {"dance.npz", "3", "expected 2"});
}

TEST_CASE_FIXTURE(test::Gala, "a layout that holds several people shows all of them, or the one that is asked for") {
    const fs::path out = folder / "out";
    const auto people_seen = [&](std::vector<std::string> more) {
        std::vector<std::string> line{"gsh-check", scene.string(), "--out", out.string()};
        line.insert(line.end(), more.begin(), more.end());
        const test::Outcome outcome = run(line);
        INFO(outcome.err);
        CHECK(outcome.code <= 1);
        CHECK(outcome.err.empty());
        const auto image = json_of(out / "check.json").at("images")[0];
        return image.contains("people") ? image.at("people").size() : 1;
    };
    CHECK(people_seen({}) == 2);
    CHECK(people_seen({"--person", "1"}) == 1);
    check_refused(run({"gsh-check", scene.string(), "--out", out.string(), "--person", "2"}), "gsh-check",
                  {"no person 2"});
}

TEST_CASE("input that cannot be checked is refused") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](const std::vector<std::string>& line, std::initializer_list<std::string_view> said) {
        check_refused(run(line), "gsh-check", said);
        CHECK(!fs::exists(out));
    };
    refuse({"gsh-check", "--out", out}, {"capture", "--help"});
    refuse({"gsh-check", studio().path, "--out", out}, {"--body", "required"});
    refuse(words(folder / "nowhere", out), {"nowhere", "not a folder"});
    refuse(words(studio().path, out, {"--poses", "other.npz"}), {"other.npz", "No such file"});
    refuse(words(studio().path, out, {"--poses", studio().dance}), {"2 images", "expected 3"});
    refuse(words(studio().path, out, {"--frames", "-1"}), {"--frames"});
    refuse(words(studio().path, out, {"--body", studio().body_file}), {"2 body models for 1 people"});
    const test::Outcome help = run({"gsh-check", "--help"});
    CHECK(help.code == 0);
    CHECK(help.out == test::contains("--frames"));
}
