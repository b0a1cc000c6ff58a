// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-render and gsh-animate on a GPU: pictures are those of the CPU's threads.
#include "programs/cuda/on_cuda.hpp"
#include "support/contains.hpp"

#include <gsh/io/motion/motion_file.hpp>

#include <cstdint>

using namespace gsh;
using test::check_done;
using test::on_cuda;
using test::run;
using test::studio;
using test::Words;
using test::operator+;
namespace fs = std::filesystem;

namespace {

/// Avatars with a light and with ambient occlusion, both trained on threads, and a motion beside the other one.
struct Shown {
    test::Temporary folder;
    fs::path lit = folder / "lit/avatar.gsh", paper = folder / "paper/avatar.gsh", beside = folder / "beside.npz";

    Shown() {
        const Words size{"--steps", "12", "--gaussians", "600"};
        check_done(run(test::reconstruction(folder / "lit", size)));
        check_done(run(test::reconstruction(folder / "paper", size + Words{"--config", "paper"})));
        Motion motion = actor_motion(ActorMotion::talk, 2);
        for (auto& transl : motion.transl) transl.x += 0.5;
        save_motion(beside, motion);
    }
    /// Renders on both backends and compares the pictures, which must show something.
    void check(const Words& words) const {
        const Words all = Words{"gsh-render"} + words + Words{"--camera", studio().camera.string()};
        const auto to = [&](const std::string& name) {
            return Words{"--out", (folder / (name + ".png")).string(), "--npy", (folder / (name + ".npy")).string()};
        };
        check_done(run(all + to("cuda") + on_cuda + Words{"--device", "0"}));
        check_done(run(all + to("threads")));
        CHECK(test::decibels_of_npy(folder / "cuda.npy", folder / "threads.npy") >= 90);
        CHECK(test::decibels(read_image(folder / "cuda.png"), read_image(folder / "threads.png")) >= 60);
    }
};
const Shown& shown() {
    static const Shown instance;
    return instance;
}

} // namespace

TEST_CASE("pictures of avatars and of scenes") {
    const Shown& s = shown();
    const Words dance{"--poses", studio().dance.string(), "--frame", "2"};
    for (const fs::path& avatar : {s.lit, s.paper}) {
        CAPTURE(avatar);
        s.check({avatar.string()});
        s.check(Words{avatar.string(), "--background", "0.2,0.4,0.6"} + dance);
    }
    PixelImage sky(3, 36, 72);
    for (std::size_t i = 0; i < sky.data.size(); ++i) sky.data[i] = static_cast<std::uint8_t>(i % 251);
    write_png(s.folder / "sky.png", sky);
    for (const std::string& light : {std::string("even"), (s.folder / "sky.png").string()})
        s.check(Words{s.lit.string(), "--light", light} + dance);
    s.check({s.lit.string(), s.paper.string(), "--poses", studio().dance.string(), "--poses", s.beside.string(),
             "--frame", "1"});
    s.check({(s.folder / "paper/avatar.ply").string()});
}

TEST_CASE("frames of several people in their motions") {
    const Shown& s = shown();
    const Words words{"gsh-animate", s.lit.string(), s.paper.string(), "--poses", studio().dance.string(), "--poses",
                      studio().dance.string(), "--size", "64"};
    const fs::path cuda = s.folder / "cuda", threads = s.folder / "threads";
    const test::Outcome outcome = run(words + Words{"--out", cuda.string()} + on_cuda);
    check_done(outcome);
    CHECK(outcome.out == test::contains("3 of 3 frames"));
    check_done(run(words + Words{"--out", threads.string()}));
    for (const char* frame : {"0000.png", "0001.png", "0002.png"})
        CHECK(test::decibels(read_image(cuda / frame), read_image(threads / frame)) >= 60);
    CHECK(test::files_below(cuda) == 3);
}
