// SPDX-License-Identifier: Apache-2.0
/// What a program needs is scarce, or changes under its hands: memory, open files, room, a folder, a clock, its inputs.
/// It does its work, or ends with an error in one line, and the old results are whole.
#include "programs/every_program.hpp"
#include "programs/failing_calls.hpp"
#include "programs/process.hpp"
#include "support/contains.hpp"
#include "support/skip.hpp"

#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/folder_lock.hpp>

#include <doctest/doctest.h>

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;
using test::all_failures;
using test::check_refused;
using test::FailingCall;
using test::FolderState;
using test::ProgramCommand;
namespace fs = std::filesystem;

namespace scarcity { // tests of a folder may be compiled together
namespace {

const test::EveryProgram& place() {
    static const test::EveryProgram instance;
    return instance;
}
std::vector<ProgramCommand> commands() {
    return test::every_program(place().in, place().out);
}
ProgramCommand command_of(std::string_view program) {
    for (const ProgramCommand& command : commands())
        if (command.program() == program) return command;
    throw std::logic_error("no such program");
}
/// Whether a command takes part where each is run many times: with GSH_ALL_FAILURES all do.
bool is_quick(const ProgramCommand& command) {
    for (const char* program : {"gsh-render", "gsh-motion", "gsh-export"})
        if (command.program() == program && command.words.back() != place().out / "page.html") return true;
    return all_failures();
}
std::vector<ProgramCommand> quick_commands() {
    std::vector<ProgramCommand> quick;
    for (ProgramCommand& command : commands())
        if (is_quick(command)) quick.push_back(std::move(command));
    return quick;
}

/// What became of the runs of a test.
struct Runs {
    std::size_t done = 0, refused = 0;

    void say(const std::string& what) const {
        std::cout << what << ": " << done << " runs done, " << refused << " refused" << std::endl;
    }
};

/// Files are named, and so is what the system lacks.
bool names_the_cause(const std::string& line) {
    for (const char* word : {"/", "out of memory", "thread", "memory", "Resource"})
        if (line.find(word) != std::string::npos) return true;
    return false;
}

/// Checks that a run was done, or refused with the old results whole; counts it.
void check_run(const ProgramCommand& command, const std::string& how, const test::Outcome& outcome,
               const FolderState& old, Runs& runs, const fs::path& out = place().out) {
    const std::string what = command.program() + ", " + how;
    const FolderState left = test::state_of(out);
    if (const std::string damage = test::damage_of(left); !damage.empty())
        FAIL_CHECK(what << ": " << damage << "\n" << outcome.err);
    if (outcome.code == 0 || outcome.code == 1) {
        ++runs.done;
        return;
    }
    ++runs.refused;
    if (!test::is_refusal(outcome, command.program()) || !names_the_cause(test::last_line(outcome.err)))
        FAIL_CHECK(what << ": ends with " << outcome.code << " and says " << outcome.err);
    if (!command.before.empty()) return; // gsh-fit makes its input anew, one file after the other
    for (const auto& [name, content] : old) {
        const auto now = left.find(name);
        if (now == left.end())
            FAIL_CHECK(what << ": " << name << " is gone");
        else if (now->second != content)
            FAIL_CHECK(what << ": " << name << " was changed");
    }
    for (const auto& [name, content] : left) // a checkpoint stays, to go on from
        if (!old.contains(name) && name != "checkpoint.gsh" && name != "evaluation.json" && !name.starts_with("runs/"))
            FAIL_CHECK(what << ": leaves " << name);
}

/// Runs a command behind what a shell has before it.
test::Outcome run_behind(const ProgramCommand& command, const std::string& before, FolderState& old) {
    test::prepare(command, place().out);
    if (command.before.empty()) write_file(place().out / "note.txt", "of the user");
    old = test::state_of(place().out);
    return test::run(command.words, before);
}

/// The start of a program without privileges: a superuser could write everywhere.
std::string unprivileged() {
    return ::geteuid() == 0 ? "exec setpriv --securebits=+noroot --bounding-set=-all --inh-caps=-all --" : "exec";
}
/// Whether that is possible here.
bool can_be_unprivileged() {
    return std::system((unprivileged() + " true 2>/dev/null").c_str()) == 0;
}

} // namespace

TEST_CASE("a program with little address space works, or says that memory is short") {
    Runs runs;
    for (const ProgramCommand& command : quick_commands()) {
        const auto limited = [](std::size_t megabytes) {
            return "ulimit -v " + std::to_string(megabytes << 10) + " && exec";
        };
        std::size_t low = 16; // megabytes with which it starts
        while (low < 4096 && test::run({command.program(), "--version"}, limited(low)).code != 0) low += 16;
        const auto works = [&](std::size_t limit) {
            FolderState old;
            const test::Outcome outcome = run_behind(command, limited(limit), old);
            check_run(command, std::to_string(limit) + " MB of addresses", outcome, old, runs);
            return outcome.code == 0 || outcome.code == 1;
        };
        std::size_t high = low + 16;
        while (high < 8192 && !works(high)) high += high - low;
        for (std::size_t probe = 0; probe < (all_failures() ? 8 : 3) && low + 1 < high; ++probe)
            (works((low + high) / 2) ? high : low) = (low + high) / 2;
        CHECK(high < 8192);
    }
    runs.say("little address space");
    CHECK(runs.refused > 2);
    CHECK(runs.done > 2);
}

TEST_CASE("a program that may open few files works, or names the file that it cannot open") {
    Runs runs;
    for (const ProgramCommand& command : quick_commands())
        for (const int most : {4, 5, 6, 8}) {
            FolderState old;
            // Without what this test was started with: a descriptor more, and the loader itself is refused.
            const std::string limit = "exec 3>&- 4>&- 5>&- 6>&- 7>&- 8>&- 9>&- && ulimit -n " + std::to_string(most);
            const auto outcome = run_behind(command, limit + " && exec", old);
            check_run(command, std::to_string(most) + " open files", outcome, old, runs);
            if (outcome.code == 2) CHECK(outcome.err == test::contains("Too many open files"));
        }
    runs.say("few open files");
    CHECK(runs.refused > 3);
    CHECK(runs.done > 3);
}

TEST_CASE("a limit on the size of files is an error that names the file") {
    Runs runs;
    for (const ProgramCommand& command : commands())
        for (const int blocks : {1, 8}) { // of 512 bytes
            if (blocks > 1 && !is_quick(command)) continue;
            FolderState old;
            const auto outcome = run_behind(command, "ulimit -f " + std::to_string(blocks) + " && exec", old);
            check_run(command, std::to_string(512 * blocks) + " bytes in a file", outcome, old, runs);
            if (outcome.code == 2) CHECK(outcome.err == test::contains("File too large"));
        }
    runs.say("small files");
    CHECK(runs.refused > 10);
}

TEST_CASE("a folder that may not be written to, and a file that may not be read, are named") {
    if (!can_be_unprivileged()) return test::skip("needs setpriv where it runs as the superuser");
    Runs runs;
    for (const ProgramCommand& command : commands()) {
        test::prepare(command, place().out);
        write_file(place().out / "note.txt", "of the user");
        const FolderState old = test::state_of(place().out);
        ::chmod(place().out.c_str(), 0555);
        const auto outcome = test::run(command.words, unprivileged());
        ::chmod(place().out.c_str(), 0755);
        check_run(command, "a folder that may only be read", outcome, old, runs);
        check_refused(outcome, command.program(), {place().out.string(), "Permission denied"});
    }
    CHECK(runs.done == 0);
    const fs::path secret = place().in / "camera.json";
    ::chmod(secret.c_str(), 0);
    const auto outcome = test::run(command_of("gsh-render").words, unprivileged());
    ::chmod(secret.c_str(), 0644);
    check_refused(outcome, "gsh-render", {secret.string(), "Permission denied"});
}

TEST_CASE("a full disk leaves what was there, and nothing else") {
    // A disk of 16 kB, in the program's own view of the file system. Files that are left are listed on the output.
    const std::string disk = "exec unshare --mount sh -c 'mount -t tmpfs -o size=16k none \"" + place().out.string() +
                             "\" || exit 99; cd \"" + place().out.string() +
                             "\"; echo old >note.txt; \"$0\" \"$@\"; code=$?; echo \"left:\" $(find . -type f); cat "
                             "note.txt; exit $code'";
    Runs runs;
    for (const ProgramCommand& command : commands()) {
        if (!command.before.empty() || (command.program() == "gsh-evaluate" && !all_failures())) continue;
        test::prepare(command, place().out);
        const test::Outcome outcome = test::run(command.words, disk);
        if (outcome.code == 99 || outcome.err.starts_with("unshare")) return test::skip("no disk can be mounted here");
        INFO(outcome.err);
        CHECK(test::is_refusal(outcome, command.program()));
        CHECK(outcome.err == test::contains("No space left on device"));
        CHECK(outcome.err == test::contains(place().out.string()));
        CHECK(outcome.out.ends_with("left: ./note.txt\nold\n"));
        ++runs.refused;
    }
    CHECK(runs.refused > 4);
}

TEST_CASE("a folder for results that vanishes during a run is named, or made again") {
    Runs runs;
    for (const ProgramCommand& command : commands()) {
        if (!is_quick(command) && command.program() != "gsh-reconstruct") continue;
        test::prepare(command, place().out);
        const auto clean = test::run_failing(command.words, place().root, {});
        for (const char* kind : {"mkdir", "open", "write", "fsync", "rename"}) {
            const std::size_t count = clean.count(kind), most = std::min<std::size_t>(count, all_failures() ? 20 : 1);
            for (std::size_t k = 0; k < most; ++k) {
                test::prepare(command, place().out);
                fs::remove_all(place().root / "gone");
                const FailingCall failing{kind, count - k * count / most, FailingCall::out_vanishes};
                const auto result = test::run_failing(command.words, place().root, failing);
                REQUIRE(result.one_failed());
                check_run(command, failing.text(), result.outcome, {}, runs);
                if (result.outcome.code == 2) CHECK(result.outcome.err == test::contains(place().root.string()));
            }
        }
    }
    fs::remove_all(place().root / "gone");
    runs.say("vanishing folders");
    CHECK(runs.refused > 5);
}

TEST_CASE("a clock that is set back again and again changes no result") {
    for (const ProgramCommand& command : quick_commands()) {
        if (!command.repeats) continue;
        test::prepare(command, place().out);
        CHECK(test::run(command.words).code == 0);
        const FolderState expected = test::state_of(place().out);
        test::prepare(command, place().out);
        CHECK(test::run_failing(command.words, place().root, {"clock", 0, 0}).outcome.code == 0);
        CHECK(test::state_of(place().out) == expected);
    }
    // A run that is resumed before it was begun.
    ProgramCommand command = command_of("gsh-reconstruct");
    test::prepare(command, place().out);
    CHECK(test::run(command.words).code == 0);
    const std::string avatar = read_file(place().out / "avatar.gsh");
    for (const auto& entry : fs::directory_iterator(place().out))
        fs::last_write_time(entry.path(), fs::file_time_type::clock::now() + std::chrono::hours(24 * 365));
    command.words.push_back("--resume");
    const auto resumed = test::run_failing(command.words, place().root, {"clock", 0, 0});
    INFO(resumed.outcome.err);
    CHECK(resumed.outcome.code == 0);
    CHECK(read_file(place().out / "avatar.gsh") == avatar);
}

TEST_CASE("an input that is cut or changed while it is read is an error that names it, or is read as it was") {
    Runs runs;
    const fs::path in = place().root / "moving"; // a copy for each run
    const fs::path read_from = place().in;
    for (const ProgramCommand& command : test::every_program(in, place().out)) {
        if (!is_quick(command)) continue;
        const auto fresh = [&] {
            fs::remove_all(in);
            fs::copy(read_from, in, fs::copy_options::recursive);
            test::prepare(command, place().out);
        };
        fresh();
        const auto clean = test::run_failing(command.words, place().root, {});
        REQUIRE(clean.outcome.code <= 1);
        const std::size_t count = clean.count("read"), most = std::min<std::size_t>(count, all_failures() ? 40 : 3);
        for (const int change : {FailingCall::file_is_cut, FailingCall::file_is_changed})
            for (std::size_t k = 0; k < most; ++k) {
                fresh();
                const FailingCall failing{"read", count - k * count / most, change};
                const auto result = test::run_failing(command.words, place().root, failing);
                REQUIRE(result.one_failed());
                check_run(command, failing.text(), result.outcome, {}, runs);
                if (result.outcome.code == 2) CHECK(result.outcome.err == test::contains(place().root.string()));
            }
    }
    fs::remove_all(in);
    runs.say("changing inputs");
    CHECK(runs.refused > 5);
}

TEST_CASE("symbolic links lead to inputs and to folders for results") {
    const fs::path links = place().root / "links", real = place().root / "real";
    for (ProgramCommand command : test::every_program(links / "in", links / "out")) {
        if (command.program() == "gsh-evaluate" && !all_failures()) continue;
        fs::remove_all(links), fs::remove_all(real), fs::remove_all(place().out);
        fs::create_directories(links / "in");
        fs::create_directories(real);
        for (const auto& entry : fs::directory_iterator(place().in)) {
            const std::string name = entry.path().filename().string();
            fs::create_symlink("../../in/" + name, links / "in" / name);
        }
        if (!command.before.empty())
            fs::copy(place().in / "turn", real, fs::copy_options::recursive);
        fs::create_directory_symlink("../real", links / "out");
        const test::Outcome outcome = test::run(command.words);
        INFO(command.program() << ": " << outcome.err);
        CHECK((outcome.code == 0 || outcome.code == 1));
        CHECK(fs::is_symlink(links / "out"));
        CHECK(test::files_below(real) > (command.before.empty() ? 0 : test::files_below(place().in / "turn")));
        CHECK(test::damage_of(test::state_of(real)).empty());
    }
    // Results that are links themselves: what they lead to is replaced.
    fs::remove_all(links), fs::remove_all(real);
    fs::create_directories(links), fs::create_directories(real / "frames");
    fs::create_symlink(real / "a.bvh", links / "a.bvh");
    fs::create_directory_symlink(real / "frames", links / "frames");
    CHECK(test::run({"gsh-motion", place().in / "dance.npz", "--body", place().in / "body.npz", "--out",
                     links / "a.bvh"}).code == 0);
    CHECK(fs::is_symlink(links / "a.bvh"));
    CHECK(fs::exists(real / "a.bvh"));
    test::check_done(test::run({"gsh-export", place().in / "avatar.gsh", "--poses", place().in / "dance.npz",
                                "--frames", "0:1", "--to", links / "frames.ply"}));
    CHECK(fs::is_symlink(links / "frames"));
    CHECK(test::files_below(real / "frames") == 2);

    // Links that lead nowhere, or to themselves.
    fs::create_symlink("round", links / "round");
    fs::create_directory_symlink("nowhere/at/all", links / "nowhere");
    const auto check = [&](const fs::path& capture, const fs::path& out) {
        return test::run({"gsh-check", capture, "--body", place().in / "body.npz", "--out", out});
    };
    check_refused(check(links / "round", place().out), "gsh-check", {(links / "round").string()});
    check_refused(check(links / "nowhere", place().out), "gsh-check", {(links / "nowhere").string()});
    check_refused(check(place().in / "capture", links / "round"), "gsh-check", {(links / "round").string()});
    check_refused(check(place().in / "capture", links / "nowhere"), "gsh-check", {(links / "nowhere").string()});
    fs::remove_all(links), fs::remove_all(real);
}

TEST_CASE("a pipe is read where a file is read in one go; elsewhere it is refused at once, and never waited for") {
    const fs::path pipe = place().root / "pipe";
    REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
    const std::string patience = "exec timeout 20"; // its exit code is 124
    // Nobody writes to this pipe: whoever opened it would wait.
    for (const ProgramCommand& command : commands())
        for (std::size_t w = 1; w < command.words.size(); ++w) {
            const fs::path word = command.words[w];
            const bool is_input = word.string().starts_with(place().in.string());
            if (!is_input) continue;
            std::vector<std::string> words = command.words;
            words[w] = pipe;
            test::prepare(command, place().out);
            INFO(command.program() << " " << word.string());
            const bool by_name = word.extension() == ".gsh" && command.program() == "gsh-export"; // it asks the ending
            if (by_name) continue;
            check_refused(test::run(words, patience), command.program(), {pipe.string()});
            if (word.extension() == ".json") continue;
            words[w] = "/dev/stdin";
            check_refused(test::run(words, "cat '" + (place().in / "body.npz").string() + "' | timeout 20"),
                          command.program(), {"/dev/stdin"});
        }
    ProgramCommand command = command_of("gsh-render");
    std::vector<std::string> words = command.words;
    const std::string camera = place().in / "camera.json";
    words[3] = "/dev/stdin";
    test::prepare(command, place().out);
    test::check_done(test::run(words, "cat '" + camera + "' | timeout 20"));
    CHECK(fs::exists(place().out / "a.png"));
    test::check_done(test::run(words, "<'" + camera + "' timeout 20"));
    check_refused(test::run(words, "</dev/null timeout 20"), "gsh-render", {"/dev/stdin"});
    check_refused(test::run(words, "<&- timeout 20"), "gsh-render", {"/dev/stdin"});
    words[3] = pipe;
    test::check_done(test::run(words, "cat '" + camera + "' >'" + pipe.string() + "' & timeout 20"));

    // A file of a capture that is such a pipe.
    const fs::path capture = place().root / "capture";
    const auto spoilt = [&](const fs::path& file) {
        fs::remove_all(capture);
        fs::copy(place().in / "capture", capture, fs::copy_options::recursive);
        CHECK(fs::remove(capture / file));
        REQUIRE(::mkfifo((capture / file).c_str(), 0600) == 0);
        return test::run({"gsh-check", capture, "--body", place().in / "body.npz", "--out", place().out}, patience);
    };
    for (const auto& [name, content] : test::state_of(place().in / "capture")) {
        if (name.ends_with("/")) continue;
        const bool first = name.find('/') == std::string::npos || name.find("0000") != std::string::npos;
        if (first) check_refused(spoilt(name), "gsh-check", {name, "pipe"});
    }
    fs::remove_all(capture);
    fs::remove(pipe);
}

TEST_CASE("of two runs into one folder the second is refused, and names the process of the first") {
    const std::string process = "process " + std::to_string(::getpid());
    for (const ProgramCommand& command : commands()) {
        test::prepare(command, place().out);
        const LockedFolder held(place().out);
        const FileLock frames(place().out / "frames.lock", "frames");
        const FolderState old = test::state_of(place().out);
        const bool single = command.words.back() == place().out / "a.bvh" || command.program() == "gsh-render" ||
                            command.program() == "gsh-body" || command.words.back() == place().out / "page.html";
        if (single) continue; // they lock their file: the tests of AtomicFile
        check_refused(test::run(command.words), command.program(), {place().out.string(), process, "is writing there"});
        CHECK(test::state_of(place().out) == old);
    }
}

TEST_CASE("a program whose standard streams are closed writes nothing of its own into its results") {
    const ProgramCommand command = command_of("gsh-render");
    test::prepare(command, place().out);
    CHECK(test::run(command.words).code == 0);
    const FolderState expected = test::state_of(place().out);
    std::vector<std::string> words = command.words;
    words[3] = place().root / "away.json"; // a camera that sees nothing: there is a warning
    NamedCamera camera = read_camera(place().in / "camera.json");
    camera.camera.t.z -= 100;
    write_camera(words[3], camera);
    for (const auto& [such, streams] : {std::pair(command.words, "<&- >&- 2>&-"), {words, "<&- >&- 2>&-"},
                                        {words, "2>&-"}}) {
        test::prepare(command, place().out);
        const test::Outcome outcome = test::run(such, streams);
        CHECK(outcome.code == 0);
        CHECK(outcome.err.empty());
        const FolderState now = test::state_of(place().out);
        if (such == command.words) CHECK(now == expected);
        CHECK(now.at("a.png").starts_with("\x89PNG"));
        CHECK(now.at("a.npy").starts_with("\x93NUMPY"));
        CHECK(now.at("a.npy").size() == expected.at("a.npy").size());
    }
}

} // namespace scarcity
