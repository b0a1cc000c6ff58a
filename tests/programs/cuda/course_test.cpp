// SPDX-License-Identifier: Apache-2.0
/// @file  The course of a training on a GPU: checkpoints of either backend, signals, too little memory, a GPU that
///        fails, and what is refused.
#include "programs/cuda/on_cuda.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>

#include <csignal>

using namespace gsh;
using test::check_done;
using test::check_refused;
using test::json_of;
using test::on_cuda;
using test::reconstruction;
using test::run;
using test::same_file;
using test::studio;
using test::Words;
using test::operator+;
namespace fs = std::filesystem;

TEST_CASE("a checkpoint of either backend is continued on both") {
    const test::Temporary folder;
    const Words refined{"--refine", "--no-registration", "--refine-cameras", "--set", "refine.test_steps=2", "--steps"};
    const auto backend = [](const std::string& name) { return Words{"--backend", name}; };
    for (const char* first : {"cuda", "threads"})
        check_done(run(reconstruction(folder / first, refined + Words{"3"} + backend(first))));
    for (const std::string first : {"cuda", "threads"})
        for (const std::string second : {"cuda", "threads"}) {
            CAPTURE(first);
            CAPTURE(second);
            const fs::path out = folder / (first + "-" + second);
            fs::create_directory(out);
            fs::copy(folder / first / fs::path("checkpoint.gsh"), out / "checkpoint.gsh");
            check_done(run(reconstruction(out, refined + Words{"6", "--resume"} + backend(second))));
            CHECK(json_of(out / "metrics.json").at("steps") == 6);
            CHECK(json_of(out / "metrics.json").at("backend") == second);
        }
    for (const std::string second : {"cuda", "threads"}) {
        const fs::path a = folder / ("cuda-" + second), b = folder / ("threads-" + second);
        for (const char* file : {"test/test00_0000.png", "test/test00_0001.png"})
            CHECK(test::decibels(read_image(a / file), read_image(b / file), 64) >= 60);
    }
    test::check_near(folder / "cuda-cuda", folder / "threads-threads");
}

TEST_CASE("a signal in the middle loses nothing, whether steps are queued or each is waited for") {
    const test::Temporary folder;
    const fs::path whole = folder / "whole";
    const Words words = Words{"--config", "paper", "--steps", "30", "--gaussians", "60"} + on_cuda;
    check_done(run(reconstruction(whole, words)));
    for (const char* interval : {"1e-9", "1000"}) {
        CAPTURE(interval);
        const fs::path parts = folder / interval;
        test::Process process(reconstruction(parts, words + Words{"--checkpoint-interval", interval}));
        REQUIRE(process.wait_until([&] { return process.err().find("step 1") != std::string::npos; }));
        process.send(SIGINT);
        const test::Outcome outcome = process.wait();
        CHECK(outcome.code == 130);
        CHECK(outcome.err == test::contains("--resume continues from there"));
        CHECK(test::files_below(parts) == 1); // the checkpoint
        check_done(run(reconstruction(parts, words + Words{"--resume"})));
        for (const char* file : {"avatar.gsh", "avatar.ply", "test/test00_0001.png"})
            CHECK(same_file(whole / file, parts / file));
    }
}

TEST_CASE("--max-memory is a limit on the GPU's memory; photographs beyond it come to the GPU one by one") {
    const test::Temporary folder;
    save_capture(folder / "capture", test::before_plates());
    const auto limited = [&](const std::string& bytes) {
        const Words more{"--config", "paper", "--gaussians", "1500", "--max-memory", bytes};
        return run(reconstruction(folder / "out", more + on_cuda, folder / "capture"));
    };
    const test::Outcome none = limited("100000");
    check_refused(none, "gsh-reconstruct", {"--max-memory", "too little", "a tenth of them "});
    CHECK(!fs::exists(folder / "out"));
    const std::size_t tenth = std::stoull(none.err.substr(none.err.find("a tenth of them ") + 16));
    const std::string bytes = std::to_string(tenth + 100'000);
    {
#if defined(GSH_PROGRAMS_EMULATED)
        const test::Described memory("GSH_EMULATED_MEMORY", bytes);
#endif
        const test::Outcome fewer = limited(bytes);
        INFO(fewer.err);
        CHECK(fewer.code == 0);
        CHECK(fewer.err == test::contains("instead of 1500 Gaussians"));
    }
    const auto metrics = json_of(folder / "out/metrics.json");
    test::check_says_cuda(metrics);
    CHECK(metrics.at("gaussians") < 1500);
    const std::string gaussians = std::to_string(metrics.at("gaussians").get<std::size_t>());
    check_done(run(reconstruction(folder / "free", Words{"--config", "paper", "--gaussians", gaussians} + on_cuda,
                                  folder / "capture")));
    CHECK(same_file(folder / "free/avatar.gsh", folder / "out/avatar.gsh"));
}

TEST_CASE("a GPU that is not there is refused in one line, and nothing is written") {
    const test::Temporary folder;
    const std::string out = folder / "out", avatar = folder / "avatar.gsh";
    const test::SmallCapture& s = studio();
    const auto refuse = [&](const Words& more, std::initializer_list<std::string_view> said) {
        for (const Words& words :
             {reconstruction(out, {}),
              Words{"gsh-reconstruct", "--capture", s.path, "--config", "static", "--out", out},
              Words{"gsh-evaluate", "--capture", s.path, "--body", s.body_file, "--configs", "paper", "--out", out},
              Words{"gsh-render", avatar, "--camera", s.camera, "--out", out},
              Words{"gsh-animate", avatar, "--poses", s.dance, "--out", out}}) {
            check_refused(run(words + more), words[0], said);
            CHECK(!fs::exists(out));
        }
    };
    refuse(on_cuda + Words{"--device", "7"}, {"gsh::cuda::Device", "7"});
    refuse({"--device", "0"}, {"--device needs --backend cuda"});
#if defined(GSH_PROGRAMS_EMULATED)
    {
        const test::Described driver("GSH_EMULATED_DRIVER", "none");
        refuse(on_cuda, {"driver"});
    }
    const test::Described memory("GSH_EMULATED_MEMORY", "300000");
    check_refused(run(reconstruction(out, on_cuda)), "gsh-reconstruct", {"device memory", "number of Gaussians"});
    CHECK(!fs::exists(out));
#endif
}

#if defined(GSH_PROGRAMS_EMULATED)
TEST_CASE("a GPU that fails ends the program with one line; an earlier checkpoint and earlier results stay") {
    const test::Temporary folder;
    const fs::path out = folder / "out";
    check_done(run(reconstruction(out, Words{"--config", "no-ao", "--steps", "2"} + on_cuda)));
    const std::string avatar = read_file(out / "avatar.gsh");
    bool kept = false, lost = false;
    for (const char* waits : {"1", "3", "12", "40", "100"}) {
        CAPTURE(waits);
        const test::Described life("GSH_EMULATED_LIFE", waits);
        const test::Outcome outcome = run(reconstruction(
            out, Words{"--config", "no-ao", "--steps", "60", "--gaussians", "40", "--checkpoint-interval", "1e-9"} +
                     on_cuda));
        INFO(outcome.err);
        CHECK(outcome.code == 2);
        CHECK(outcome.err == test::contains("gsh-reconstruct: "));
        CHECK(outcome.err == test::contains("cudaErrorLaunchFailure"));
        (outcome.err.find("is complete; the run can be resumed from it") != std::string::npos ? kept : lost) = true;
        CHECK(read_file(out / "avatar.gsh") == avatar);
    }
    CHECK(kept);
    CHECK(lost);
    check_done(run(
        reconstruction(out, Words{"--config", "no-ao", "--steps", "60", "--gaussians", "40", "--resume"} + on_cuda)));
    CHECK(read_file(out / "avatar.gsh") != avatar);
}
#endif
