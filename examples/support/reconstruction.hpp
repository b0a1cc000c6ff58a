// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-reconstruct works on: its options, the capture, the model with its trainer, the record it keeps.
#pragma once

#include "support/program.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/io/body_file.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>
#include <gsh/train/avatar_model.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/memory.hpp>
#include <gsh/train/trainer.hpp>

#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

struct ReconstructOptions {
    std::filesystem::path capture, body, out;
    bool synthetic = false;
    bool resume = false;
    bool baseline = false;          ///< rates and pixel filter of the direct baseline
    std::uint64_t steps = 0;        ///< 0: the default of the kind of input
    double seconds = 0;             ///< of training; 0: count steps
    std::size_t gaussians = 0;      ///< 0: the default of the kind of input
    std::uint64_t seed = 0;
    std::size_t threads = 0;        ///< 0: all of the machine's
    std::string poses;              ///< empty: poses.npz
    std::uint64_t max_memory = 0;   ///< bytes; 0: no limit
    double checkpoint_interval = 5; ///< seconds
};

inline void add_options(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--capture", o.capture, "folder with images/, cameras.json and poses");
    app.add_option("--body", o.body, "body model (.npz, SMPL / SMPL-H / SMPL-X layout)");
    app.add_flag("--synthetic", o.synthetic, "film the built-in actor and reconstruct that, instead of a capture");
    app.add_option("--out", o.out, "folder for the results")->required();
    app.add_option("--steps", o.steps, "training steps (default 3000; 1200 with --synthetic)")->check(above_zero());
    app.add_option("--seconds", o.seconds, "train for so long instead of counting steps")->check(above_zero());
    app.add_option("--gaussians", o.gaussians, "number of Gaussians (default 170000; 60000 with --synthetic)")
        ->check(CLI::Range(1, 100'000'000));
    app.add_option("--seed", o.seed, "of all random choices (default 0)")->check(not_negative());
    add_threads(app, o.threads);
    app.add_option("--poses", o.poses, "pose file in the capture's folder (default poses.npz), or a path");
    app.add_option("--max-memory", o.max_memory, "bytes that training may take; fewer Gaussians if need be")
        ->check(above_zero());
    app.add_option("--checkpoint-interval", o.checkpoint_interval, "seconds between checkpoints (default 5)")
        ->check(above_zero());
    app.add_flag("--baseline", o.baseline, "learning rates and pixel filter of Animatable 3D Gaussian, for comparison");
    app.add_flag("--resume", o.resume, "go on from the checkpoint in --out");
}

/// Fills in defaults; refuses combinations that make no sense.
inline void check_options(ReconstructOptions& o) {
    const auto expect = [](bool condition, const char* message) {
        if (!condition) throw ValueError(message);
    };
    expect(o.synthetic || (!o.capture.empty() && !o.body.empty()), "--capture and --body are needed, or --synthetic alone");
    expect(!o.synthetic || (o.capture.empty() && o.body.empty() && o.poses.empty()),
           "--synthetic brings its own capture, body and poses; leave out --capture, --body and --poses");
    expect(o.steps == 0 || o.seconds == 0, "--steps and --seconds exclude each other");
    if (o.steps == 0) o.steps = o.synthetic ? 1200 : 3000;
    if (o.gaussians == 0) o.gaussians = o.synthetic ? 60000 : 170000;
    if (o.poses.empty()) o.poses = "poses.npz";
}

/// What is reconstructed: the body model and the capture, wherever they come from.
struct Source {
    BodyModel body;
    Capture capture;
    std::vector<std::string> warnings;
};

inline Source load_source(cpu::Threads& backend, const ReconstructOptions& o) {
    Source source;
    if (!o.synthetic) {
        source.body = load_body_model(o.body);
        source.capture = load_capture(backend, o.capture, source.body, {.poses = o.poses}, &source.warnings);
        return source;
    }
    std::printf("filming the built-in actor\n");
    std::fflush(stdout);
    source.body = make_actor();
    source.capture = film(backend, source.body, actor_motion(ActorMotion::talk, 12));
    source.capture.name = "the built-in actor";
    return source;
}

/// Photographs of a capture's training or test views; they point into the capture.
inline std::vector<Photo> photos_of(const Capture& capture, bool test) {
    std::vector<Photo> photos;
    for (const CaptureView& view : capture.views(test)) {
        const NamedCamera& camera = capture.cameras[view.camera];
        char frame[16];
        std::snprintf(frame, sizeof frame, "%04zu", view.frame);
        photos.push_back({camera.name + "_" + frame, camera.camera, view.frame, capture.image(view).data});
    }
    return photos;
}

/// Photographs to judge by. What cannot be judged had better be known before training than after it.
/// Errors  ValueError for a photograph that is smaller than the SSIM window, or whose mask nowhere exceeds 1/2.
inline std::vector<Photo> test_photos_of(const Capture& capture) {
    std::vector<Photo> photos = photos_of(capture, true);
    for (const Photo& photo : photos) {
        constexpr int least = SsimWindow<double>::size;
        check_value(photo.camera.width >= least && photo.camera.height >= least, "test image " + photo.name,
                    "is " + std::to_string(photo.camera.width) + " x " + std::to_string(photo.camera.height) +
                        " pixels, expected at least " + std::to_string(least) + " x " + std::to_string(least) + " for SSIM");
        bool person = false;
        for (std::size_t i = 3; i < photo.rgba.size() && !person; i += 4) person = photo.rgba[i] > 127;
        check_value(person, "test image " + photo.name, "has a mask (alpha) that nowhere exceeds 1/2, expected a person to judge");
    }
    return photos;
}

/// Uniform samples on the body in the capture's shape. Where memory is limited, as many as fit.
/// Errors  ValueError if not even a tenth of the Gaussians fit.
inline SurfaceSamples sample_body(const Source& source, const ReconstructOptions& o) {
    std::size_t count = o.gaussians;
    if (o.max_memory > 0) {
        std::size_t pixels = 0;
        for (const auto& camera : source.capture.cameras)
            pixels = std::max(pixels, static_cast<std::size_t>(camera.camera.width) * static_cast<std::size_t>(camera.camera.height));
        std::size_t held = 0; // what is in memory already
        for (const auto& image : source.capture.images) held += image.data.size();
        const MemoryModel memory = training_memory(pixels, held);
        count = std::min(count, memory.gaussians_within(o.max_memory));
        if (count < o.gaussians / 10)
            throw ValueError("--max-memory " + std::to_string(o.max_memory) + " is too little: training " +
                             std::to_string(o.gaussians) + " Gaussians takes about " +
                             std::to_string(memory.bytes(o.gaussians)) + " bytes, a tenth of them " +
                             std::to_string(memory.bytes(o.gaussians / 10)));
        if (count < o.gaussians)
            warn(std::to_string(count) + " instead of " + std::to_string(o.gaussians) + " Gaussians, to stay within " +
                 std::to_string(o.max_memory) + " bytes");
    }
    const auto vertices = shaped_vertices(source.body, source.capture.motion.betas);
    return sample_surface(source.body, vertices, std::vector<double>(vertices.size(), 1.0), mix_bits(o.seed), {.total = count});
}

/// The model and its trainer, ready for the first step.
struct Reconstruction {
    using Backend = cpu::Threads;
    using Model = AvatarModel<Backend, float>;

    RigData rig;
    Model model;
    std::vector<Photo> test_photos;
    Trainer<Backend, float, Model> trainer;

    /// source must outlive this: photographs are not copied.
    Reconstruction(Backend& backend, const Source& source, const ReconstructOptions& o)
        : Reconstruction(backend, source, o, sample_body(source, o)) {}

private:
    Reconstruction(Backend& backend, const Source& source, const ReconstructOptions& o, const SurfaceSamples& samples)
        : rig(make_rig(source.body, source.capture.motion.betas, samples)), model(backend, rig, samples, o.seed),
          test_photos(test_photos_of(source.capture)),
          trainer(backend, model, photos_of(source.capture, false), source.capture.motion, o.seed,
                  o.baseline ? baseline_config() : TrainConfig()) {}
};

/// What is kept about the course of training, for the report and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    double seconds = 0; ///< of training alone
    std::uint64_t interval = 10;
    std::vector<std::pair<double, double>> loss, psnr; ///< (step, value) of the training view at hand

    [[nodiscard]] bool wants_sample() const { return steps == 1 || steps % interval == 0; }
    /// A long run keeps the first and every other sample, so that a curve has at most a few hundred points.
    void add_sample(double loss_value, double psnr_value) {
        loss.emplace_back(static_cast<double>(steps), loss_value);
        psnr.emplace_back(static_cast<double>(steps), psnr_value);
        constexpr std::size_t most = 600;
        if (loss.size() < most) return;
        interval *= 2;
        for (auto* curve : {&loss, &psnr})
            std::erase_if(*curve, [&](const auto& point) { return point.first != 1 && static_cast<std::uint64_t>(point.first) % interval != 0; });
    }
};

} // namespace gsh::examples
