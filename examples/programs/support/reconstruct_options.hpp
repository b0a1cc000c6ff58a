// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-reconstruct, and gsh-evaluate in each of its runs, is asked for; who is in a capture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace gsh {
struct Configuration;
struct StaticConfig;
} // namespace gsh

namespace gsh::examples {

/// A capture and the files that tell who is in it.
struct PeopleOptions {
    std::filesystem::path capture;
    std::vector<std::filesystem::path> bodies; ///< one for all, or one per person
    std::vector<std::string> poses;            ///< one per person; empty: poses.npz
};

struct ReconstructOptions : PeopleOptions {
    std::filesystem::path out;
    bool synthetic = false;
    bool resume = false;
    std::string config = "paper";  ///< name or JSON file
    std::vector<std::string> set;  ///< key=value on top of it
    bool refine = false;           ///< poses learn too, and test poses are fitted
    bool refine_cameras = false;   ///< cameras as well
    std::filesystem::path regions; ///< JSON lists of vertices
    std::filesystem::path priors;  ///< JSON list of an estimator's maps
    std::filesystem::path lpips;   ///< weights
    bool lpips_table = false;      ///< judge as published tables do, see LpipsScaling
    std::size_t frame = 0;         ///< of the configuration `static`
    std::uint64_t steps = 0;       ///< 0: the default of the kind of input
    double seconds = 0;            ///< of training; 0: count steps
    std::size_t gaussians = 0;     ///< 0: the default of the kind of input
    std::uint64_t seed = 0;
    std::size_t threads = 0;        ///< 0: all of the machine's
    std::uint64_t max_memory = 0;   ///< bytes; 0: no limit
    double checkpoint_interval = 5; ///< seconds
};

/// One pose file per person; poses.npz where none is named.
void complete_poses(PeopleOptions& o);

/// The pose files as a user would name them.
std::string poses_text(const PeopleOptions& o);

/// Fills in defaults; refuses combinations that make no sense.
void check_options(ReconstructOptions& o);

/// The configuration that was asked for, single settings and all.
Configuration configuration_of(const ReconstructOptions& o);

/// The same where it is a static scene's.
StaticConfig scene_configuration_of(const ReconstructOptions& o);

/// What --set says, as words behind a configuration's name.
std::string set_words(const ReconstructOptions& o);

/// Whether there is a body: a file's, or that of a capture which brings its own.
bool has_body(const PeopleOptions& o);

/// Refuses to go on without.
void check_body(const PeopleOptions& o);

/// Refuses options that lack the one that they belong to.
void check_companions(const ReconstructOptions& o);

} // namespace gsh::examples
