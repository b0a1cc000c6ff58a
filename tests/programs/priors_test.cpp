// SPDX-License-Identifier: Apache-2.0
/// @file  Maps of an estimator as input of gsh-reconstruct and gsh-evaluate.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/prior/prior_view.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::run;
using test::studio;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

/// An estimator's maps of frame 1 from cam00, normals.png (y up; grey pixels are empty) and depth.npy, and their list.
struct Estimates {
    test::Temporary folder;
    fs::path list = folder / "estimates.json";

    Estimates() {
        const test::SmallCapture& s = studio();
        const Motion& motion = s.capture.motion;
        const Camera<double>& camera = s.capture.cameras[0].camera;
        const auto vertices =
            pose_body(s.body, motion.pose_at(1), motion.transl[1], motion.betas, motion.expression_at(1)).vertices;
        cpu::Serial backend;
        const PriorView normals = normal_view(backend, vertices, s.body.faces, camera);
        PixelImage picture(3, camera.height, camera.width);
        std::fill(picture.data.begin(), picture.data.end(), std::uint8_t(128));
        const double sign[3] = {1, -1, -1};
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x)
                for (int c = 0; c < 3 && normals.map.mask.at(0, y, x); ++c)
                    picture.pixel(y, x)[c] =
                        static_cast<std::uint8_t>(std::lround((sign[c] * normals.map.values.at(c, y, x) + 1) * 127.5));
        write_png(folder / "normals.png", picture);
        const PriorView depth = depth_view(backend, vertices, s.body.faces, camera);
        write_npy<double>(folder / "depth.npy", depth.map.values.data,
                          {static_cast<std::size_t>(camera.height), static_cast<std::size_t>(camera.width)});
        write("{}");
    }
    /// The list with one view, of the normals with these changes.
    void write(const std::string& changes) const {
        Json view{{"normals", "normals.png"}, {"camera", "cam00"}, {"frame", 1}};
        view.merge_patch(Json::parse(changes));
        write_file(list, Json{{"views", {view}}}.dump());
    }
};

test::Outcome reconstruct(const fs::path& out, const Estimates& estimates, std::vector<std::string> more) {
    more.insert(more.begin(), {"--priors", estimates.list.string()});
    return run(studio().reconstruct(out, more));
}

} // namespace

TEST_CASE("an estimator's maps change the avatar, and a checkpoint is theirs") {
    const Estimates estimates;
    const test::Temporary folder;
    const fs::path plain = folder / "plain", normals = folder / "normals", both = folder / "both",
                   given = folder / "given";
    check_done(run(studio().reconstruct(plain, {"--steps", "3"})));
    check_done(reconstruct(normals, estimates, {"--steps", "3"}));
    const auto protocol = [](const fs::path& out) {
        return test::json_of(out / "metrics.json").at("protocol").get<std::string>();
    };
    CHECK(protocol(normals) == test::contains("geometric priors of estimates.json"));
    CHECK(protocol(plain) != test::contains("priors"));
    CHECK(!test::same_file(plain / "avatar.gsh", normals / "avatar.gsh"));

    // Training resumes only with the same maps.
    check_done(reconstruct(normals, estimates, {"--steps", "5", "--resume"}));
    check_done(run(studio().reconstruct(normals, {"--steps", "6", "--resume"}))); // those of the checkpoint
    estimates.write(R"({"integrate": true})");
    check_refused(reconstruct(normals, estimates, {"--steps", "6", "--resume"}), "gsh-reconstruct",
                  {"checkpoint.gsh", "--priors"});

    check_done(reconstruct(both, estimates, {"--steps", "3"}));
    CHECK(!test::same_file(normals / "avatar.gsh", both / "avatar.gsh"));
    estimates.write(R"({"depth": "depth.npy", "person": 0})");
    check_done(reconstruct(given, estimates, {"--steps", "3", "--set", "joints=trunk_and_limbs"}));
}

TEST_CASE("rows with an estimator's maps stand beside those without") {
    const Estimates estimates;
    const test::Temporary folder;
    const fs::path out = folder / "out";
    for (const char* name : {"paper", "baseline"})
        write_file(folder / (std::string(name) + ".json"),
                   Json{{"configuration", name}, {"hash.table_size", 1024}, {"ao.table_size", 1024}}.dump());
    const auto evaluate = [&](const std::string& names, std::vector<std::string> more) {
        std::string configs;
        for (const char* name : {"paper", "baseline"})
            if (names.find(name) != std::string::npos)
                configs += (configs.empty() ? "" : ",") + (folder / (std::string(name) + ".json")).string();
        more.insert(more.begin(),
                    {"gsh-evaluate", "--capture", studio().path.string(), "--body", studio().body_file.string(),
                     "--configs", configs, "--out", out.string(), "--gaussians", "300", "--steps", "2"});
        return run(more);
    };
    const std::vector<std::string> with{"--priors", estimates.list.string()};
    check_refused(evaluate("baseline", with), "gsh-evaluate", {"--priors", "no effect"});
    CHECK(!fs::exists(out));
    check_done(evaluate("paper, baseline", {}));
    const test::Outcome second = evaluate("paper, baseline", with);
    check_done(second);
    // The baseline has no priors in either case.
    CHECK(second.out == test::contains("baseline: is finished already"));
    CHECK(second.out == test::contains("paper, priors of estimates, 2 steps"));
    const Json figures = Json::parse(read_file(out / "tables.json")).at("figures");
    REQUIRE(figures.size() == 3);
    CHECK(figures[2].at("name") == "paper, priors of estimates");
    CHECK(figures[2].at("psnr") != figures[0].at("psnr"));
    CHECK(figures[2].at("protocol").get<std::string>() == test::contains("geometric priors of estimates.json"));
    // With other maps, the row is computed again.
    estimates.write(R"({"integrate": true})");
    const test::Outcome third = evaluate("paper", with);
    check_done(third);
    CHECK(third.out == test::contains("was judged with other settings"));
}

TEST_CASE("maps that cannot be meant are refused before training") {
    const Estimates estimates;
    const test::Temporary folder;
    const fs::path out = folder / "out";
    const auto refuse = [&](const std::string& changes, std::initializer_list<std::string_view> words) {
        CAPTURE(changes);
        estimates.write(changes);
        check_refused(reconstruct(out, estimates, {"--steps", "1"}), "gsh-reconstruct", words);
        CHECK(!fs::exists(out));
    };
    refuse(R"({"normals": "none.png"})", {"estimates.json: views[0]", "none.png", "No such file"});
    refuse(R"({"normal": "normals.png"})", {"estimates.json: views[0]", "unknown field 'normal'"});
    refuse(R"({"encoding": "opencv"})", {"views[0]", "normals.png", "away from the viewer", "encoding"});
    refuse(R"({"encoding": "up"})", {"views[0]", "encoding is 'up'", "y_up"});
    refuse(R"({"camera": "cam07"})", {"views[0]", "'cam07'", "cam00, cam01, test00"});
    refuse(R"({"frame": 2})", {"views[0]", "frame is 2", "2 frames"});
    refuse(R"({"person": "eve"})", {"views[0]", "'eve'", "poses"});
    refuse(R"({"camera": "cam01", "crop": [200, 200, 64, 64]})", {"views[0]", "its camera sees nothing of the body"});
    refuse(R"({"camera": {"width": 32, "height": 64, "scale": 30, "cx": 16, "cy": 32,)"
           R"( "R": [1, 0, 0, 0, -1, 0, 0, 0, -1], "t": [0, 1, 2]}})",
           {"normals.png is 64 x 64 pixels", "32 x 64", "crop"});
    fs::remove(estimates.list);
    check_refused(reconstruct(out, estimates, {"--steps", "1"}), "gsh-reconstruct", {"estimates.json", "No such file"});
    check_refused(reconstruct(out, estimates, {"--config", "baseline"}), "gsh-reconstruct", {"--priors has no effect"});
    check_refused(run({"gsh-reconstruct", "--capture", studio().path.string(), "--config", "static", "--out",
                       out.string(), "--priors", estimates.list.string()}),
                  "gsh-reconstruct", {"--priors", "static"});
    CHECK(!fs::exists(out));
}
