// SPDX-License-Identifier: Apache-2.0
/// @file  The options of programs that find a person in a video and fit a body.
#pragma once

#include "common/program.hpp"
#include "video/detecting.hpp"
#include "video/fitting.hpp"

#include <string>
#include <vector>

namespace gsh::programs {

/// The options --calibration, --fps, --frames, --size, --begin, --end, --detector and --restart.
inline std::vector<CLI::Option*> add_detection(CLI::App& app, DetectOptions& options) {
    const auto usual = [](const auto& number) { return CLI::detail::to_string(number); };
    return {
        app.add_option("--calibration", options.calibration,
                       "cameras of several videos: any file that the detector reads"),
        app.add_option("--fps", options.fps,
                       "images that are taken from a second of the video (default " + usual(options.fps) + ")")
            ->check(above_zero()),
        app.add_option("--frames", options.frames,
                       "most images that are taken of each camera (default " + usual(options.frames) + ")")
            ->check(CLI::Range(1, 1'000'000)),
        app.add_option("--size", options.size,
                       "longer side of the images, pixels (default " + usual(options.size) + ")")
            ->check(CLI::Range(64, 8192)),
        app.add_option("--begin", options.begin, "seconds from the start of the video to the first image")
            ->check(not_negative()),
        app.add_option("--end", options.end, "seconds from the start of the video to the last image")
            ->check(not_negative()),
        app.add_option("--detector", options.detector,
                       "program that finds the person; scripts/detect --help says how it is called (default: "
                       "scripts/detect, which uses MediaPipe)"),
        app.add_flag("--restart", options.restart, "finds the person anew, with other options than before"),
    };
}

/// The options --body, --people, --height, --focal, --turn and --test-every.
inline void add_fit(CLI::App& app, FitOptions& options) {
    app.add_option("--body", options.body,
                   "BODY.npz: with the joints of SMPL-X (default: the one that gsh-body makes without --out)");
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

} // namespace gsh::programs
