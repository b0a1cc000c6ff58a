// SPDX-License-Identifier: Apache-2.0
/// @file  The options of programs that fit a body to a video.
#pragma once

#include "support/fitting.hpp"
#include "support/program.hpp"

namespace gsh::examples {

/// The options --body, --people, --height, --focal, --turn and --test-every.
inline void add_fit(CLI::App& app, FitOptions& options) {
    app.add_option("--body", options.body, "BODY.npz: with the joints of SMPL-X (gsh-body makes one)")->required();
    app.add_option("--people", options.people,
                   "several people: their number, or their names from left to right, as in ann,bob; auto: as many as "
                   "are found (default: the person who is seen longest and largest)");
    app.add_option("--height", options.heights,
                   "height of the person, metres; one camera cannot see it; for several people one for each, separated "
                   "by commas")
        ->check(CLI::Range(0.3, 3.0))
        ->delimiter(',')
        ->allow_extra_args(false);
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
