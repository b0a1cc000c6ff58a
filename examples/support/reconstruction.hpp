// SPDX-License-Identifier: Apache-2.0
/// @file  What gsh-reconstruct works on: its options, the capture, the model with its trainer, the record it keeps.
#pragma once

#include "support/program.hpp"

#include <gsh/backend/threads.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/body/surface_samples.hpp>
#include <gsh/io/body_file.hpp>
#include <gsh/io/any_capture.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/io/people_capture.hpp>
#include <gsh/io/region_file.hpp>
#include <gsh/synthetic/actor.hpp>
#include <gsh/synthetic/actor_motion.hpp>
#include <gsh/synthetic/studio.hpp>
#include <gsh/train/avatar_model.hpp>
#include <gsh/train/canonical_setup.hpp>
#include <gsh/train/configuration.hpp>
#include <gsh/train/configuration_file.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/memory.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/trainer.hpp>

#include <CLI/CLI.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

struct ReconstructOptions {
    std::filesystem::path capture, out;
    std::vector<std::filesystem::path> bodies; ///< one for all, or one per person
    bool synthetic = false;
    bool resume = false;
    std::string config = "paper";   ///< name or JSON file
    std::vector<std::string> set;   ///< key=value on top of it
    bool refine = false;            ///< poses learn too, and test poses are fitted
    bool refine_cameras = false;    ///< cameras as well
    std::filesystem::path regions;  ///< JSON lists of vertices
    std::filesystem::path lpips;    ///< weights
    std::size_t frame = 0;          ///< of the configuration `static`
    std::uint64_t steps = 0;        ///< 0: the default of the kind of input
    double seconds = 0;             ///< of training; 0: count steps
    std::size_t gaussians = 0;      ///< 0: the default of the kind of input
    std::uint64_t seed = 0;
    std::size_t threads = 0;        ///< 0: all of the machine's
    std::vector<std::string> poses; ///< one per person; empty: poses.npz
    std::uint64_t max_memory = 0;   ///< bytes; 0: no limit
    double checkpoint_interval = 5; ///< seconds
};

/// The options --body and --poses.
inline void add_people(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--body", o.bodies, "body model (.npz, SMPL / SMPL-H / SMPL-X layout); of several people one for all, or one each")
        ->allow_extra_args(false);
    app.add_option("--poses", o.poses,
                   "pose file in the capture's folder (default poses.npz), or a path; of several people one each, repeated or "
                   "separated by commas")
        ->allow_extra_args(false);
}

inline void add_options(CLI::App& app, ReconstructOptions& o) {
    app.add_option("--capture", o.capture, "folder with images/, cameras.json and poses");
    add_people(app, o);
    app.add_flag("--synthetic", o.synthetic, "film the built-in actor and reconstruct that, instead of a capture");
    app.add_option("--out", o.out, "folder for the results")->required();
    app.add_option("--steps", o.steps, "training steps (default 3000; 1200 with --synthetic)")->check(above_zero());
    app.add_option("--seconds", o.seconds, "train for so long instead of counting steps")->check(above_zero());
    app.add_option("--gaussians", o.gaussians, "number of Gaussians, of each person (default 170000; 60000 with --synthetic)")
        ->check(CLI::Range(1, 100'000'000));
    app.add_option("--seed", o.seed, "of all random choices (default 0)")->check(not_negative());
    add_threads(app, o.threads);
    app.add_option("--max-memory", o.max_memory, "bytes that training may take; fewer Gaussians if need be")
        ->check(above_zero());
    app.add_option("--checkpoint-interval", o.checkpoint_interval, "seconds between checkpoints (default 5)")
        ->check(above_zero());
    app.add_option("--config", o.config, "configuration by name, or a JSON file of settings (default paper); static: one frame, no body");
    app.add_option("--set", o.set, "a setting of the configuration, key=value; may be repeated");
    app.add_flag("--refine", o.refine, "poses learn with the avatar; test poses are fitted to the test images, and reported as such");
    app.add_flag("--refine-cameras", o.refine_cameras, "with --refine: all cameras but the first learn too");
    app.add_option("--regions", o.regions, "JSON lists of face and hand vertices, or importance per vertex");
    app.add_option("--lpips", o.lpips, "LPIPS weights (.safetensors or .npz): judge by LPIPS, too");
    app.add_option("--frame", o.frame, "with --config static: the frame (default 0)");
    app.add_flag("--resume", o.resume, "go on from the checkpoint in --out");
}

/// Words between commas, one after the other; a word that names a file of `folder` is left whole.
inline std::vector<std::string> listed(const std::vector<std::string>& words, const std::filesystem::path& folder) {
    std::vector<std::string> result;
    for (const std::string& word : words) {
        std::error_code ignored;
        const bool whole = std::filesystem::exists(folder / word, ignored);
        for (std::size_t begin = 0, end = 0; end != std::string::npos; begin = end + 1) {
            end = whole ? std::string::npos : word.find(',', begin);
            result.push_back(word.substr(begin, end - begin));
            check_value(!result.back().empty(), "--poses " + word, "names an empty file between its commas");
        }
    }
    return result;
}

/// One pose file per person; poses.npz where none is named.
inline void complete_poses(ReconstructOptions& o) {
    o.poses = o.poses.empty() ? std::vector<std::string>{"poses.npz"} : listed(o.poses, o.capture);
}
/// The pose files as a user would name them.
inline std::string poses_text(const ReconstructOptions& o) {
    std::string text;
    for (const std::string& poses : o.poses) text += (text.empty() ? "" : ", ") + poses;
    return text;
}

/// Fills in defaults; refuses combinations that make no sense.
inline void check_options(ReconstructOptions& o) {
    const auto expect = [](bool condition, const char* message) {
        if (!condition) throw ValueError(message);
    };
    const bool scene = o.config == "static"; // needs no body, and no poses
    const bool own_body = !o.capture.empty() && recognise_capture(o.capture) == CaptureLayout::gala;
    expect(o.synthetic || (!o.capture.empty() && (scene || own_body || !o.bodies.empty())),
           "--capture and --body are needed, or --synthetic alone");
    expect(!scene || !(o.synthetic || o.refine || o.resume || o.seconds > 0 || !o.set.empty()),
           "--config static takes a capture and --steps; it cannot resume, refine or change settings");
    expect(!o.synthetic || (o.capture.empty() && o.bodies.empty() && o.poses.empty()),
           "--synthetic brings its own capture, body and poses; leave out --capture, --body and --poses");
    expect(o.steps == 0 || o.seconds == 0, "--steps and --seconds exclude each other");
    expect(o.refine || !o.refine_cameras, "--refine-cameras needs --refine");
    if (o.steps == 0) o.steps = o.synthetic ? 1200 : 3000;
    if (o.gaussians == 0) o.gaussians = o.synthetic ? 60000 : 170000;
    complete_poses(o);
}

/// The configuration that was asked for, single settings and all.
inline Configuration configuration_of(const ReconstructOptions& o) {
    Configuration configuration = find_configuration(o.config);
    for (const std::string& setting : o.set) {
        const auto equals = setting.find('=');
        check_value(equals != std::string::npos, "--set " + setting, "must be key=value");
        set_setting(configuration, setting.substr(0, equals), setting.substr(equals + 1), "--set");
        configuration.name += " " + setting;
    }
    return configuration;
}

/// What is reconstructed: body models, the capture and who is in it, wherever they come from.
struct Source {
    std::vector<BodyModel> bodies;
    std::vector<RegionLists> regions; ///< of each body
    Capture capture;
    std::vector<CapturePerson> people;
    std::vector<std::string> warnings;

    [[nodiscard]] const BodyModel& body(std::size_t person = 0) const { return bodies[people[person].body]; }
    /// A person's mesh at a frame, as the capture has it.
    [[nodiscard]] PosedBody posed(std::size_t person, std::size_t frame) const {
        const Motion& motion = people[person].motion;
        return pose_body(body(person), motion.pose_at(frame), motion.transl[frame], motion.betas, motion.expression_at(frame));
    }
    [[nodiscard]] BodyRegions body_regions_of(std::size_t person) const {
        return body_regions(body(person), regions[people[person].body]);
    }
};

inline Source load_source(cpu::Threads& backend, const ReconstructOptions& o) {
    Source source;
    if (o.synthetic) {
        std::printf("filming the built-in actor\n");
        std::fflush(stdout);
        source.bodies.push_back(make_actor());
        source.capture = film(backend, source.bodies[0], actor_motion(ActorMotion::talk, 12));
        source.capture.name = "the built-in actor";
        source.people.push_back({"actor", 0, source.capture.motion});
    } else {
        for (const auto& file : o.bodies) source.bodies.push_back(load_body_model(file));
        const std::vector<std::filesystem::path> poses(o.poses.begin(), o.poses.end());
        PeopleCapture loaded = load_people_capture(backend, o.capture, source.bodies, poses, {}, &source.warnings);
        source.capture = std::move(loaded.any.capture);
        source.people = std::move(loaded.people);
        if (loaded.any.rig) source.bodies.assign(1, std::move(loaded.any.rig->body));
        if (source.bodies[0].faces.empty())
            source.warnings.push_back(o.capture.string() + ": its body has no triangles, so each person gets a Gaussian per vertex; "
                                      "region mask, priors and --gaussians have no effect, and regions are not judged");
    }
    for (const BodyModel& body : source.bodies)
        source.regions.push_back(o.regions.empty() ? RegionLists() : read_regions(o.regions, body.vertex_count()));
    return source;
}

/// Photographs of a capture's training or test views; they point into the capture.
inline std::vector<Photo> photos_of(const Capture& capture, bool test) {
    std::vector<Photo> photos;
    for (const CaptureView& view : capture.views(test)) {
        const NamedCamera& camera = capture.cameras[view.camera];
        char frame[16];
        std::snprintf(frame, sizeof frame, "%04zu", view.frame);
        const PixelImage* plate = capture.background(view.camera);
        photos.push_back({camera.name + "_" + frame, camera.camera, view.frame, capture.image(view).data, view.camera,
                          plate ? Span<const std::uint8_t>(plate->data) : Span<const std::uint8_t>()});
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

/// How many Gaussians each person gets: as many as were asked for, or as fit where memory is limited.
/// Errors  ValueError if not even a tenth of them fit.
inline std::size_t gaussian_count(const Source& source, const Configuration& configuration, const ReconstructOptions& o) {
    if (o.max_memory == 0) return o.gaussians;
    std::size_t pixels = 0;
    for (const auto& camera : source.capture.cameras)
        pixels = std::max(pixels, static_cast<std::size_t>(camera.camera.width) * static_cast<std::size_t>(camera.camera.height));
    std::size_t held = 0; // what is in memory already
    for (const auto& image : source.capture.images) held += image.data.size();
    const MemoryModel memory = training_memory(configuration.avatar, pixels, held, source.people.size());
    const std::size_t count = std::min(o.gaussians, memory.gaussians_within(o.max_memory));
    if (count < o.gaussians / 10)
        throw ValueError("--max-memory " + std::to_string(o.max_memory) + " is too little: training " +
                         std::to_string(o.gaussians) + " Gaussians takes about " +
                         std::to_string(memory.bytes(o.gaussians)) + " bytes, a tenth of them " +
                         std::to_string(memory.bytes(o.gaussians / 10)));
    if (count < o.gaussians)
        warn(std::to_string(count) + " instead of " + std::to_string(o.gaussians) + " Gaussians, to stay within " +
             std::to_string(o.max_memory) + " bytes");
    return count;
}

/// The models and their trainer, ready for the first step.
struct Reconstruction {
    using Backend = cpu::Threads;
    using Model = AvatarModel<Backend, float>;
    using Refinement = MotionRefinement<Backend, float>;
    using TrainerType = Trainer<Backend, float, Model>;

    /// One of the people.
    struct Person {
        std::string name;
        CanonicalSetup setup;
        Model model;
        std::optional<Refinement> refinement, test_refinement; ///< of training frames, and of those to judge by

        Person(Backend& backend, std::string called, CanonicalSetup made, std::uint64_t seed, const AvatarConfig& config)
            : name(std::move(called)), setup(std::move(made)),
              model(backend, setup.rig, setup.samples, seed, config, setup.priors) {}
    };

    Configuration configuration;
    std::deque<Person> people; ///< they stay where they are
    std::vector<Photo> test_photos;
    TrainerType trainer;

    /// source must outlive this: photographs are not copied.
    Reconstruction(Backend& backend, const Source& source, const Configuration& chosen, const ReconstructOptions& o)
        : configuration(chosen), test_photos(test_photos_of(source.capture)),
          trainer(backend, cast_of(backend, source, o), photos_of(source.capture, false), o.seed, configuration.train) {
        if (!o.refine) return;
        RefinementConfig config;
        if (o.refine_cameras) config.camera_rotation.rate = 2e-4, config.camera_translation.rate = 2e-4;
        std::set<std::size_t> seen;
        for (const Photo& photo : trainer.photos()) seen.insert(photo.frame);
        for (std::size_t frame = 0; frame < trainer.frame_count(); ++frame)
            if (!seen.contains(frame)) config.left_out.push_back(frame);
        std::vector<Camera<double>> cameras; // the same for all, so that one person's refinement holds them
        if (o.refine_cameras)
            for (const auto& camera : source.capture.cameras) cameras.push_back(camera.camera);
        for (std::size_t p = 0; p < people.size(); ++p) {
            Person& person = people[p];
            person.refinement.emplace(backend, person.setup.rig, person.setup.motion,
                                      p == 0 ? cameras : std::vector<Camera<double>>(), config);
            trainer.refine(*person.refinement, p);
        }
    }
    Reconstruction(const Reconstruction&) = delete;

    /// Everybody's Gaussians.
    [[nodiscard]] std::size_t gaussian_count() const { return trainer.splat_count(); }

    /// Fits the poses of the frames to judge by to their own photographs, the avatars staying as they are; several people
    /// take turns. Figures after this are figures of test-time refinement.
    void refine_test_poses(Backend& backend) {
        for (std::size_t p = 0; p < people.size(); ++p) {
            Person& person = people[p];
            person.refinement->carry_to_left_out();
            person.test_refinement.emplace(backend, person.setup.rig, person.refinement->motion(), std::vector<Camera<double>>(),
                                           test_time_config());
            trainer.refine(*person.test_refinement, p);
        }
        std::set<std::size_t> frames;
        for (const Photo& photo : test_photos) frames.insert(photo.frame);
        const std::size_t rounds = people.size() > 1 ? 2 : 1, steps = 60 / rounds;
        for (const std::size_t frame : frames) {
            trainer.query(frame);
            std::vector<Observation> observations;
            for (const Photo& photo : test_photos)
                if (photo.frame == frame) observations.push_back({photo.camera, photo.rgba});
            for (std::size_t turn = 0; turn < rounds * people.size(); ++turn) {
                FrozenScene<TrainerType> frozen{&trainer, frame, turn % people.size()};
                PoseFit<Backend, float, FrozenScene<TrainerType>> fit(
                    backend, frozen, configuration.train.filter,
                    {.steps = steps, .ssim_weight = configuration.train.ssim_weight, .background = configuration.train.background});
                fit.fit(*people[frozen.person].test_refinement, frame, observations);
            }
        }
    }
    /// Back to the poses of training.
    void end_test_refinement() {
        for (std::size_t p = 0; p < people.size(); ++p) trainer.refine(*people[p].refinement, p);
    }

private:
    /// Makes the people; each draws from random numbers of their own.
    std::vector<CastMember<Model>> cast_of(Backend& backend, const Source& source, const ReconstructOptions& o) {
        std::vector<CastMember<Model>> cast;
        const std::size_t count = examples::gaussian_count(source, configuration, o);
        for (std::size_t p = 0; p < source.people.size(); ++p) {
            const CapturePerson& from = source.people[p];
            const std::uint64_t seed = p == 0 ? o.seed : random_bits(o.seed, p);
            CanonicalSetup setup = make_canonical_setup(backend, source.body(p), from.motion, configuration, count, seed,
                                                        source.regions[from.body]);
            Person& person = people.emplace_back(backend, from.name, std::move(setup), seed, configuration.avatar);
            cast.push_back({&person.model, &person.setup.motion});
        }
        return cast;
    }
};

/// What is kept about the course of training, for the report and for resuming.
struct TrainingRecord {
    std::uint64_t steps = 0;
    double seconds = 0; ///< of training alone
    std::uint64_t interval = 10;
    std::vector<std::pair<double, double>> loss, psnr; ///< (step, value) of the training view at hand
    std::array<double, stage_names.size()> stage_seconds{}; ///< in the order of Stage
    std::uint64_t timed_steps = 0;                          ///< steps that stage_seconds covers

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
