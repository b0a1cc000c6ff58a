// SPDX-License-Identifier: Apache-2.0
/// @file  A span of the motion that is left out of training and judged separately, as a user asks for it.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::json_of;
using test::run;
using test::same_file;
using test::studio;
namespace fs = std::filesystem;

namespace {

/// Two training cameras and a test camera, four frames; and the same with one camera alone, frame 1 kept for the test.
struct FourFrames {
    test::Temporary folder;
    fs::path path = folder / "capture", single = folder / "single";
    Capture capture;

    FourFrames() {
        cpu::Threads backend;
        StudioParams ring;
        ring.train_cameras = 2, ring.image_size = 64, ring.samples = 4;
        capture = film(backend, studio().body, actor_motion(ActorMotion::talk, 4), ring);
        save_capture(path, capture);
        Capture one = capture;
        one.cameras.resize(1);
        one.images.resize(4);
        one.test_frames = {1};
        save_capture(single, one);
    }
    /// gsh-reconstruct in two steps.
    [[nodiscard]] test::Outcome reconstruct(const fs::path& out, std::vector<std::string> more,
                                            const fs::path& of = {}) const {
        if (std::find(more.begin(), more.end(), "--steps") == more.end()) more.insert(more.end(), {"--steps", "2"});
        return run(studio().reconstruct(out, more, of.empty() ? path : of));
    }
};
const FourFrames& four_frames() {
    static const FourFrames instance;
    return instance;
}

std::size_t count_of(const nlohmann::json& metrics, const char* motion) {
    return static_cast<std::size_t>(std::count_if(metrics.at("images").begin(), metrics.at("images").end(),
                                                  [&](const auto& image) { return image.at("motion") == motion; }));
}

} // namespace

TEST_CASE("seen and new motion have figures of their own, printed, in the file and on the page") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const test::Outcome outcome = s.reconstruct(out, {"--hold-out-motion", "0.25"});
    check_done(outcome);
    CHECK(outcome.out == test::contains("6 training and 4 test images"));
    for (const char* words : {"| motion |", "| seen   |", "| new    |"}) CHECK(outcome.out == test::contains(words));

    const auto metrics = json_of(out / "metrics.json");
    CHECK(metrics.at("held_out_frames") == std::vector<int>{3});
    const auto &seen = metrics.at("seen_motion"), &unseen = metrics.at("new_motion");
    CHECK(seen.at("images") == 3);
    CHECK(unseen.at("images") == 1);
    for (const auto* figures : {&seen, &unseen}) {
        for (const char* key : {"psnr", "ssim", "psnr_person"}) CHECK(figures->at(key).is_number());
        for (const char* region : {"face", "hands", "body"}) CHECK(figures->at("psnr_regions").contains(region));
        CHECK(!figures->contains("lpips"));
    }
    for (const char* key : {"psnr", "ssim", "psnr_person"}) {
        const auto number = [&](const auto& json) { return json.at(key).template get<double>(); };
        CHECK((3 * number(seen) + number(unseen)) / 4 == doctest::Approx(number(metrics)));
        CHECK(number(unseen) == doctest::Approx(number(metrics.at("images")[3])));
    }
    CHECK(count_of(metrics, "seen") == 3);
    CHECK(metrics.at("images")[3].at("name") == "test00_0003");
    CHECK(metrics.at("images")[3].at("motion") == "new");
    CHECK(metrics.at("protocol").get<std::string>() ==
          test::contains(
              "Frames 3 of 4 are left out of training in every camera: new motion is judged on their 1 test images, "
              "seen motion on 3 test images of frames in training."));
    const std::string page = read_file(out / "report.html");
    CHECK(page == test::contains("Seen and new motion"));
    CHECK(page == test::contains("<td>new</td>"));

    const fs::path plain = folder / "plain";
    check_done(s.reconstruct(plain, {}));
    for (const char* key : {"seen_motion", "new_motion", "held_out_frames"})
        CHECK(!json_of(plain / "metrics.json").contains(key));
    CHECK(!json_of(plain / "metrics.json").at("images")[3].contains("motion"));
    CHECK(read_file(plain / "report.html") != test::contains("new motion"));
    CHECK(!same_file(plain / "avatar.gsh", out / "avatar.gsh"));
}

TEST_CASE("nothing in the photographs of the span has an effect on the avatar") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    Capture other = s.capture; // other colours in frame 3 of every camera
    for (std::size_t c = 0; c < other.cameras.size(); ++c)
        for (std::size_t i = 0; i < other.images[4 * c + 3].data.size(); ++i)
            if (i % 4 != 3) other.images[4 * c + 3].data[i] = static_cast<std::uint8_t>(i * 7);
    save_capture(folder / "capture", other);
    for (const std::vector<std::string>& more :
         {std::vector<std::string>{}, {"--config", "paper"}, {"--refine", "--set", "refine.transl.start=0"}}) {
        const fs::path a = folder / "a", b = folder / "b";
        for (const auto& [out, capture] : {std::pair(a, s.path), {b, folder / "capture"}}) {
            std::vector<std::string> words{"--hold-out-motion", "3:3", "--steps", "8"};
            words.insert(words.end(), more.begin(), more.end());
            check_done(s.reconstruct(out, words, capture));
        }
        CHECK(same_file(a / "avatar.gsh", b / "avatar.gsh"));
        CHECK(json_of(a / "metrics.json").at("seen_motion") == json_of(b / "metrics.json").at("seen_motion"));
        CHECK(json_of(a / "metrics.json").at("new_motion") != json_of(b / "metrics.json").at("new_motion"));
        if (more.empty() || more[0] != "--refine") continue;
        CHECK(same_file(a / "poses_refined.npz", b / "poses_refined.npz"));
        // At the end of the motion, a frame has the corrections of the last frame in training.
        const Motion given = s.capture.motion, refined = load_motion(a / "poses_refined.npz", studio().body);
        const vec3<double> last = refined.transl[2] - given.transl[2], beyond = refined.transl[3] - given.transl[3];
        CHECK(length(last) > 0);
        CHECK(length(last - beyond) < 1e-6);
    }
}

TEST_CASE("a checkpoint belongs to the frames that were left out, however they were named") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    const fs::path out = folder / "out", whole = folder / "whole";
    check_done(s.reconstruct(out, {"--hold-out-motion", "0.25"}));
    check_refused(
        s.reconstruct(out, {"--hold-out-motion", "0.5", "--resume", "--steps", "4"}), "gsh-reconstruct",
        {"checkpoint.gsh", "'held-out frames 3' where this run has 'held-out frames 2-3'", "--hold-out-motion"});
    check_done(s.reconstruct(out, {"--hold-out-motion", "3:3", "--resume"}));
    check_done(s.reconstruct(whole, {"--hold-out-motion", "3:3"}));
    CHECK(same_file(out / "avatar.gsh", whole / "avatar.gsh"));
    check_done(s.reconstruct(out, {"--resume", "--steps", "4"})); // the span is that of the checkpoint
    CHECK(json_of(out / "metrics.json").at("held_out_frames") == std::vector<std::size_t>{3});
}

TEST_CASE("one camera judges new motion by its photographs of the span, seen motion between frames in training") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    check_done(s.reconstruct(out, {"--hold-out-motion", "3:3"}, s.single));
    auto metrics = json_of(out / "metrics.json");
    CHECK(metrics.at("seen_motion").at("images") == 1);
    CHECK(metrics.at("new_motion").at("images") == 1);
    CHECK(metrics.at("images")[0].at("name") == "cam00_0001");
    CHECK(metrics.at("images")[0].at("motion") == "seen");
    CHECK(metrics.at("images")[1].at("name") == "cam00_0003");
    CHECK(metrics.at("images")[1].at("motion") == "new");
    CHECK(metrics.at("protocol").get<std::string>() ==
          test::contains("seen motion on 1 test images between frames in training"));

    // Frame 1 is in the span: nothing is left that shows seen motion.
    const test::Outcome outcome = s.reconstruct(out, {"--hold-out-motion", "1:3"}, s.single);
    check_done(outcome);
    CHECK(outcome.out == test::contains("| seen   | none"));
    metrics = json_of(out / "metrics.json");
    CHECK(metrics.at("seen_motion").at("images") == 0);
    CHECK(metrics.at("seen_motion").at("psnr").is_null());
    CHECK(metrics.at("seen_motion").at("psnr_regions").at("body").is_null());
    CHECK(metrics.at("new_motion").at("images") == 3);
    CHECK(metrics.at("protocol").get<std::string>() == test::contains("seen motion on none"));
}

TEST_CASE("spans that are none are refused in a line") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](const char* span, std::initializer_list<std::string_view> said, const fs::path& of = {}) {
        check_refused(s.reconstruct(out, {"--hold-out-motion", span}, of), "gsh-reconstruct", said);
        CHECK(!fs::exists(out));
    };
    for (const char* span :
         {"0", "1", "1.5", "-0.5", "nan", "much", "", " ", "0.25 ", "3:", ":3", ":", "0.5:1", "-1:2", "1:2:3", "1-2"})
        refuse(span, {"--hold-out-motion", "above 0 and below 1 such as 0.25", "such as 20:29"});
    refuse("0.1", {"--hold-out-motion 0.1", "none of 4 frames"});
    refuse("0.9", {"--hold-out-motion 0.9", "all of 4 frames"});
    refuse("2:4", {"--hold-out-motion 2:4", "frame 4 of 4 frames", "from 0 to 3"});
    refuse("3:2", {"--hold-out-motion 3:2", "frame 3", "later than frame 2"});
    refuse("0:3", {"--hold-out-motion 0:3", "all of 4 frames"});
    {
        Capture capture = s.capture; // frames 0 and 1 are for the test: frames 2 and 3 are all that training has
        capture.test_frames = {0, 1};
        save_capture(folder / "kept", capture);
        refuse("0.5", {"--hold-out-motion 0.5", "no view for training", "kept"}, folder / "kept");
    }
    check_refused(run({"gsh-reconstruct", "--config", "static", "--capture", s.path.string(), "--out", out.string(),
                       "--hold-out-motion", "0.25"}),
                  "gsh-reconstruct", {"--config static has no --hold-out-motion"});

    // A map that an estimator made of a photograph in the span would bring it back into training.
    PixelImage normals(3, 64, 64); // towards the camera everywhere
    for (std::size_t i = 0; i < normals.data.size(); ++i) normals.data[i] = i % 3 == 2 ? 255 : 128;
    write_png(folder / "normals.png", normals);
    write_file(folder / "priors.json", R"({"views": [{"normals": "normals.png", "camera": "cam00", "frame": 3}]})");
    check_refused(s.reconstruct(out, {"--priors", (folder / "priors.json").string(), "--hold-out-motion", "0.25"}),
                  "gsh-reconstruct", {"priors.json", "frame 3", "--hold-out-motion"});
    CHECK(!fs::exists(out));
}

TEST_CASE("an evaluation has a table of seen and new motion, and belongs to one span") {
    const FourFrames& s = four_frames();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    std::string configs;
    for (const char* name : {"paper", "no-ao"}) {
        const fs::path file = folder / (std::string(name) + ".json");
        write_file(file,
                   nlohmann::json{{"configuration", name}, {"hash.table_size", 1024}, {"ao.table_size", 1024}}.dump());
        configs += (configs.empty() ? "" : ",") + file.string();
    }
    const auto evaluate = [&](const std::string& list, std::vector<std::string> more) {
        more.insert(more.begin(), {"gsh-evaluate", "--capture", s.path.string(), "--body", studio().body_file.string(),
                                   "--configs", list, "--out", out.string(), "--gaussians", "300", "--steps", "1,2"});
        return run(more);
    };
    check_refused(evaluate("static", {"--hold-out-motion", "0.25"}), "gsh-evaluate", {"static", "--hold-out-motion"});
    check_refused(evaluate(configs, {"--hold-out-motion", "2"}), "gsh-evaluate", {"--hold-out-motion 2", "0.25"});
    CHECK(!fs::exists(out));
    const test::Outcome outcome = evaluate(configs, {"--hold-out-motion", "0.50"});
    check_done(outcome);
    for (const char* words : {"## Seen and new motion", "| paper         | 2 steps      | new    |"})
        CHECK(outcome.out == test::contains(words));
    const auto tables = json_of(out / "tables.json");
    REQUIRE(tables.at("figures").size() == 4);
    for (const auto& row : tables.at("figures")) {
        CHECK(row.at("seen_motion").at("images") == 2);
        CHECK(row.at("new_motion").at("images") == 2);
        CHECK(row.at("new_motion").at("psnr_person").is_number());
        CHECK(row.at("seen_motion").at("psnr_regions").contains("hands"));
        CHECK(count_of(row, "new") == 2);
        const auto psnr = [](const auto& json) { return json.at("psnr").template get<double>(); };
        CHECK((psnr(row.at("seen_motion")) + psnr(row.at("new_motion"))) / 2 == doctest::Approx(psnr(row)));
    }
    CHECK(read_file(out / "report.html") == test::contains("Seen and new motion"));

    const test::Outcome again = evaluate(configs, {"--hold-out-motion", "0.5"}); // the same, read from the files
    check_done(again);
    CHECK(again.out.find("paper: is finished already") == 0);
    CHECK(json_of(out / "tables.json") == tables);
    check_refused(evaluate(configs, {}), "gsh-evaluate", {"evaluation.json", "--hold-out-motion '0.5', not ''"});
    check_refused(evaluate(configs, {"--hold-out-motion", "2:3"}), "gsh-evaluate",
                  {"evaluation.json", "--hold-out-motion '0.5', not '2:3'"});
}
