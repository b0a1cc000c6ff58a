// SPDX-License-Identifier: Apache-2.0
/// Calls to the system fail, each in turn, in gsh-fit and gsh-video. gsh-fit ends with an error in one line and the old
/// results, or with the new ones. gsh-video keeps what its stages have made: the same command then ends with what it
/// would have made. GSH_ALL_FAILURES is the long form; without it, a sample.
#include "programs/every_program.hpp"
#include "programs/failing_calls.hpp"
#include "programs/filmed_turn.hpp"
#include "programs/process.hpp"

#include <gsh/io/file/atomic_file.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::all_failures;
using test::FailingCall;
using test::FolderState;
namespace fs = std::filesystem;

namespace failing_fit { // tests of a folder may be compiled together
namespace {

/// Names that differ; those of figures that are measured only where one is missing.
std::string difference(const FolderState& a, const FolderState& b) {
    for (const auto& [name, content] : a) {
        const auto other = b.find(name);
        if (other == b.end()) return name + " is missing";
        const bool measured = name.ends_with(".json") || name.ends_with(".html") || name.ends_with("checkpoint.gsh");
        if (!measured && other->second != content) return name + " differs";
    }
    for (const auto& [name, content] : b)
        if (!a.contains(name)) return name + " is left";
    return {};
}

/// A kind of call, and the error that it reports.
using Failure = std::pair<const char*, int>;
const std::vector<Failure> all_kinds{{"open", EMFILE},  {"read", EIO},  {"write", ENOSPC},
                                     {"write", 0},      {"fsync", EIO}, {"rename", EIO},
                                     {"mkdir", EACCES}, {"close", EIO}, {"thread", EAGAIN}};

/// Lets calls of these kinds fail in a command that makes what is in out/ anew. After each error, `after_error` gets
/// what is left and what the command would have made.
void fail_in_turn(const std::vector<std::string>& words, const fs::path& root, const FolderState& before,
                  const std::vector<Failure>& kinds,
                  const std::function<void(const FolderState& left, const FolderState& whole)>& after_error) {
    const fs::path out = root / "out";
    const std::string& program = words[0];
    test::restore(out, before);
    const auto clean = test::run_failing(words, root, {"", 0, EIO});
    INFO(clean.outcome.err);
    REQUIRE(clean.outcome.code == 0);
    for (const std::string& fault : test::order_faults(clean.calls)) FAIL_CHECK(program << ": " << fault);
    const FolderState whole = test::state_of(out);
    std::size_t failed = 0, refused = 0;
    for (const auto& [kind, error] : kinds) {
        const std::size_t count = clean.count(kind), most = std::min<std::size_t>(count, all_failures() ? 20 : 1);
        for (std::size_t k = 0; k < most; ++k) {
            test::restore(out, before);
            const FailingCall failing{kind, count - k * count / most, error};
            const auto result = test::run_failing(words, root, failing);
            if (!result.one_failed()) continue;
            ++failed;
            CAPTURE(program);
            CAPTURE(failing.text());
            INFO(result.outcome.err);
            const FolderState left = test::state_of(out);
            CHECK(test::damage_of(left) == "");
            if (result.outcome.code == 0) {
                CHECK(difference(whole, left) == "");
            } else {
                ++refused;
                CHECK(test::is_refusal(result.outcome, program));
                after_error(left, whole);
            }
        }
    }
    std::cout << program << ": " << failed << " failed calls, " << refused << " refused" << std::endl;
    CHECK(failed + 3 > kinds.size()); // as threads need not be made
    CHECK(refused > 1);
}

/// Names that are not the same in both.
std::string all_differences(const FolderState& a, const FolderState& b) {
    std::string names;
    for (const auto& [name, content] : a) {
        const auto other = b.find(name);
        if (other == b.end() || other->second != content) names += name + " ";
    }
    for (const auto& [name, content] : b)
        if (!a.contains(name)) names += name + " ";
    return names;
}

} // namespace

TEST_CASE("gsh-fit: after a call to the system that fails, all files are old or all are new") {
    const test::FilmedTurn turn(8);
    const fs::path root = fs::canonical(turn.folder / ""), out = root / "out", inner = out / "turn",
                   motion = out / "a.bvh";
    fs::create_directory(out);
    fs::rename(turn.detections, inner);
    const auto fit = [&](const char* height) {
        return std::vector<std::string>{"gsh-fit", inner, "--body", turn.body_file, "--height", height, "--to", motion};
    };
    const FolderState detected = test::state_of(out);
    // Pictures of an earlier fit, which is in another folder where this one has none, and masks that it moved.
    test::check_done(test::run(fit("1.6")));
    fs::create_directories(inner / "hidden/front");
    write_file(inner / "hidden/front/0000.png", read_file(inner / "masks/front/0000.png"));
    const FolderState fitted = test::state_of(out);
    for (const FolderState& before : {detected, fitted}) {
        fail_in_turn(fit("1.7"), root, before, all_kinds, [&](const FolderState& left, const FolderState& whole) {
            const std::string of_old = all_differences(before, left), of_new = all_differences(whole, left);
            INFO("differs from the old results: " << of_old << "\nand from the new ones: " << of_new);
            CHECK((of_old.empty() || of_new.empty()));
        });
    }
    test::check_done(test::run(fit("1.7")));
    CHECK(!fs::exists(inner / "hidden"));
    CHECK(fs::exists(inner / "masks_detected/front/0000.png"));
}

TEST_CASE("gsh-video: after a call to the system that fails, the same command goes on to the same results") {
    const test::FilmedTurn turn(4);
    const fs::path root = fs::canonical(turn.folder / ""), out = root / "out", detector = root / "detector";
    write_file(root / "a.mp4", "a video");
    write_file(detector, "#!/bin/sh\nmkdir -p \"$1\" && cp -r '" + turn.detections.string() + "/.' \"$1\"\n");
    fs::permissions(detector, fs::perms::owner_all);
    const std::vector<std::string> words{"gsh-video", root / "a.mp4", "--out",    out,   "--detector", detector,
                                         "--body",    turn.body_file, "--height", "1.7", "--preview",  "--threads",
                                         "2",         "--steps",      "1"};
    const auto goes_on = [&](const FolderState&, const FolderState& whole) {
        const test::Outcome again = test::run(words);
        INFO(again.err);
        CHECK(again.code == 0);
        CHECK(difference(whole, test::state_of(out)) == "");
    };
    // From nothing, where all stages take their time, and from the whole, where the avatar is complete.
    const std::vector<Failure> few{{"write", ENOSPC}, {"rename", EIO}, {"mkdir", EACCES}};
    fail_in_turn(words, root, {}, all_failures() ? all_kinds : few, goes_on);
    fail_in_turn(words, root, test::state_of(out), all_kinds, goes_on);
}

} // namespace failing_fit
