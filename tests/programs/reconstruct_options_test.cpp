// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/reconstruct_options.hpp"

#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <string>

using namespace gsh;
using programs::default_gaussians;
using programs::ReconstructOptions;

TEST_CASE("a short training of the CPU has fewer Gaussians, if nobody says how many") {
    const auto count = [](double seconds, std::size_t threads, const char* backend = "threads", std::size_t people = 1,
                          bool synthetic = false) {
        ReconstructOptions o;
        o.seconds = seconds, o.machine.threads = threads, o.machine.backend = backend, o.synthetic = synthetic;
        o.poses.assign(people, "poses.npz");
        return default_gaussians(o);
    };
    CHECK(count(0, 2) == 170000); // no limit
    CHECK(count(30, 2) == 170000);
    CHECK(count(1000, 2) == 170000);
    CHECK(count(5, 2) == 44000);
    CHECK(count(10, 2) == 74000);
    CHECK(count(10, 1) == count(5, 2));               // what counts is the time of all threads
    CHECK(count(10, 2, "threads", 2) == count(5, 2)); // of which each person has a share
    CHECK(count(5, 16) == 170000);
    CHECK(count(0.01, 1) == 5000);
    CHECK(count(5, 2, "cuda") == 170000);
    CHECK(count(0, 2, "threads", 1, true) == 60000);
    CHECK(count(5, 2, "threads", 1, true) == 44000);
    CHECK(count(30, 2, "threads", 1, true) == 60000);
}

TEST_CASE("a training by time that is resumed keeps its number of Gaussians") {
    const test::SmallCapture& s = test::studio();
    const test::Temporary folder;
    const auto words = [&](const std::vector<std::string>& more) {
        std::vector<std::string> all{"gsh-reconstruct",     "--capture", s.path.string(),           "--body",
                                     s.body_file.string(),  "--out",     (folder / "out").string(), "--set",
                                     "hash.table_size=4096"};
        all.insert(all.end(), more.begin(), more.end());
        return all;
    };
    test::check_done(test::run(words({"--seconds", "0.3", "--threads", "1"})));
    const auto count = [&] { return test::json_of(folder / "out/metrics.json").at("gaussians").get<std::size_t>(); };
    const std::size_t first = count();
    CHECK(first <= 5100); // 5000 are asked for, and drawn by density
    test::check_done(
        test::run(words({"--resume", "--seconds", "0.5", "--threads", "8"}))); // a new run would have 17,000
    CHECK(count() == first);
}
