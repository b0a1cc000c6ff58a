// SPDX-License-Identifier: Apache-2.0
/// gsh-reconstruct --plan prints what a run then takes, writes nothing, and refuses what the run would refuse.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// The plan of a reconstruction, which leaves no folder.
nlohmann::json plan_of_run(std::vector<std::string> more, const std::string& gaussians = "1500") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    more.push_back("--plan");
    std::vector<std::string> words = test::studio().reconstruct(out, more);
    *std::next(std::find(words.begin(), words.end(), "--gaussians")) = gaussians;
    const test::Outcome outcome = test::run(words);
    check_done(outcome);
    CHECK(!fs::exists(out));
    return nlohmann::json::parse(outcome.out);
}

} // namespace

TEST_CASE("a plan holds the figures of the run") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    for (const std::string config : {"light", "paper"}) {
        CAPTURE(config);
        const std::vector<std::string> options{"--config", config, "--steps", "30", "--threads", "1"};
        const nlohmann::json planned = plan_of_run(options);
        check_done(test::run(test::studio().reconstruct(out, options)));
        const nlohmann::json metrics = nlohmann::json::parse(read_file(out / "metrics.json"));
        for (const char* key : {"gaussians", "steps", "threads", "backend", "configuration"})
            CHECK(planned.at(key) == metrics.at(key));
        CHECK(planned.at("people") == 1);
        CHECK(planned.at("cameras") == 3);
        CHECK(planned.at("frames") == 2);
        CHECK(planned.at("training_images") == 4);
        CHECK(planned.at("test_images") == metrics.at("images").size());
        CHECK(planned.at("image_bytes") == 3 * 2 * 64 * 64 * 4);
        const double ratio = planned.at("memory_bytes").get<double>() / metrics.at("peak_memory_bytes").get<double>();
        CAPTURE(ratio);
        CHECK(ratio > 0.6); // nearly all of so small a training is code and libraries
        CHECK(ratio < 1.7);
        double sum = 0;
        for (const auto& [stage, seconds] : planned.at("seconds_of").items()) sum += seconds.get<double>();
        CHECK(planned.at("seconds").get<double>() == doctest::Approx(sum));
    }
}

TEST_CASE("a plan grows with what is asked for") {
    const nlohmann::json small = plan_of_run({}), larger = plan_of_run({}, "100000"),
                         longer = plan_of_run({"--steps", "6000"}), timed = plan_of_run({"--seconds", "7"}),
                         refined = plan_of_run({"--refine"}), more = plan_of_run({"--threads", "2"}),
                         one = plan_of_run({"--threads", "1"});
    CHECK(larger.at("gaussians") == 100000);
    CHECK(larger.at("memory_bytes") > small.at("memory_bytes"));
    CHECK(larger.at("seconds") > small.at("seconds"));
    CHECK(longer.at("seconds") > small.at("seconds"));
    CHECK(timed.at("seconds_of").at("training") == 7);
    CHECK(!timed.contains("steps"));
    CHECK(refined.at("seconds_of").at("registration") > 0);
    CHECK(small.at("seconds_of").at("registration") == 0);
    CHECK(one.at("seconds_of").at("training") > more.at("seconds_of").at("training"));
    const std::size_t half =
        (small.at("memory_bytes").get<std::size_t>() + larger.at("memory_bytes").get<std::size_t>()) / 2;
    const nlohmann::json limited = plan_of_run({"--max-memory", std::to_string(half)}, "100000");
    CHECK(limited.at("gaussians") < 100000);
    CHECK(limited.at("memory_bytes") <= half);
}

TEST_CASE("a plan of training on a GPU needs none") {
    const nlohmann::json planned = plan_of_run({"--backend", "cuda"});
    CHECK(planned.at("backend") == "cuda");
    CHECK(planned.at("device_memory_bytes") > 15'000'000);
    CHECK(planned.at("memory_bytes") > planned.at("device_memory_bytes"));
}

TEST_CASE("a plan needs no folder for results, and other runs do") {
    std::vector<std::string> words = test::studio().reconstruct("none", {"--plan"});
    const auto out = std::find(words.begin(), words.end(), "--out");
    words.erase(out, out + 2);
    check_done(test::run(words));
    words.pop_back();
    check_refused(test::run(words), "gsh-reconstruct", {"--out"});
}

TEST_CASE("a plan refuses what the run would refuse") {
    const test::SmallCapture& s = test::studio();
    check_refused(test::run(s.reconstruct("none", {"--plan", "--resume"})), "gsh-reconstruct", {"--resume"});
    check_refused(test::run(s.reconstruct("none", {"--plan", "--max-memory", "1000"})), "gsh-reconstruct",
                  {"--max-memory", "too little"});
    check_refused(test::run(s.reconstruct("none", {"--plan"}, s.folder / "nowhere")), "gsh-reconstruct", {"nowhere"});
    check_refused(test::run({"gsh-reconstruct", "--capture", s.path.string(), "--config", "static", "--plan"}),
                  "gsh-reconstruct", {"static", "--plan"});
}
