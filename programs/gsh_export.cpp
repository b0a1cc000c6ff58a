// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-export: writes avatars and scenes in formats that other programs show, still or moving.

#include "common/input_files.hpp"
#include "common/messages.hpp"
#include "common/program.hpp"
#include "common/rig_option.hpp"
#include "common/up_option.hpp"
#include "export/export_avatar.hpp"
#include "export/export_options.hpp"
#include "export/still_writer.hpp"
#include "show/light_command.hpp"
#include "view/page_export.hpp"

#include <gsh/avatar/coarser_avatar.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/message.hpp>
#include <gsh/gaussian/cloud_edits.hpp>
#include <gsh/io/splat/still_splats.hpp>

#include <cstdio>
#include <filesystem>
#include <new>
#include <string>

using namespace gsh;
using namespace gsh::programs;

namespace {

/// A scene is written as it is, in the frame of the format.
ExportResult export_scene(const ExportOptions& options, const FormatTraits& traits) {
    StillSplats splats = splats_of_file(options.input, options.input_up);
    for (const std::string& warning : splats.warnings) warn(warning);
    if (!splats.notes.up && is_y_down(options.input)) restate_up(splats, UpAxis::minus_y); // by custom
    GaussianCloud<float>& cloud = splats.cloud;
    if (options.sh_degree) cloud = with_bands_up_to(std::move(cloud), *options.sh_degree);
    if (options.gaussians) {
        cpu::Threads backend(options.threads);
        cloud = coarser_cloud(backend, cloud, *options.gaussians);
    }
    if (options.largest)
        cloud = reordered(cloud, Span<const std::uint32_t>(largest_gaussians(cloud, *options.largest)));
    if (const auto order = order_for(traits, cloud); !order.empty())
        cloud = reordered(cloud, Span<const std::uint32_t>(order));
    StillWriter writer(options, traits, splats.notes.filter);
    writer.write(options.to, cloud);
    return {.path = options.to, .gaussians = cloud.size(), .files = 1, .losses = writer.losses()};
}

int run_export(const ExportOptions& options) {
    const FormatTraits traits = check_options(options);
    std::error_code ignored;
    check_value(!std::filesystem::equivalent(options.input, options.to, ignored), "--to " + options.to.string(),
                "is the input itself");
    const ExportResult result = traits.kind == ExportKind::page       ? export_page(options)
                                : options.input.extension() == ".gsh" ? export_avatar_file(options, traits)
                                                                      : export_scene(options, traits);
    if (result.files == 0) return exit_interrupted;
    if (!result.losses.empty()) warn(result.path.string() + ": " + result.losses);
    std::string sizes;
    if (result.files > 1) sizes = ", " + std::to_string(result.files) + " files";
    if (const auto bytes = bytes_of(result.path)) sizes += ", " + fixed(static_cast<double>(*bytes) / 1e6, 1) + " MB";
    std::printf("%s: %s%zu Gaussians%s\n", result.path.c_str(), options.mesh ? "a mesh of " : "", result.gaussians,
                sizes.c_str());
    return exit_done;
}

void add_options(CLI::App& app, ExportOptions& o) {
    app.add_option("input", o.input, "AVATAR.gsh, or a scene (" + scene_endings() + ")")->required();
    app.add_option("--to", o.to, "the file to write; its ending chooses the format: " + known_endings())
        ->required();
    app.add_option("--poses", o.poses,
                   "a motion in any layout that gsh reads (.npz, .bvh, .glb, folder); without it, the canonical pose; "
                   "for .html several, without any those of the built-in actor")
        ->allow_extra_args(false);
    app.add_option("--frame", o.frame, "frame of the motion, for a still file (default 0)")
        ->check(not_negative());
    app.add_option(
        "--frames", o.frames,
        "frames A:B of the motion, both included, or every S-th of them, A:B:S: a moving .glb or .usda, or a "
        "folder of numbered files named as the file without its ending; for .html the part that it plays");
    app.add_option("--sh", o.sh_degree, "degree of SH that is kept at most (default: all that the format holds)")
        ->check(CLI::Range(0, 3));
    app.add_option("--up", o.up,
                   "the vertical of " + y_down_endings() + ": -y (default), as most programs expect, or y")
        ->check(CLI::IsMember({"y", "-y"}));
    add_input_up(app, o.input_up);
    app.add_option("--gaussians", o.gaussians,
                   "merge neighbouring Gaussians that look alike until N are left, for small pictures")
        ->check(above_zero());
    app.add_option("--largest", o.largest, "keep the N Gaussians with the largest size times opacity")
        ->check(above_zero());
    app.add_option("--spz", o.spz_version, "version of .spz: 3 (default) or 4")->check(CLI::IsMember({3, 4}));
    app.add_option("--clusters", o.clusters, "number of rigid pieces of a moving .glb (default 512)")
        ->check(CLI::Range(1, 65536));
    app.add_flag("--mesh", o.mesh, "write a .glb with a skinned, coloured mesh instead of Gaussians");
    app.add_flag("--as-stored", o.as_stored,
                 "keep the world of the motion; otherwise it is rotated so that the body stands along +y");
    add_rig(app, o.rig);
    add_light(app, o.light);
    add_threads(app, o.threads);
}

} // namespace

int main(int argc, char** argv) try {
    ExportOptions options;
    CLI::App app("Writes avatars and scenes in formats that other programs show.", "gsh-export");
    add_options(app, options);
    return run_program(app, argc, argv, [&] { return run_export(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-export");
}
