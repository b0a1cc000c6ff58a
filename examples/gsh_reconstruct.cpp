// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-reconstruct: from a capture of a person to an animatable avatar, judged on views it never saw.
///
/// 1. Load the body and the capture, or make both (--synthetic).
/// 2. Sample Gaussians on the body's surface and attach them to its rig.
/// 3. Train, with a checkpoint every few seconds.
/// 4. Judge on the test views, and write what was found.

#include "support/output_folder.hpp"
#include "support/program.hpp"
#include "support/progress.hpp"
#include "support/reconstruction.hpp"
#include "support/results.hpp"
#include "support/static_reconstruction.hpp"

#include <gsh/backend/threads.hpp>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <string>

using namespace gsh;
using namespace gsh::examples;

namespace {

std::string status_text(const TrainingRecord& record, double steps_per_second) {
    char text[96];
    std::snprintf(text, sizeof text, "step %llu  loss %.4f  PSNR %.2f dB  %.1f steps/s",
                  static_cast<unsigned long long>(record.steps), record.loss.empty() ? 0 : record.loss.back().second,
                  record.psnr.empty() ? 0 : record.psnr.back().second, steps_per_second);
    return text;
}

/// Trains until the steps or the seconds are used up, or until somebody interrupts.
void train(Reconstruction& reconstruction, const ReconstructOptions& options, TrainingRecord& record) {
    using Clock = std::chrono::steady_clock;
    auto& trainer = reconstruction.trainer;
    const double seconds_before = record.seconds;
    const std::uint64_t steps_before = trainer.step_count();
    const auto checkpoint = [&] { save_checkpoint(options, reconstruction, record); };
    auto last_checkpoint = Clock::now();
    double paused = 0; // evaluation and checkpoints do not count as training
    const auto start = Clock::now();
    const auto since = [](Clock::time_point t) { return std::chrono::duration<double>(Clock::now() - t).count(); };

    Progress progress("training");
    const auto fraction = [&] {
        return options.seconds > 0 ? record.seconds / options.seconds
                                   : static_cast<double>(trainer.step_count()) / static_cast<double>(options.steps);
    };
    while (fraction() < 1 && !interrupted) {
        trainer.step(fraction());
        record.steps = trainer.step_count();
        record.seconds = seconds_before + since(start) - paused;
        const auto pause = Clock::now();
        if (record.wants_sample()) record.add_sample(trainer.last_loss().loss, trainer.last_psnr());
        progress.show(fraction(), status_text(record, static_cast<double>(record.steps - steps_before) /
                                                          (record.seconds - seconds_before)));
        if (since(last_checkpoint) > options.checkpoint_interval) {
            checkpoint();
            last_checkpoint = Clock::now();
        }
        paused += since(pause);
    }
    checkpoint();
}

/// The configuration `static`: one moment as a 3DGS scene, without a body.
int reconstruct_scene(cpu::Threads& backend, const ReconstructOptions& options) {
    const StaticSource source = load_static_source(options.capture, options.frame);
    const StaticOptions chosen{.steps = options.steps, .max_gaussians = options.gaussians, .seed = options.seed};
    OutputFolder out(options.out);
    watch_interrupts();
    const StaticResult result = reconstruct_static(backend, source, chosen);
    if (interrupted) return exit_interrupted;
    write_static_result(out, source, chosen, result);
    const ImageScore mean = mean_score(result.scores);
    std::printf("%llu steps in %.1f s: PSNR %s dB, SSIM %s\nresults in %s\n", static_cast<unsigned long long>(result.steps),
                result.seconds, fixed(mean.psnr, 2).c_str(), fixed(mean.ssim, 4).c_str(), options.out.c_str());
    return exit_done;
}

int reconstruct(const ReconstructOptions& options) {
    cpu::Threads backend(options.threads);
    if (options.config == "static") return reconstruct_scene(backend, options);
    const Source source = load_source(backend, options);
    Reconstruction reconstruction(backend, source, configuration_of(options), options);
    TrainingRecord record;
    if (options.resume) load_checkpoint(options, reconstruction, record);
    OutputFolder out(options.out);
    for (const std::string& warning : source.warnings) warn(warning);
    std::printf("%zu Gaussians, %zu training and %zu test images, %zu threads\n", reconstruction.model.size(),
                reconstruction.trainer.photos().size(), reconstruction.test_photos.size(), backend.thread_count());
    std::fflush(stdout);

    watch_interrupts();
    train(reconstruction, options, record);
    const auto mean = write_results(out, options, source, reconstruction, record);
    if (!mean) {
        std::fprintf(stderr, "stopped after step %llu; --resume continues from there\n",
                     static_cast<unsigned long long>(record.steps));
        return exit_interrupted;
    }
    std::printf("%llu steps in %.1f s: PSNR %s dB, SSIM %s, PSNR on the person %s dB\nresults in %s\n",
                static_cast<unsigned long long>(record.steps), record.seconds, fixed(mean->psnr, 2).c_str(),
                fixed(mean->ssim, 4).c_str(), fixed(mean->psnr_person, 2).c_str(), options.out.c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) {
    ReconstructOptions options;
    CLI::App app("Reconstructs an animatable avatar from a capture.", "gsh-reconstruct");
    add_options(app, options);
    return run_program(app, argc, argv, [&] {
        check_options(options);
        return reconstruct(options);
    });
}
