// SPDX-License-Identifier: Apache-2.0
/// Calls to the system fail, each in turn, in gsh-fit, which writes its files one after the other: an error in one line,
/// no damaged file, and the same command then ends with what it would have made. GSH_ALL_FAILURES is the long form;
/// without it, a sample.
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

/// Lets calls fail in a command that makes what is in out/ anew.
void fail_in_turn(const std::vector<std::string>& words, const fs::path& root, const FolderState& before) {
    const fs::path out = root / "out";
    const std::string& program = words[0];
    test::restore(out, before);
    const auto clean = test::run_failing(words, root, {"", 0, EIO});
    REQUIRE(clean.outcome.code == 0);
    for (const std::string& fault : test::order_faults(clean.calls)) FAIL_CHECK(program << ": " << fault);
    const FolderState whole = test::state_of(out);
    std::size_t failed = 0, refused = 0;
    for (const auto& [kind, error] :
         {std::pair("open", EMFILE), {"read", EIO}, {"write", ENOSPC}, {"write", 0}, {"fsync", EIO}, {"rename", EIO},
          {"mkdir", EACCES}, {"close", EIO}, {"thread", EAGAIN}}) {
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
            CHECK(test::damage_of(test::state_of(out)) == "");
            if (result.outcome.code != 0) {
                ++refused;
                CHECK(test::is_refusal(result.outcome, program));
                const test::Outcome again = test::run(words);
                INFO(again.err);
                CHECK(again.code == 0);
            }
            CHECK(difference(whole, test::state_of(out)) == "");
        }
    }
    std::cout << program << ": " << failed << " failed calls, " << refused << " refused" << std::endl;
    CHECK(failed > 5);
    CHECK(refused > 1);
}

} // namespace

TEST_CASE("gsh-fit: a call to the system that fails is an error in one line, and the same command makes all anew") {
    const test::FilmedTurn turn(8);
    const fs::path root = fs::canonical(turn.folder / "");
    fail_in_turn({"gsh-fit", root / "out", "--body", turn.body_file, "--height", "1.7"}, root,
                 test::state_of(turn.detections));
}

} // namespace failing_fit
