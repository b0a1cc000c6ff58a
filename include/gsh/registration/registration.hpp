// SPDX-License-Identifier: Apache-2.0
/// @file  Registration: before an avatar learns, rough poses and shapes are fitted to the photographs, coarse to fine.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/fit/view_keypoints.hpp>
#include <gsh/model/avatar_start.hpp>
#include <gsh/model/configured_avatar.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/photo/photo_gain.hpp>
#include <gsh/photo/reduced_photos.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/refine/refinement_params.hpp>
#include <gsh/registration/empty_error.hpp>
#include <gsh/registration/frame_doubt.hpp>
#include <gsh/registration/keypoint_term.hpp>
#include <gsh/setup/canonical_setup.hpp>
#include <gsh/setup/configuration.hpp>
#include <gsh/train/avatar_scene.hpp>
#include <gsh/train/step_history.hpp>
#include <gsh/train/train_params.hpp>
#include <gsh/train/trainer.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <numeric>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// One size of the photographs.
struct RegistrationLevel {
    int pixels = 68;               ///< about the longer side of the reduced photographs
    std::size_t gaussians = 5'000; ///< of each person: a coarse photograph shows as much with fewer, in less time
    double width = 0.7;            ///< factor on initial scales: Gaussians that cover the surface widen its outline
    double visits = 40;            ///< steps for each photographed frame
    double rate = 1;               ///< factor on all rates
    double fingers = 0;   ///< factor on the rate of fingers, jaw and eyes, which coarse photographs do not show
    double keypoints = 1; ///< factor on the weight of keypoints: a detector errs by more than a fine photograph shows
};

/// Rates and terms of a registration. Shape and biases learn from all frames, and the motion stays smooth: one camera
/// does not see the depth of a limb in one frame, but it sees it while the person turns. The weight of smoothness is
/// that for one photograph of each frame.
[[nodiscard]] inline RefinementParams registration_terms() {
    RefinementParams config;
    config.pose = RefinedGroup{.rate = 6e-3, .terms = {.pull = 1e-3, .acceleration = 0.03}};
    config.transl = RefinedGroup{.rate = 3e-3, .terms = {.pull = 1e-3, .acceleration = 0.03}};
    config.expression = RefinedGroup{};
    config.betas = RefinedGroup{.rate = 2e-2, .terms = {.pull = 1e-4}};
    config.pose_bias = RefinedGroup{.rate = 1e-3, .terms = {.pull = 1e-2}};
    config.transl_bias = RefinedGroup{.rate = 5e-4, .terms = {.pull = 1e-2}};
    config.camera_focal = RefinedGroup{.rate = 2e-3, .terms = {.pull = 1e-3}};
    config.camera_rotation = config.camera_translation = RefinedGroup{}; // a person who moves looks the same
    config.fixed_cameras.clear();
    return config;
}

/// Settings of a registration.
struct RegistrationParams {
    std::vector<RegistrationLevel> levels{
        {.pixels = 45, .gaussians = 3'000, .visits = 30},
        {.pixels = 68, .gaussians = 5'000, .visits = 30, .rate = 0.7, .fingers = 0.5},
        {.pixels = 135, .gaussians = 8'000, .width = 0.6, .visits = 60, .rate = 0.5, .fingers = 1, .keypoints = 0.3},
        {.pixels = 270, .gaussians = 10'000, .width = 0.5, .visits = 60, .rate = 0.35, .fingers = 1, .keypoints = 0.1},
    };
    RefinementParams refinement = registration_terms();
    PhotoGainParams gain{.rate = 0.03};
    bool focal = false; ///< whether the focal length learns, if all photographs are of one camera
    KeypointTermParams keypoints = {};
    std::function<void(double)> progress = {}; ///< called with the share that is done, if given
};

/// Settings for poses that are right to about 4 cm and a shape that was found from outlines, as those of fit_motion. At
/// coarse sizes such poses would only get worse, and bodies of Gaussians are narrower than people: the shape stays. Of
/// the sizes, the finest are kept: 2, or 3 for a free motion before one camera, whose depth errs by more.
[[nodiscard]] inline RegistrationParams fine_registration(std::size_t sizes = 2) {
    RegistrationParams params;
    if (sizes < params.levels.size())
        params.levels.erase(params.levels.begin(), params.levels.end() - static_cast<std::ptrdiff_t>(sizes));
    params.refinement.betas = RefinedGroup{};
    return params;
}

/// A person to register: a body with triangles, and its estimated motion.
struct RegisteredPerson {
    const BodyModel* body = nullptr;
    const Motion* motion = nullptr;
    std::vector<std::vector<ViewKeypoints>> keypoints = {}; ///< of each frame, or none
};

/// How well the bodies explain the photographs of a level, at its end.
struct RegistrationFit {
    int factor = 1; ///< by which the photographs were reduced
    std::size_t steps = 0;
    double psnr = 0; ///< of the mean squared error at the last visit of each photograph
};

/// The result of a registration.
struct Registration {
    std::vector<Motion> motions;       ///< of each person
    std::vector<RegistrationFit> fits; ///< of each level
    std::optional<double> focal; ///< factor on both focal lengths, if all photographs are of one camera and it learns
    /// How well the bodies explain each frame at the end of the last level, dB, over all its photographs:
    /// 10 log10 (squared error of an empty scene / squared error of the bodies). NaN without any.
    std::vector<double> frame_fit;
};

namespace detail {

/// Gaussians on the body's surface with a colour, a size and an opacity each. No joint learns, and Gaussians leave the
/// surface at a tenth of an avatar's rate: fast enough for clothes, too slowly to take the place of a pose. Colours do
/// not depend on the direction: that would explain the photographs better with poses that are no nearer.
[[nodiscard]] inline Configuration registration_configuration() {
    Configuration config = named_configuration("no-ao");
    config.depth_prior = config.normal_prior = false;
    config.fine_levels = FineLevels::none;
    config.avatar.hash_sh = config.avatar.hash_displacement = false;
    config.avatar.appearance.stored_displacement_rate = 3e-5;
    config.avatar.appearance.stored_sh_rate = 0.02;
    config.avatar.model = AvatarModelParams{.initial_opacity = 0.6,
                                            .sh_start = 1,
                                            .joint_rate = 0,
                                            .quat_rate = 0,
                                            .log_scale_rate = 3e-3,
                                            .opacity_logit_rate = 0.02};
    return config;
}

/// L1 alone: SSIM's windows would be as large as a limb.
[[nodiscard]] inline TrainParams registration_training(const TrainParams& of_avatar, const PhotoGainParams& gain) {
    TrainParams config = of_avatar;
    config.ssim_weight = 0;
    config.final_rate = 0.1;
    config.filter.dilation = 0.05; // a reduced photograph is sharper than a full one
    config.gain = gain;
    return config;
}

/// What one level trains on.
struct LevelInput {
    const RegistrationLevel& level;
    std::size_t steps;
    std::vector<Photo> photos;            ///< of the level's size
    std::optional<Camera<double>> camera; ///< of all photographs, if its focal length learns
    RefinementParams terms;               ///< with the level's rates
};

/// Trains bodies and corrections on photographs of one size, and puts the corrected motions into result.motions.
/// done(share) is called before each step.
template <Backend B, CpuBackend H, class Done>
void register_level(B& backend, H& host, Span<const RegisteredPerson> people, LevelInput input,
                    const RegistrationParams& params, std::uint64_t seed, const Done& done, Registration& result) {
    auto& [level, steps, photos, camera, terms] = input;
    using Model = ConfiguredAvatar<B>;
    using Scene = AvatarScene<B, Model>;
    const Configuration config = registration_configuration();
    std::deque<Model> models;
    std::deque<MotionRefinement<B>> refinements;
    std::deque<KeypointTerm<B>> keypoints;
    std::vector<CastMember<Model>> cast;
    KeypointTermParams keypoint_params = params.keypoints;
    keypoint_params.weight *= level.keypoints;
    for (std::size_t p = 0; p < people.size(); ++p) {
        const Motion& motion = result.motions[p];
        CanonicalSetup made =
            make_canonical_setup(host, *people[p].body, motion, config, level.gaussians, random_bits(seed, p));
        for (double& scale : made.samples.scales) scale *= level.width;
        models.push_back(
            make_avatar<B>(backend, made.rig, made.samples, motion.frame_count(), seed, config.avatar, made.priors));
        terms.joint_rates = joint_rates(made.rig.joint_count(), level.fingers, level.fingers);
        std::vector<Camera<double>> cameras; // the first person's refinement has the camera
        if (p == 0 && camera) cameras.push_back(*camera);
        refinements.emplace_back(backend, made.rig, motion, std::move(cameras), terms);
        auto views = people[p].keypoints; // with the focal length that the level begins with
        for (auto& of_frame : views)
            for (ViewKeypoints& view : of_frame)
                if (camera) view.camera.fx *= *result.focal, view.camera.fy *= *result.focal;
        keypoints.emplace_back(backend, made.rig, std::move(views), landmarks_of(made.rig.body), keypoint_params);
        cast.push_back({&models.back(), &motion});
    }
    Scene scene(backend, cast);
    for (std::size_t p = 0; p < people.size(); ++p) {
        scene.refine(refinements[p], p);
        if (!people[p].keypoints.empty()) scene.add(keypoints[p], p);
    }
    const auto measured = std::make_shared<const MeasuredPhotos>(photos);
    for (std::size_t i = 0; i < photos.size(); ++i)
        if (photos[i].source) photos[i].source = measured, photos[i].source_index = i;
    Trainer<B, Scene> trainer(backend, scene, photos, seed, registration_training(config.train, params.gain));

    // Of each frame, over the last visits of its photographs: squared errors, those of an empty scene, number.
    std::vector<double> squares(scene.frame_count(), 0), empty(scene.frame_count(), 0), counts(scene.frame_count(), 0);
    const auto read = [&] {
        for (const StepValues& values : trainer.history()) {
            if (values.step + photos.size() <= steps) continue;
            const std::size_t photo = trainer.photo_of_step(values.step - 1), frame = photos[photo].frame;
            squares[frame] += std::pow(10, -values.psnr / 10);
            empty[frame] += measured->empty_error(photo);
            counts[frame] += 1;
        }
    };
    while (trainer.step_count() < steps) {
        const std::size_t end = std::min<std::uint64_t>(steps, trainer.step_count() + StepHistory<B>::capacity);
        while (trainer.step_count() < end) {
            const double share = static_cast<double>(trainer.step_count()) / static_cast<double>(steps);
            done(share);
            trainer.step(share);
        }
        read();
    }
    for (std::size_t p = 0; p < people.size(); ++p) {
        refinements[p].carry_to_left_out();
        result.motions[p] = refinements[p].motion();
    }
    if (camera) *result.focal *= refinements[0].template camera<double>(0).fx / camera->fx;
    const auto decibels = [](double error, double reference) { return -10 * std::log10(error / reference); };
    const auto total = [](const std::vector<double>& of) { return std::accumulate(of.begin(), of.end(), 0.0); };
    result.frame_fit.resize(squares.size());
    std::transform(squares.begin(), squares.end(), empty.begin(), result.frame_fit.begin(), decibels);
    result.fits.back().psnr = decibels(total(squares), total(counts));
}

} // namespace detail

/// Fits motions and shapes of people to photographs, coarse to fine. Each level trains Gaussians on the bodies'
/// surfaces, and with them the corrections of a MotionRefinement: a bias of each joint and of transl for all frames,
/// corrections of each frame, and betas. The loss is L1 over random backgrounds, so outlines count as well as colours;
/// keypoints, where there are some, add their KeypointTerm. The weight of a smooth motion falls with the square of the
/// number of photographs of a frame. The motion of a level is the estimate of the next one, which starts with new
/// Gaussians.
///
/// Trains on `backend`, and prepares bodies and reduced photographs on `host`.
///
/// Frames without a photograph get the corrections of their neighbours in time. The same seed gives the same bits on
/// any number of threads.
///
/// With photographs of one camera and RegistrationParams::focal, its focal length learns, too; the photographs keep
/// theirs. Several cameras have been calibrated together and stay as they are.
///
/// Gauges  With one camera, a larger person farther away gives the same picture, and a longer focal length at a larger
///         distance differs only by its weaker perspective. The pulls to the estimates determine both, and joints are
///         best compared relative to the root.
/// Errors  ValueError: no photographs, no people, a body without triangles. Those of MotionRefinement and Trainer.
template <Backend B, CpuBackend H>
[[nodiscard]] Registration register_motions(B& backend, H& host, Span<const RegisteredPerson> people,
                                            Span<const Photo> photos, std::uint64_t seed,
                                            const RegistrationParams& params = {}) {
    constexpr std::string_view where = "register_motions";
    check_value(!people.empty(), where, "there are no people");
    check_value(!photos.empty(), where, "there are no photographs");
    Registration result;
    for (const RegisteredPerson& person : people) {
        check_value(!person.body->faces.empty(), where, "a body has no triangles, so it has no surface to fit");
        if (!person.keypoints.empty())
            check_size(where, "keypoints", person.keypoints.size(), person.motion->frame_count(), "one list per frame");
        result.motions.push_back(*person.motion);
    }
    std::set<std::size_t> frames;
    for (const Photo& photo : photos) {
        check_photo(where, photo, result.motions[0].frame_count());
        frames.insert(photo.frame);
    }
    std::vector<std::size_t> unseen;
    for (std::size_t frame = 0; frame < result.motions[0].frame_count(); ++frame)
        if (!frames.contains(frame)) unseen.push_back(frame);

    const bool learns_focal = params.focal && std::all_of(photos.begin(), photos.end(), [&](const Photo& photo) {
        return photo.camera_index == photos[0].camera_index;
    });
    if (learns_focal) result.focal = 1;
    // Cameras that see a frame together see its depth. There, smoothness would only flatten a fast motion.
    const double unseen_depth = std::pow(static_cast<double>(frames.size()) / static_cast<double>(photos.size()), 2);
    double visits = 0, visits_done = 0;
    for (const RegistrationLevel& level : params.levels) visits += level.visits;
    for (const RegistrationLevel& level : params.levels) {
        const int factor = reduction_factor(photos, level.pixels);
        const auto steps = static_cast<std::size_t>(std::lround(level.visits * static_cast<double>(frames.size())));
        detail::LevelInput input{level, steps, {}, {}, params.refinement};
        RefinementParams& terms = input.terms;
        terms.left_out = unseen;
        for (RefinedGroup* group : {&terms.pose, &terms.transl, &terms.expression, &terms.betas, &terms.pose_bias,
                                    &terms.transl_bias, &terms.camera_focal})
            group->rate *= level.rate;
        for (RefinedGroup* group : {&terms.pose, &terms.transl}) group->terms.acceleration *= unseen_depth;
        terms.final_rate = &level == &params.levels.back() ? 0.1 : 0.5;
        result.fits.push_back({factor, steps, 0});
        const ReducedPhotos reduced(host, photos, factor);
        input.photos = reduced.photos();
        const std::vector<double> weights = frame_weights(result.frame_fit); // empty at the first level
        for (Photo& photo : input.photos) {
            if (!weights.empty()) photo.weight = weights[photo.frame];
            if (!learns_focal) continue;
            photo.camera_index = 0;
            photo.camera.fx *= *result.focal, photo.camera.fy *= *result.focal;
            input.camera = photo.camera;
        }
        const auto done = [&](double share) {
            if (params.progress) params.progress((visits_done + share * level.visits) / visits);
        };
        detail::register_level(backend, host, people, std::move(input), params, seed, done, result);
        visits_done += level.visits;
    }
    return result;
}
/// The same where the backend is the host.
template <CpuBackend B>
[[nodiscard]] Registration register_motions(B& backend, Span<const RegisteredPerson> people, Span<const Photo> photos,
                                            std::uint64_t seed, const RegistrationParams& params = {}) {
    return register_motions(backend, backend, people, photos, seed, params);
}

} // namespace gsh
