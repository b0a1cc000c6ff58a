// SPDX-License-Identifier: Apache-2.0
/// @file  The options of programs that fit a body to a video.
#pragma once

#include "support/fitting.hpp"
#include "support/program.hpp"

namespace gsh::examples {

/// The options --body, --height, --focal, --turn and --test-every.
inline void add_fit(CLI::App& app, FitOptions& options) {
    app.add_option("--body", options.body, "BODY.npz: with the joints of SMPL-X (gsh-body makes one)")->required();
    app.add_option("--height", options.height, "height of the person, metres; one camera cannot see it")
        ->check(CLI::Range(0.3, 3.0));
    app.add_option("--focal", options.focal,
                   "focal length of a single camera in pixels of its images (default: of the metadata, else learned)")
        ->check(above_zero());
    app.add_option("--turn", options.turn,
                   "yes: the person turns in place in one pose; no: not; auto (default): found by itself")
        ->check(CLI::IsMember({"auto", "yes", "no"}));
    app.add_option("--test-every", options.test_every, "leave one in so many frames out of training, to judge by it")
        ->check(CLI::Range(2, 1000));
}

} // namespace gsh::examples
