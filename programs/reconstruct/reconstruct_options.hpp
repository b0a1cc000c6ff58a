// SPDX-License-Identifier: Apache-2.0
/// @file  Options of gsh-reconstruct and of each run of gsh-evaluate, and the files of the people in a capture.
#pragma once

#include "common/backend_option.hpp"

#include <gsh/body/motion_span.hpp>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace gsh {
struct Configuration;
struct StaticModelParams;
struct StaticRecipe;
} // namespace gsh

namespace gsh::programs {

/// A capture, and the body and pose files of its people.
struct PeopleOptions {
    std::filesystem::path capture;
    std::vector<std::filesystem::path> bodies; ///< one for all, or one per person
    std::vector<std::string> poses;            ///< one per person; empty: poses.npz
    double input_fps = 0;                      ///< of the poses; 0: as their files state
    std::uint64_t image_memory = 0;            ///< of the capture in bytes; 0: load_people decides
};

struct ReconstructOptions : PeopleOptions {
    std::filesystem::path out;
    bool synthetic = false;
    bool resume = false;
    bool go_on = false; ///< from a checkpoint of the same run, if there is one
    bool plan = false;  ///< only print what the run will take
    std::optional<std::string> config; ///< name or JSON file; without one, default_configuration
    std::vector<std::string> set;      ///< key=value, applied to the configuration
    bool refine = false;               ///< refine poses in training, fit test poses
    bool refine_cameras = false;       ///< refine cameras, too
    bool no_registration = false;      ///< with refine: poses are not registered before training
    /// With refine: poses are near and the shape is right, as after gsh-fit; how many sizes of photographs, 0: no.
    std::size_t fine_registration = 0;
    std::filesystem::path keypoints;            ///< with refine: of the capture's photographs
    std::filesystem::path regions;              ///< JSON lists of vertices
    std::filesystem::path priors;               ///< JSON list of an estimator's maps
    std::filesystem::path lpips;                ///< weights
    bool lpips_table = false;                   ///< LPIPS as in published tables, see LpipsScaling
    std::optional<std::string> hold_out_motion; ///< SHARE or A:B
    std::size_t frame = 0;                      ///< for the configuration `static`
    std::uint64_t steps = 0;                    ///< 0: as many as are usual for the configuration
    double seconds = 0;                         ///< of training; 0: use steps
    std::size_t gaussians = 0;                  ///< 0: the default for the kind of input
    std::uint64_t seed = 0;
    BackendOption machine;
    std::uint64_t max_memory = 0;   ///< bytes of the host, or of the GPU with --backend cuda; 0: no limit
    double checkpoint_interval = 5; ///< seconds
    std::string given;              ///< all of the above as given_options has them, for checkpoints; may be empty
};

/// Splits lists of pose files into one file per person; poses.npz if none is given.
void complete_poses(PeopleOptions& o);

/// The pose files as the user gave them, separated by commas.
std::string poses_text(const PeopleOptions& o);

/// Fills in defaults and checks the combination of options.
/// Errors  ValueError for options that exclude each other or have no effect.
void check_options(ReconstructOptions& o);

/// The number of Gaussians for each person where none is given: 170,000, or 60,000 with --synthetic, and fewer where a
/// limit on the time is too short to teach so many on the CPU's threads.
std::size_t default_gaussians(const ReconstructOptions& o);

/// True for the configuration of a static scene.
bool is_scene(const ReconstructOptions& o);

/// The configuration of --config, or the default one, with the settings of --set.
Configuration configuration_of(const ReconstructOptions& o);

/// The same for the configuration of a static scene.
StaticModelParams scene_configuration_of(const ReconstructOptions& o);

/// The recipe of a static scene that follows from the options.
StaticRecipe static_recipe(const ReconstructOptions& o);

/// The span of --hold-out-motion. SHARE is the last share of the motion, A:B are its frames from A to B.
/// Errors  ValueError for a text that is neither a number above 0 and below 1 nor two frames with a colon.
std::optional<MotionSpan> held_out_span(const ReconstructOptions& o);

/// A span as text, in one form only; empty without one.
std::string span_text(const std::optional<MotionSpan>& span);

/// The settings of --set, as words that follow the name of the configuration.
std::string set_words(const ReconstructOptions& o);

/// True if there is a body: from a file, or included in the capture.
bool has_body(const PeopleOptions& o);

/// Errors  ValueError without a body.
void check_body(const PeopleOptions& o);

/// Errors  ValueError for an option that needs another one which is not given.
void check_companions(const ReconstructOptions& o);

} // namespace gsh::programs
