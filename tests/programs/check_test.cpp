// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-check as a user runs it: pictures, figures, findings and exit codes.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <gsh/io/image_file.hpp>

#include <nlohmann/json.hpp>

#include <cstddef>
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

/// Checks a capture that is not what it should be: exit code 1, and the findings.
nlohmann::json findings(const std::function<void(Capture&)>& spoil) {
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
    for (const auto& finding : json.at("findings"))
        CHECK(outcome.out.find(finding.at("text").get<std::string>()) != std::string::npos);
    return json.at("findings");
}

} // namespace

TEST_CASE("a good capture: figures, pictures, and nothing to complain about") {
    const test::Temporary folder;
    const fs::path out = folder / "out", other = folder / "other";
    const test::Outcome outcome = run(words(studio().path, out, {"--threads", "1"}));
    test::check_done(outcome);
    CHECK(outcome.out.find("6 images of 3 cameras, mean IoU") != std::string::npos);
    CHECK(outcome.out.find("nothing suspicious") != std::string::npos);
    const auto json = json_of(out / "check.json");
    CHECK(json.at("mean_iou") > 0.93); // of 64 pixels
    CHECK(json.at("findings").empty());
    CHECK(json.at("warnings").empty());
    REQUIRE(json.at("images").size() == 6);
    CHECK(test::files_below(out) == 7);
    for (const auto& image : json.at("images")) {
        CHECK(image.at("iou") > 0.9);
        CHECK(image.at("mask") == "usable");
        CHECK(image.at("inside") == 1.0);
        const PixelImage overlay = read_image(out / image.at("overlay").get<std::string>());
        CHECK(overlay.width == 64);
        CHECK(shows(overlay, 255, 64, 64)); // bones at the left
        CHECK(shows(overlay, 48, 224, 80)); // at the right
        CHECK(shows(overlay, 0, 229, 255)); // the body's outline
    }
    // The same on any number of threads; fewer frames if so wished; a run replaces what an earlier one left.
    test::check_done(run(words(studio().path, other, {"--threads", "2"})));
    for (const auto& image : json.at("images")) {
        const auto name = image.at("overlay").get<std::string>();
        CHECK(read_file(out / name) == read_file(other / name));
    }
    CHECK(read_file(out / "check.json") == read_file(other / "check.json"));
    test::check_done(run(words(studio().path, other, {"--frames", "1"})));
    CHECK(json_of(other / "check.json").at("images").size() == 3);
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

    const auto empty = findings([](Capture& capture) { capture.images[3] = PixelImage(4, 64, 64); });
    REQUIRE(empty.size() == 1);
    CHECK(empty[0].at("fault") == "empty-masks");
    REQUIRE(empty[0].at("images").size() == 1);
    CHECK(empty[0].at("images")[0].at("camera") == "cam01");
    CHECK(empty[0].at("images")[0].at("frame") == 1);
}

TEST_CASE("input that cannot be checked is refused") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](const std::vector<std::string>& line, std::initializer_list<std::string_view> said) {
        check_refused(run(line), "gsh-check", said);
        CHECK(!fs::exists(out));
    };
    refuse({"gsh-check", "--out", out}, {"capture", "--help"});
    refuse({"gsh-check", studio().path, "--out", out}, {"body model"});
    refuse(words(folder / "nowhere", out), {"nowhere", "not a folder"});
    refuse(words(studio().path, out, {"--poses", "other.npz"}), {"other.npz", "No such file"});
    refuse(words(studio().path, out, {"--poses", studio().dance}), {"2 images", "expected 3"});
    refuse(words(studio().path, out, {"--frames", "-1"}), {"--frames"});
    refuse(words(studio().path, out, {"--body", studio().camera}), {"--body"});
    const test::Outcome help = run({"gsh-check", "--help"});
    CHECK(help.code == 0);
    CHECK(help.out.find("--frames") != std::string::npos);
}
