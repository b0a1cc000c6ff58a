// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-reconstruct on a GPU in its configurations: results are those of the CPU's threads, within the roundings
///        of a few steps.
#include "programs/cuda/on_cuda.hpp"
#include "support/contains.hpp"

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/setup/configuration.hpp>

#include <cstdint>

using namespace gsh;
using test::check_done;
using test::check_reconstruction;
using test::json_of;
using test::on_cuda;
using test::reconstruction;
using test::run;
using test::studio;
using test::Words;
using test::operator+;
namespace fs = std::filesystem;

TEST_CASE("each configuration") {
    for (const std::string_view name : configuration_names) {
        CAPTURE(std::string(name));
        const test::Temporary folder;
        check_reconstruction(folder / "", {"--config", std::string(name)});
        if (name != "light") continue;
        const auto metrics = json_of(folder / "cuda/metrics.json");
        CHECK(metrics.at("ms_per_stage").at("render") > 0.0);
        CHECK(metrics.at("peak_memory_bytes") > 10'000'000);
        CHECK(metrics.at("device_peak_memory_bytes") > 1'000'000);
        const std::string page = read_file(folder / "cuda/report.html");
        CHECK(page == test::contains("<th>Backend</th><td>cuda"));
        CHECK(page == test::contains(metrics.at("device").get<std::string>()));
    }
}

TEST_CASE("settings that run other kernels") {
    for (const Words& settings : {Words{"paper", "deformation=dual_quaternion", "heads=separate", "heads.time=false"},
                                  Words{"paper", "deformation=polar", "hash.separate_tables=true", "ao=pose"},
                                  Words{"light", "light.shadows=false", "ao=time", "prior.depth_feature=raw"},
                                  Words{"light", "ssim_weight=0", "mlp.hidden_layers=1", "mlp.width=24"},
                                  Words{"no-ao", "background.random=false", "filter.dilation=0.1", "gain.start=0"}}) {
        Words words{"--config", settings[0]};
        for (std::size_t i = 1; i < settings.size(); ++i) words = words + Words{"--set", settings[i]};
        CAPTURE(settings[1]);
        const test::Temporary folder;
        check_reconstruction(folder / "", words);
    }
}

TEST_CASE("mixed precision") {
    const test::Temporary folder;
    const fs::path fp32 = folder / "fp32", mixed = folder / "mixed", threads = folder / "threads";
    const Words paper{"--config", "paper"}, in_bf16{"--precision", "mixed"};
    check_done(run(reconstruction(fp32, paper + on_cuda)));
    check_done(run(reconstruction(mixed, paper + on_cuda + in_bf16)));
    check_done(run(reconstruction(threads, paper + in_bf16)));
    test::check_says_cuda(json_of(mixed / "metrics.json"), "mixed");
    CHECK(!test::same_file(mixed / "avatar.gsh", fp32 / "avatar.gsh"));
    for (const fs::path& other : {fp32, threads}) {
        const PixelImage found = read_image(mixed / "test/test00_0001.png"),
                         expected = read_image(other / "test/test00_0001.png");
        CHECK(test::decibels(found, expected, 64) >= 45);
    }
}

TEST_CASE("the same seed gives the same bits, in whichever order blocks and threads run") {
    const test::Temporary folder;
    check_done(run(reconstruction(folder / "a", on_cuda)));
#if defined(GSH_PROGRAMS_EMULATED)
    const test::Described order("GSH_EMULATED_ORDER", "random");
#endif
    check_done(run(reconstruction(folder / "b", on_cuda)));
    for (const char* file : {"avatar.gsh", "avatar.ply", "test/test00_0001.png"})
        CHECK(test::same_file(folder / "a" / fs::path(file), folder / "b" / fs::path(file)));
}

TEST_CASE("photographs whose colours have half the resolution") {
    Capture filmed = studio().capture; // of grey colours, which have any resolution
    for (PixelImage& image : filmed.images)
        for (std::size_t i = 0; i < image.data.size(); i += 4) image.data[i] = image.data[i + 2] = image.data[i + 1];
    const test::Temporary folder;
    save_capture(folder / "capture", filmed);
    const Words paper{"--config", "paper"};
    check_reconstruction(folder / "", paper, folder / "capture");
    check_done(run(
        reconstruction(folder / "whole", paper + on_cuda + Words{"--set", "half_chroma=false"}, folder / "capture")));
    CHECK(!test::same_file(folder / "whole/avatar.gsh", folder / "cuda/avatar.gsh"));
}

TEST_CASE("people before plates") {
    const Capture filmed = test::before_plates();
    const test::Temporary folder;
    save_capture(folder / "capture", filmed);
    for (const Words& more : {Words{"--config", "paper"}, Words{"--config", "light", "--set", "unknown_band=0.05"}}) {
        CAPTURE(more[1]);
        check_reconstruction(folder / "", more, folder / "capture");
        CHECK(json_of(folder / "cuda/metrics.json").at("protocol").get<std::string>() == test::contains("backgrounds"));
        // A column at the edge, without a person, is the plate.
        const PixelImage picture = read_image(folder / "cuda/test/test00_0000.png");
        for (int y = 0; y < 64; ++y)
            for (int c = 0; c < 3; ++c) CHECK(picture.pixel(y, 0)[c] == filmed.backgrounds[2].pixel(y, 0)[c]);
    }
}

TEST_CASE("two people whose poses and cameras are refined") {
    Motion ann = actor_motion(ActorMotion::talk, 2), bob = actor_motion(ActorMotion::stride, 2);
    for (auto& v : ann.transl) v.x -= 0.5;
    for (auto& v : bob.transl) v.x += 0.5;
    cpu::Threads backend;
    StudioParams params;
    params.train_cameras = 2, params.image_size = 56, params.samples = 4, params.distance = 4;
    const test::Temporary folder;
    const fs::path capture = folder / "capture";
    save_capture(capture, film(backend, {{&studio().body, &ann}, {&studio().body, &bob}}, params));
    for (auto* motion : {&ann, &bob})
        for (auto& angle : motion->pose) angle += vec3<double>(0.04, -0.04, 0.04);
    save_motion(capture / "ann.npz", ann);
    save_motion(capture / "bob.npz", bob);
    const Words people{"--poses", "ann.npz,bob.npz", "--refine", "--refine-cameras", "--set", "refine.test_steps=2"};
    for (const Words& more : {Words{"--config", "light", "--no-registration"}, Words{"--config", "paper"}}) {
        CAPTURE(more[1]);
        check_reconstruction(folder / "", people + more, capture);
        for (const char* name : {"poses_refined-ann.npz", "poses_refined-bob.npz"}) {
            const Motion found = load_motion(folder / "cuda" / fs::path(name), studio().body),
                         expected = load_motion(folder / "threads" / fs::path(name), studio().body);
            double largest = 0;
            for (std::size_t i = 0; i < expected.pose.size(); ++i)
                largest = std::max(largest, length(found.pose[i] - expected.pose[i]));
            CHECK(largest < 1e-3);
            CHECK(expected.pose != ann.pose);
        }
        CHECK(json_of(folder / "cuda/metrics.json").at("people").size() == 2);
        CHECK(json_of(folder / "cuda/metrics.json").at("refinement").size() == 2);
    }
}

TEST_CASE("static, with density control") {
    const test::Temporary folder;
    const fs::path cuda = folder / "cuda", threads = folder / "threads";
    const auto words = [&](const fs::path& out) {
        Words all{"gsh-reconstruct",
                  "--capture",
                  studio().path.string(),
                  "--config",
                  "static",
                  "--out",
                  out.string(),
                  "--gaussians",
                  "400",
                  "--steps",
                  "24",
                  "--threads",
                  "2"};
        for (const char* setting :
             {"density.start=3", "density.interval=4", "density.gradient_threshold=1e-6", "density.min_opacity=0.1",
              "density.reset_opacity=0.2", "density.reset_interval=9", "sh_interval=5"})
            all = all + Words{"--set", setting};
        return all;
    };
    check_done(run(words(cuda) + on_cuda));
    check_done(run(words(threads)));
    test::check_near(cuda, threads);
    const auto found = json_of(cuda / "metrics.json"), expected = json_of(threads / "metrics.json");
    for (const char* key : {"cloned", "split", "pruned"}) CHECK(found.at(key) == expected.at(key));
    CHECK(expected.at("split") > 0);
}

TEST_CASE("a span of the motion that is held out, and an end by the clock") {
    const test::Temporary folder;
    check_reconstruction(folder / "", {"--hold-out-motion", "1:1"});
    CHECK(json_of(folder / "cuda/metrics.json").at("new_motion").at("images") == 1);
    // With a checkpoint after each step, no steps are queued, which take the emulation long.
    const Words clock{"--config", "no-ao", "--seconds", "0.5", "--checkpoint-interval", "1e-9"};
    check_done(run(reconstruction(folder / "timed", clock + on_cuda)));
    CHECK(json_of(folder / "timed/metrics.json").at("seconds") >= 0.5);
}
