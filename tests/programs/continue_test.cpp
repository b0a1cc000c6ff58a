// SPDX-License-Identifier: Apache-2.0
/// gsh-reconstruct --continue goes on from a checkpoint of the same run, and begins where there is none.
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>

#include <csignal>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

constexpr const char* continued_steps = "60";

test::Outcome go_on(const fs::path& out, std::vector<std::string> more = {}) {
    more.insert(more.end(), {"--continue", "--steps", continued_steps});
    return test::run(test::studio().reconstruct(out, more));
}

/// A folder in which a training was stopped in its middle by SIGTERM.
void stop_training(const fs::path& out) {
    test::Process process(
        test::studio().reconstruct(out, {"--continue", "--steps", continued_steps, "--checkpoint-interval", "1e-9"}));
    REQUIRE(process.wait_until([&] { return fs::exists(out / "checkpoint.before.gsh"); }));
    for (int k = 0; k < 3; ++k) process.send(SIGTERM); // a scheduler tells a job and each of its processes
    CHECK(!process.wait_until([&] { return fs::exists(out / "results.partial"); }, 100)); // it hurries
    REQUIRE(process.wait().code == 130);
}

} // namespace

TEST_CASE("--continue begins without a checkpoint, and goes on after a stop with the same bits") {
    const test::Temporary folder;
    const fs::path whole = folder / "whole", stopped = folder / "stopped";
    check_done(go_on(whole));
    stop_training(stopped);
    const test::Outcome again = go_on(stopped, {"--threads", "1"}); // another machine may have fewer
    check_done(again);
    CHECK(read_file(whole / "avatar.gsh") == read_file(stopped / "avatar.gsh"));
    CHECK(again.err != test::contains("step 1 ")); // it did not begin anew
    check_done(go_on(stopped));                    // a run that is complete is only judged once more
    CHECK(read_file(whole / "avatar.gsh") == read_file(stopped / "avatar.gsh"));
}

TEST_CASE("--continue begins anew, with a warning, where a checkpoint is of another run or damaged") {
    const test::Temporary folder;
    const fs::path other = folder / "other", out = folder / "out";
    check_done(test::run(test::studio().reconstruct(other, {"--steps", continued_steps, "--seed", "5"})));
    stop_training(out);
    const test::Outcome seeded = go_on(out, {"--seed", "5"});
    CHECK(seeded.code == 0);
    CHECK(seeded.err == test::contains("checkpoint.gsh: is of a run with other options; training begins anew"));
    CHECK(read_file(out / "avatar.gsh") == read_file(other / "avatar.gsh"));

    for (const char* name : {"checkpoint.gsh", "checkpoint.before.gsh"}) write_file(out / name, "not a checkpoint");
    const test::Outcome damaged = go_on(out, {"--seed", "5"});
    CHECK(damaged.code == 0);
    CHECK(damaged.err == test::contains("training begins anew"));
    CHECK(read_file(out / "avatar.gsh") == read_file(other / "avatar.gsh"));

    stop_training(out);
    write_file(out / "checkpoint.gsh", "not a checkpoint");
    const test::Outcome before = go_on(out);
    CHECK(before.code == 0);
    CHECK(before.err == test::contains("the run goes on from the checkpoint before it"));
}

TEST_CASE("--continue and --resume exclude each other") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    stop_training(out);
    check_refused(test::run({"gsh-reconstruct", "--out", out.string(), "--resume", "--continue"}), "gsh-reconstruct",
                  {"--resume and --continue exclude each other"});
}
