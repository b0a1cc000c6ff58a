// SPDX-License-Identifier: Apache-2.0
/// gsh-reconstruct and gsh-evaluate are killed at random moments: what goes on begins at the last checkpoint, ends with
/// the bytes of an undisturbed run, and no stray file remains. GSH_KILLS=1000 is the long form; by default there are 25
/// kills.
#include "programs/failing_calls.hpp"
#include "programs/process.hpp"
#include "programs/reported_steps.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/core/rng.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/reconstruct/resume.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <iostream>
#include <set>
#include <string>
#include <thread>
#include <vector>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// A command that goes on where it was killed.
struct KilledCommand {
    std::string name;
    std::function<std::vector<std::string>(const fs::path& out, bool resume)> words;
    std::function<bool(const fs::path& out)> is_begun; ///< whether there is something to go on from
};

std::vector<KilledCommand> killed_commands() {
    const test::SmallCapture& s = test::studio();
    const std::vector<std::string> often{"--steps", "12", "--checkpoint-interval", "1e-9", "--threads", "2"};
    const fs::path paper = s.folder / "paper.json";
    write_file(paper, R"({"configuration": "paper", "hash.table_size": 1024, "ao.table_size": 1024})");
    return {{"gsh-reconstruct",
             [&s, often](const fs::path& out, bool resume) {
                 std::vector<std::string> more = often;
                 if (resume) more.push_back("--resume");
                 return s.reconstruct(out, more);
             },
             [](const fs::path& out) {
                 return fs::exists(out / "checkpoint.gsh") || fs::exists(out / "checkpoint.before.gsh");
             }},
            {"gsh-evaluate",
             [&s, paper](const fs::path& out, bool) {
                 return std::vector<std::string>{"gsh-evaluate",
                                                 "--capture",
                                                 s.path,
                                                 "--body",
                                                 s.body_file,
                                                 "--configs",
                                                 paper,
                                                 "--out",
                                                 out,
                                                 "--gaussians",
                                                 "300",
                                                 "--steps",
                                                 "5,10",
                                                 "--checkpoint-interval",
                                                 "1e-9",
                                                 "--threads",
                                                 "2"};
             },
             [](const fs::path&) { return false; }}};
}

/// Figures that are measured, and what holds them, differ from run to run.
bool differs_by_nature(const std::string& name) {
    return name.ends_with(".json") || name.ends_with(".html") || name.ends_with(".md") ||
           name.ends_with("checkpoint.gsh");
}

/// Compares what two runs left: the same names, and the same bytes where nothing is measured.
void check_same_results(const fs::path& whole, const fs::path& killed) {
    const test::FolderState a = test::state_of(whole), b = test::state_of(killed);
    for (const auto& [name, content] : a) {
        const auto other = b.find(name);
        if (other == b.end())
            FAIL_CHECK(name << " is missing after the kills");
        else if (!differs_by_nature(name) && other->second != content)
            FAIL_CHECK(name << " differs after the kills");
    }
    for (const auto& [name, content] : b)
        if (!a.contains(name)) FAIL_CHECK(name << " is left by the kills");
}

/// Kills the command `kills` times at random moments of its run, from start to end.
void kill_again_and_again(const KilledCommand& command, std::size_t kills, std::uint64_t seed) {
    using Clock = std::chrono::steady_clock;
    CAPTURE(command.name);
    CAPTURE(seed);
    const test::Temporary folder;
    const fs::path whole = folder / "whole", out = folder / "killed";
    const auto start = Clock::now();
    test::check_done(test::run(command.words(whole, false)));
    const double duration = std::chrono::duration<double>(Clock::now() - start).count();
    Rng random(seed);
    std::size_t killed = 0, finished = 0, with_partial = 0, resumed = 0;
    std::uint64_t reached = 0; // the last step that a run has reported
    // A checkpoint is written after each step, once the step is reported. So at most one step is lost.
    const auto check_begin = [&](const std::vector<test::ReportedStep>& steps) {
        if (steps.empty()) return;
        const std::uint64_t begun = steps.front().step - 1;
        if (begun + 1 < reached || begun > reached)
            FAIL_CHECK(command.name << " goes on after step " << begun << ", and had reached step " << reached);
        resumed += begun > 0;
        reached = steps.back().step;
    };
    while (killed < kills) {
        test::ReportedSteps reports;
        test::Process process(command.words(out, command.is_begun(out)));
        std::this_thread::sleep_for(std::chrono::duration<double>(random.uniform(0, 1.05) * duration));
        process.send(SIGKILL);
        const test::Outcome outcome = process.wait();
        check_begin(reports.take());
        if (outcome.code == -SIGKILL) {
            if (++killed % 100 == 0) std::cout << command.name << ": " << killed << " kills" << std::endl;
        } else { // it was faster
            INFO(outcome.err);
            CHECK(outcome.code == 0);
            ++finished;
            check_same_results(whole, out);
            fs::remove_all(out);
            reached = 0;
            continue;
        }
        bool partial = false;
        for (const auto& [name, content] : test::state_of(out)) {
            partial = partial || name.find(".partial") != std::string::npos;
            const bool in_place = name.find(".partial") == std::string::npos;
            if (in_place && name.ends_with(".gsh"))
                CHECK_NOTHROW(NpzReader(InputFile::in_memory(name, content)).check_all());
            if (in_place && name.ends_with(".json")) CHECK(nlohmann::json::accept(content));
        }
        with_partial += partial;
    }
    test::ReportedSteps reports;
    const test::Outcome last = test::run(command.words(out, command.is_begun(out)));
    INFO(last.err);
    CHECK(last.code == 0);
    check_begin(reports.take());
    check_same_results(whole, out);
    std::cout << command.name << ": killed " << killed << " times (" << with_partial
              << " in the middle of a file), went on from a checkpoint " << resumed << " times, finished in between "
              << finished << " times" << std::endl;
    if (kills >= 100) CHECK(resumed > 0);
}

} // namespace

TEST_CASE("killed at random moments, programs go on and end with the same bytes") {
    const char* const asked = std::getenv("GSH_KILLS");
    const std::size_t kills = asked ? static_cast<std::size_t>(std::atoi(asked)) : 25;
    const auto commands = killed_commands();
    kill_again_and_again(commands[0], kills - kills * 2 / 5, 5401);
    kill_again_and_again(commands[1], kills * 2 / 5, 5402);
}

TEST_CASE("a killed run has lost at most the seconds between two checkpoints") {
    const test::SmallCapture& s = test::studio();
    const test::Temporary folder;
    constexpr double interval = 0.2; // seconds of training
    double most = 0;
    for (const double moment : {5.3, 7.9, 10.5}) { // in intervals
        const fs::path out = folder / "out";
        fs::remove_all(out);
        test::ReportedSteps reports;
        std::vector<test::ReportedStep> steps;
        test::Process process(s.reconstruct(out, {"--steps", "100000", "--checkpoint-interval", "0.2"}));
        REQUIRE(process.wait_until([&] {
            for (const test::ReportedStep& step : reports.take()) steps.push_back(step);
            return !steps.empty() && steps.back().seconds() > moment * interval;
        }));
        process.send(SIGKILL);
        CHECK(process.wait().code == -SIGKILL);
        for (const test::ReportedStep& step : reports.take()) steps.push_back(step);
        double longest = 0;
        for (std::size_t i = 1; i < steps.size(); ++i)
            longest = std::max(longest, steps[i].seconds() - steps[i - 1].seconds());
        std::string damage;
        const NpzReader checkpoint(whole_checkpoint(out / "checkpoint.gsh", damage));
        const double lost = steps.back().seconds() - checkpoint.read_number<double>("seconds");
        CAPTURE(longest);
        CHECK(lost < interval + 2 * longest);
        most = std::max(most, lost);
    }
    std::cout << "at most " << most << " s of training are lost, of checkpoints every " << interval << " s"
              << std::endl;
}

TEST_CASE("a damaged checkpoint is named, and the one before it is used") {
    const test::SmallCapture& s = test::studio();
    const test::Temporary folder;
    const fs::path out = folder / "out";
    {
        test::Process process(s.reconstruct(out, {"--steps", "100000", "--checkpoint-interval", "1e-9"}));
        REQUIRE(process.wait_until([&] { return fs::exists(out / "checkpoint.before.gsh"); }));
        process.send(SIGTERM);
        CHECK(process.wait().code == 130);
    }
    // The last checkpoint, taken when the run was stopped, and the one before it.
    std::string bytes = read_file(out / "checkpoint.gsh");
    bytes[bytes.size() / 2] ^= 1;
    write_file(out / "checkpoint.gsh", bytes);
    const test::Outcome resumed = test::run({"gsh-reconstruct", "--out", out.string(), "--resume", "--steps", "1"});
    INFO(resumed.err);
    CHECK(resumed.code == 0);
    CHECK(resumed.err == test::contains("checkpoint.gsh: "));
    CHECK(resumed.err == test::contains("is damaged"));
    CHECK(resumed.err == test::contains("checkpoint.before.gsh"));
    CHECK(!fs::exists(out / "checkpoint.before.gsh")); // the run has come to its end
    CHECK_NOTHROW(NpzReader(out / "checkpoint.gsh").check_all());
}
