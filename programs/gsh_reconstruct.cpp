// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-reconstruct: trains an animatable avatar from a capture of a person and evaluates it on held-out views.
///
/// 1. Load the body and the capture, or generate both (--synthetic).
/// 2. Sample Gaussians on the body's surface and attach them to the body's rig.
/// 3. With --refine, fit poses and shape to the photographs.
/// 4. Train, with a checkpoint every few seconds.
/// 5. Evaluate on the test views and write the results.
///
/// With --plan, only the memory and the time that this will take are printed.

#include "common/figures.hpp"
#include "common/machine.hpp"
#include "common/output_folder.hpp"
#include "common/program.hpp"
#include "common/stored_options.hpp"
#include "evaluate/evaluation_tables.hpp"
#include "reconstruct/load_input.hpp"
#include "reconstruct/plan.hpp"
#include "reconstruct/reconstruct_command.hpp"
#include "reconstruct/reconstruct_options.hpp"
#include "reconstruct/reconstruction.hpp"
#include "reconstruct/results.hpp"
#include "reconstruct/static_reconstruction.hpp"
#include "reconstruct/training.hpp"

#include <gsh/reconstruct/resume.hpp>

#include <cstdio>
#include <filesystem>
#include <new>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

using namespace gsh;
using namespace gsh::programs;

namespace {

/// The configuration `static`: one frame as a 3DGS scene, without a body.
int reconstruct_scene(Machine& machine, OutputFolder& out, const ReconstructOptions& options) {
    const StaticPhotos input = load_static_photos(machine.host(), options.capture, options.frame);
    for (const std::string& warning : input.warnings) warn(warning);
    const StaticRecipe recipe = static_recipe(options);
    watch_interrupts();
    const StaticResult result = reconstruct_static(machine, input, recipe);
    if (interrupted) return exit_interrupted;
    write_static_result(out, machine, input, recipe, result);
    const ImageScore mean = mean_score(result.scores);
    std::printf("%llu steps in %.1f s: PSNR %s dB, SSIM %s\nresults in %s\n",
                static_cast<unsigned long long>(result.record.steps), result.record.seconds,
                fixed(mean.psnr, 2).c_str(), fixed(mean.ssim, 4).c_str(), options.out.c_str());
    return exit_done;
}

/// Options by which a run may differ from the one that wrote a checkpoint, and is still the same run.
const std::vector<std::string> options_of_machine{"--threads", "--backend", "--device", "--image-memory",
                                                  "--checkpoint-interval"};

/// The checkpoint that --continue goes on from; empty if there is none of this run, with a warning if there is another.
std::filesystem::path checkpoint_of_same_run(const ReconstructOptions& options, const ReconstructionSetup& setup) {
    const std::filesystem::path path = checkpoint_path(options);
    if (!has_checkpoint(path)) return {};
    try {
        std::string damage;
        std::filesystem::path whole = whole_checkpoint(path, damage);
        check_value(same_options(checkpoint_words(whole), options.given, options_of_machine), whole.string(),
                    "is of a run with other options");
        check_checkpoint(whole, setup);
        if (!damage.empty()) warn(damage);
        return whole;
    } catch (const Error& error) {
        warn(std::string(error.what()) + "; training begins anew");
        return {};
    }
}

/// `checkpoint` is the one to go on from, with --resume; empty without it.
int reconstruct(const ReconstructOptions& options, std::filesystem::path checkpoint) {
    Machine machine(options.machine);
    OutputFolder out(options.out);
    if (is_scene(options)) return reconstruct_scene(machine, out, options);
    ReconstructionInput input = load_input(machine.host(), options);
    const Recipe recipe = recipe_for(options, input);
    (void)lpips_of(options); // reports errors in the file before training
    if (options.resume)
        check_checkpoint(checkpoint, run_text(input, recipe), resume_advice); // before work is done
    if (recipe.refine && recipe.registration) register_shown(machine, input, recipe);
    ReconstructionSetup made = make_setup(machine, input, recipe);
    if (options.go_on) checkpoint = checkpoint_of_same_run(options, made);
    take_photographs(made, input.capture);
    const auto reconstruction = make_reconstruction(machine, std::move(made));
    const ReconstructionSetup& setup = reconstruction->setup;
    TrainingRecord record;
    if (!checkpoint.empty()) record = load_checkpoint(checkpoint, *reconstruction, resume_advice);
    for (const std::string& warning : input.warnings) warn(warning);
    for (const std::string& warning : setup.warnings) warn(warning);
    if (input.people.size() > 1) std::printf("%zu people, ", input.people.size());
    std::printf("%zu Gaussians, %zu training and %zu test images%s, %s\n", setup.gaussian_count(), setup.photos.size(),
                setup.test_photos.size(), input.capture.stored ? ", read when they are needed" : "",
                machine.computed_on().text().c_str());
    if (!setup.light_text.empty()) std::printf("%s\n", setup.light_text.c_str());
    if (input.registration) std::printf("registration: %s\n", input.registration->text().c_str());
    std::fflush(stdout);

    watch_interrupts();
    train_shown(*reconstruction, recipe, options, record);
    const auto figures =
        naming_checkpoint(record, [&] { return write_results(out, options, machine, input, *reconstruction, record); });
    if (!figures) {
        std::fprintf(stderr, "stopped after step %llu; --resume continues from there\n",
                     static_cast<unsigned long long>(record.steps));
        return exit_interrupted;
    }
    std::error_code ignored;
    std::filesystem::remove(checkpoint_before(checkpoint_path(options)), ignored); // the last one has come to its end
    const ImageScore& mean = figures->mean;
    std::printf("%llu steps in %.1f s: PSNR %s dB, SSIM %s, PSNR on the person %s dB\n",
                static_cast<unsigned long long>(record.steps), record.seconds, fixed(mean.psnr, 2).c_str(),
                fixed(mean.ssim, 4).c_str(), fixed(mean.psnr_person, 2).c_str());
    for (const std::string& finding : figures->findings) std::printf("%s\n", finding.c_str());
    if (figures->motion) std::printf("%s", markdown_table(motion_rows(*figures->motion)).c_str());
    std::printf("results in %s\n", options.out.c_str());
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    ReconstructOptions options;
    CLI::App app("Reconstructs an animatable avatar from a capture.", "gsh-reconstruct");
    add_options(app, options);
    return run_program(app, argc, argv, [&] {
        std::filesystem::path checkpoint;
        if (options.resume && !is_scene(options)) { // check_options refuses that
            check_resumable(options);
            std::string damage;
            checkpoint = whole_checkpoint(checkpoint_path(options), damage);
            if (!damage.empty()) warn(damage);
            if (const std::string earlier = checkpoint_words(checkpoint); !earlier.empty())
                restore_options(app, earlier, checkpoint.string(), {"--steps", "--seconds"});
        }
        const bool by_time = options.gaussians == 0 && options.seconds > 0;
        check_options(options);
        if (by_time) // a run that is resumed for longer keeps its Gaussians
            app.get_option("--gaussians")->add_result(std::to_string(options.gaussians));
        options.given = given_options(app, {"--help", "--out", "--resume", "--continue"});
        return options.plan ? print_plan(options) : reconstruct(options, checkpoint);
    });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-reconstruct");
}
