// SPDX-License-Identifier: Apache-2.0
/// Calls to the system, allocations and threads fail in gsh-view, each in turn: it says in one line why it does not
/// start, or answers one request with an error and all others as if nothing had happened. GSH_ALL_FAILURES is the long
/// form; without it, a sample.
#include "programs/failing_calls.hpp"
#include "programs/process.hpp"
#include "programs/view_answers.hpp"
#include "programs/view_scenes.hpp"

#include <gsh/io/file/input_file.hpp>

#include <doctest/doctest.h>
#include <httplib.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <filesystem>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::all_failures;
using test::FailingCall;
namespace fs = std::filesystem;

namespace failing_view { // tests of a folder may be compiled together
namespace {

/// An avatar and its motion in a folder, in which the server puts what is sent to it, too.
struct FailingViewPlace {
    test::Temporary folder;
    fs::path root = fs::canonical(folder / ""), tmp = root / "tmp";
    std::vector<std::string> words{"gsh-view", root / "polar.gsh", "--poses", root / "left.npz", "--threads", "2"};
    std::string draw, sent;

    FailingViewPlace() {
        fs::create_directories(tmp);
        fs::copy(test::view_files().polar, root / "polar.gsh");
        fs::copy(test::view_files().left, root / "left.npz");
        draw = test::request_for(test::view_scene({test::view_files().polar}).sizes()).dump();
        sent = read_file(test::view_files().right);
    }
};

/// What a server answered to a request: the status, 0 for none, and the text.
using Answer = std::pair<int, std::string>;

/// One request of each kind.
std::vector<Answer> ask(const FailingViewPlace& place, int port, const std::string& key) {
    httplib::Client client("127.0.0.1", port);
    client.set_read_timeout(30);
    std::string jpeg = place.draw;
    jpeg.replace(jpeg.find("\"png\""), 5, "\"jpeg\"");
    std::vector<Answer> answers;
    const auto note = [&](const httplib::Result& result) {
        std::string body = result ? result->body : "";
        for (std::size_t at; (at = body.find(key)) != std::string::npos;) body.erase(at, key.size());
        answers.emplace_back(result ? result->status : 0, body);
    };
    for (const char* path : {"/?", "/scene?", "/gaussians?", "/motion?person=0&motion=0&"})
        note(client.Get(path + ("key=" + key)));
    for (const std::string& body : {place.draw, jpeg}) note(client.Post("/draw?key=" + key, body, "application/json"));
    note(client.Post("/motion?person=0&name=right.npz&key=" + key, place.sent, "application/octet-stream"));
    return answers;
}

struct Served {
    bool started = false;
    test::Outcome outcome;
    std::vector<std::vector<Answer>> rounds;
    std::vector<test::RecordedCall> calls;
};

/// Runs the server, asks it everything three times, and ends it.
Served serve(const FailingViewPlace& place, const FailingCall& failing) {
    const test::Variable tmp("TMPDIR", place.tmp);
    const test::FailingSystem system("gsh-view", place.root, failing);
    Served served;
    test::Process program(place.words);
    std::string line;
    served.started = program.wait_until([&] {
        line = program.out();
        return line.ends_with("\n");
    });
    if (served.started) {
        const std::size_t key = line.find("?key=") + 5;
        for (int round = 0; round < 3; ++round)
            served.rounds.push_back(ask(place, std::stoi(line.substr(17)), line.substr(key, line.size() - key - 1)));
        program.send(SIGINT);
    }
    served.outcome = program.wait();
    served.calls = system.calls();
    return served;
}

} // namespace

TEST_CASE("gsh-view: a call to the system, an allocation or a thread that fails costs one answer, or the start") {
    const FailingViewPlace place;
    const Served clean = serve(place, {"memory", 0, ENOMEM});
    REQUIRE(clean.started);
    CHECK(clean.outcome.code == 130);
    for (const auto& round : clean.rounds) {
        CHECK(round == clean.rounds[0]);
        for (const Answer& answer : round) CHECK(answer.first == 200);
    }
    const auto count = [&](const std::string& kind) {
        if (kind == "memory") {
            for (const auto& call : clean.calls)
                if (call.kind == "allocations") return static_cast<std::size_t>(std::stoul(call.path));
            return std::size_t(0);
        }
        return static_cast<std::size_t>(
            std::count_if(clean.calls.begin(), clean.calls.end(), [&](const auto& call) { return call.kind == kind; }));
    };
    std::size_t failed = 0, refused = 0, errors = 0, same = 0;
    for (const auto& [kind, error] :
         {std::pair("open", EMFILE), {"read", EIO}, {"write", ENOSPC}, {"write", 0}, {"write", EINTR}, {"rename", EIO},
          {"close", EIO}, {"unlink", EACCES}, {"thread", EAGAIN}, {"memory", ENOMEM}}) {
        const std::size_t all = count(kind), several = kind == std::string("memory") ? 4 : 2,
                          most = std::min<std::size_t>(all, all_failures() ? 250 : several);
        for (std::size_t k = 0; k < most; ++k) {
            const FailingCall failing{kind, all - k * all / most, error};
            const Served served = serve(place, failing);
            const bool one_failed = std::any_of(served.calls.begin(), served.calls.end(),
                                                [](const test::RecordedCall& call) { return call.failed; });
            if (!one_failed) continue; // threads that start in another order need fewer
            ++failed;
            CAPTURE(failing.text());
            INFO(served.outcome.err);
            CHECK(fs::is_empty(place.tmp));
            if (!served.started) {
                ++refused;
                CHECK(served.outcome.code == 2);
                CHECK(served.outcome.err.starts_with("gsh-view: "));
                CHECK(std::count(served.outcome.err.begin(), served.outcome.err.end(), '\n') == 1);
                continue;
            }
            CHECK(served.outcome.code == 130);
            std::size_t others = 0;
            for (const auto& round : served.rounds)
                for (std::size_t r = 0; r < round.size(); ++r) {
                    if (round[r] == clean.rounds[0][r]) continue;
                    ++others;
                    const auto& [status, text] = round[r];
                    INFO(r << ": " << status << " " << text.substr(0, 300));
                    CHECK((status == 0 || status >= 400)); // or the connection has ended
                    if (status != 0) CHECK(std::count(text.begin(), text.end(), '\n') <= 1);
                }
            CHECK(others <= 1);
            errors += others, same += others == 0;
        }
    }
    std::cout << "gsh-view: " << failed << " failed calls, allocations and threads: " << refused
              << " refused to start, " << errors << " answered one request with an error, " << same << " answered all"
              << std::endl;
    CHECK(failed > 10);
}

} // namespace failing_view
