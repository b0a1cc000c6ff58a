// SPDX-License-Identifier: Apache-2.0
/// @file  A scene of trainable avatars in their motions: one person, or several people in the same photographs.
#pragma once

#include <gsh/avatar/mutual_shadows.hpp>
#include <gsh/avatar/rig.hpp>
#include <gsh/backend/backend.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/camera/camera_input.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/deferred.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/learn/learned_array.hpp>
#include <gsh/light/shadow_map.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/photo/loss_term.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/render/raster_cache.hpp>
#include <gsh/train/splat_scene.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

namespace gsh {

/// One person of a scene: the model to train, and the person's poses. The caller owns both.
template <class Model>
struct CastMember {
    Model* model = nullptr;
    const Motion* motion = nullptr;
};

/// Prefix of the names of a person's arrays, in a scene of several people and in its files. Names of the first person's
/// arrays have no prefix.
[[nodiscard]] inline std::string person_prefix(std::size_t person) {
    return person == 0 ? std::string() : "person" + std::to_string(person) + "/";
}

/// Bytes that the prepared poses of one person may take: 500 frames of SMPL-X. Those of longer motions are computed in
/// each step.
inline constexpr std::size_t most_pose_memory = 64 << 20;
[[nodiscard]] constexpr bool keeps_poses(std::size_t frame_count, std::size_t pose_bytes) {
    return frame_count * pose_bytes <= most_pose_memory;
}

/// People in the frames of their motions. They share only photographs and frames. Each has a model, a motion, and
/// perhaps a refinement of the motion.
///
/// The splats of all people lie in one buffer, one person after the other, and are rendered in one pass, so that people
/// hide each other. People whose models have a light also cast shadows on each other, within shadow_reach. In backward,
/// each model reads its own part of the gradient. Functions about one person take that person's number.
template <Backend B, class Model, std::floating_point T = typename Model::Scalar>
class AvatarScene {
public:
    using Scalar = T;
    using BackendType = B;

    /// Several people. Every motion covers every frame: in frames before a person enters, place the person outside
    /// every camera's view.
    /// Errors  ValueError: no people, or one model twice. ShapeError: motions of different lengths.
    AvatarScene(B& backend, const std::vector<CastMember<Model>>& cast) : backend_(&backend), people_(cast.size()) {
        check_value(!cast.empty(), "AvatarScene", "there are no people");
        for (std::size_t i = 0; i < cast.size(); ++i) {
            Person& person = people_[i];
            person.model = cast[i].model, person.motion = cast[i].motion;
            for (std::size_t k = 0; k < i; ++k)
                check_value(people_[k].model != person.model, "AvatarScene",
                            "person " + std::to_string(i) + " has the model of person " + std::to_string(k) +
                                ", expected a model of its own");
            check_size("AvatarScene", "poses of person " + std::to_string(i), person.motion->frame_count(),
                       frame_count(), "every motion must cover every frame");
        }
        update_size();
    }
    /// One person.
    AvatarScene(B& backend, Model& model, const Motion& motion)
        : AvatarScene(backend, std::vector<CastMember<Model>>{{&model, &motion}}) {}

    /// After models have changed their numbers of Gaussians. A trainer of the scene must forget its steps
    /// (Trainer::release_memory).
    void update_size() {
        size_ = 0;
        for (Person& person : people_) person.first_splat = size_, size_ += person.model->size();
    }

    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] std::size_t frame_count() const { return people_.front().motion->frame_count(); }
    [[nodiscard]] B& backend() { return *backend_; }
    [[nodiscard]] std::size_t person_count() const { return people_.size(); }
    [[nodiscard]] Model& model(std::size_t person = 0) { return *at(person).model; }
    /// A person's part of the scene's splats, or of their gradient.
    template <class View>
    [[nodiscard]] View part(std::size_t person, const View& scene) const {
        return scene.subview(at(person).first_splat, at(person).model->size());
    }
    /// What messages call a splat of several people's: "Gaussian 12 of person 1", both counted from 0.
    [[nodiscard]] std::string name_of(std::size_t splat) const {
        if (people_.size() == 1) return {};
        const auto next = std::find_if(people_.begin(), people_.end(),
                                       [splat](const Person& person) { return person.first_splat > splat; });
        return "Gaussian " + std::to_string(splat - std::prev(next)->first_splat) + " of person " +
               std::to_string(std::prev(next) - people_.begin());
    }
    /// A person's poses as they were before any refinement.
    [[nodiscard]] const Motion& motion(std::size_t person = 0) const { return *at(person).motion; }
    /// A person's present pose at a frame. The reference is valid until the next call for the same person. Poses that
    /// do not learn are prepared once and kept, unless all of a person's would take more than most_pose_memory.
    [[nodiscard]] const RigPose<B, T>& pose(std::size_t frame, std::size_t person = 0) {
        Person& of = at(person);
        if (of.refinement) {
            of.refinement->pose(frame, of.pose);
        } else if (keeps_poses(of)) {
            prepare_pose(of, frame);
        } else {
            of.model->rig().upload_pose(*of.motion, frame, of.pose);
        }
        return present_pose(of, frame);
    }

    /// From now on `refinement` provides the person's poses, and the cameras if it has any. They learn with the
    /// avatars. It must outlive the scene.
    /// Errors  ValueError if another person's refinement has the cameras already; all people share the cameras.
    void refine(MotionRefinement<B, T>& refinement, std::size_t person = 0) {
        for (std::size_t i = 0; i < people_.size(); ++i)
            check_value(i == person || !refinement.camera_count() || !people_[i].refinement ||
                            !people_[i].refinement->camera_count(),
                        "AvatarScene::refine",
                        "cameras learn with person " + std::to_string(i) + "; give them to one person's refinement");
        at(person).refinement = &refinement;
    }
    [[nodiscard]] MotionRefinement<B, T>* refinement(std::size_t person = 0) const { return at(person).refinement; }

    /// From now on a term of a person's pose or model counts in the loss. It must outlive the scene.
    void add(LossTerm<B, T>& term, std::size_t person = 0) {
        check_person(person);
        terms_.push_back({&term, person});
    }

    // SplatScene ------------------------------------------------------------------------------------------------------

    void set_progress(std::uint64_t /*step*/, double progress) {
        for (Person& person : people_) {
            person.model->set_progress(progress);
            if (person.refinement) person.refinement->set_progress(progress);
        }
    }
    void prepare(std::size_t frame) {
        for (Person& person : people_) person.model->update_canonical(frame);
    }
    void forward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<T>& splats) {
        std::vector<vec3<double>> roots;
        for (const Person& person : people_) roots.push_back(person.motion->transl[frame]);
        for (std::size_t p = 0; p < people_.size(); ++p) people_[p].model->move(pose(frame, p));
        const auto caster = [&](std::size_t p) {
            return casts_shadow(people_[p]) ? people_[p].model->caster() : ShadowCaster<T>();
        };
        pose_people<T>(roots, caster, [&](std::size_t p, Span<const ShadowCaster<T>> others) {
            people_[p].model->write_splats(present_pose(people_[p], frame), frame, center, part(p, splats), others);
        });
    }
    void backward(std::size_t frame, const Deferred<vec3<T>>& center, const SplatView<const T>& dL_dsplats,
                  Span<vec3<T>> dL_dcenter) {
        for (std::size_t p = 0; p < people_.size(); ++p) {
            with_pose_gradient(people_[p], frame, [&](const auto& pose, const auto& dL_dpose) {
                people_[p].model->backward(pose, frame, center, part(p, dL_dsplats), dL_dpose, dL_dcenter);
            });
        }
        for (const Term& term : terms_) {
            if (!term.of->counts(frame)) continue;
            with_pose_gradient(people_[term.person], frame, [&](const auto& pose, const auto& dL_dpose) {
                term.of->backward(frame, pose, dL_dpose);
            });
        }
    }
    /// Adjoint of the last forward with respect to one person's pose alone: adds to the person's refinement.
    void backward_to_pose(std::size_t person, std::size_t frame, const Deferred<vec3<T>>& center,
                          const SplatView<const T>& dL_dsplats) {
        Person& of = at(person);
        const RigPoseGradient<T> dL_dpose = of.refinement->pose_gradient();
        of.model->backward_to_pose(of.pose, frame, center, part(person, dL_dsplats), dL_dpose);
        of.refinement->accumulate(frame, dL_dpose);
    }
    /// Only cameras of training photographs are refined. A test view keeps its own, see Trainer::render.
    [[nodiscard]] CameraInput<T> camera(const Photo& photo) const {
        const auto* cameras = camera_refinement();
        return cameras ? cameras->camera_input(photo.camera_index) : photo.camera.template cast<T>();
    }
    [[nodiscard]] CameraGradientView<T> camera_gradient(const Photo& photo) {
        const bool learns = learns_camera(photo);
        dL_dcamera_.resize(learns ? 1 : 0);
        dL_dcenter_.resize(learns ? 1 : 0);
        backend_->fill(Span<CameraGradient<T>>(dL_dcamera_), CameraGradient<T>{});
        backend_->fill(Span<vec3<T>>(dL_dcenter_), vec3<T>(T(0)));
        return {dL_dcamera_, dL_dcenter_};
    }
    void camera_backward(const Photo& photo) {
        if (dL_dcenter_.size())
            camera_refinement()->accumulate_camera(photo.camera_index, Span<const CameraGradient<T>>(dL_dcamera_),
                                                   Span<const vec3<T>>(dL_dcenter_));
    }
    [[nodiscard]] LearnedArrays<T> learned() {
        LearnedArrays<T> arrays;
        for (std::size_t p = 0; p < people_.size(); ++p) append(arrays, people_[p].model->learned(), person_prefix(p));
        return arrays;
    }
    /// What a photograph's step launches beside other steps: whether camera and poses learn, who casts shadows on whom,
    /// and which terms count.
    [[nodiscard]] std::uint64_t kind(const Photo& photo) const {
        std::uint64_t kind = learns_camera(photo);
        for (const Person& a : people_) {
            kind = mix_bits(2 * kind + learns_motion(a, photo.frame));
            for (const Person& b : people_)
                kind = mix_bits(2 * kind + (casts_shadow(b) && cast_shadows_on_each_other(
                                                                   a.motion->transl[photo.frame],
                                                                   b.motion->transl[photo.frame])));
        }
        for (const Term& term : terms_) kind = mix_bits(2 * kind + term.of->counts(photo.frame));
        return kind;
    }
    /// Takes back steps that have changed nothing because the backend had halted.
    void take_back(std::uint64_t steps) {
        for (Person& person : people_)
            if (person.refinement) person.refinement->take_back(steps);
    }
    /// Refinements take their own steps, in which only the rows of visited frames and cameras move.
    void after_step(const RasterCache<B, T>&) {
        for (Person& person : people_)
            if (person.refinement) person.refinement->step();
    }

private:
    struct Person {
        Model* model = nullptr;
        const Motion* motion = nullptr;
        std::size_t first_splat = 0;
        std::vector<RigPose<B, T>> poses; // by frame, prepared; empty until the first is asked for
        RigPose<B, T> pose;               // of a refinement, or of a motion that is too long to be kept
        MotionRefinement<B, T>* refinement = nullptr;
    };
    struct Term {
        LossTerm<B, T>* of;
        std::size_t person;
    };
    [[nodiscard]] static bool casts_shadow(const Person& of) {
        const auto& light = of.model->light();
        return light && light->shadows();
    }
    [[nodiscard]] static bool learns_motion(const Person& of, std::size_t frame) {
        return of.refinement && of.refinement->learns_motion(frame);
    }
    /// add(pose, dL_dpose) adds to the gradient of a person's pose, which the refinement gets then. The gradient has no
    /// parts where the motion does not learn.
    template <class Add>
    static void with_pose_gradient(Person& of, std::size_t frame, const Add& add) {
        const RigPoseGradient<T> dL_dpose =
            learns_motion(of, frame) ? of.refinement->pose_gradient() : RigPoseGradient<T>();
        add(present_pose(of, frame), dL_dpose);
        if (!dL_dpose.empty()) of.refinement->accumulate(frame, dL_dpose);
    }
    [[nodiscard]] bool learns_camera(const Photo& photo) const {
        const auto* cameras = camera_refinement();
        return cameras && cameras->learns_camera(photo.camera_index);
    }
    [[nodiscard]] static bool keeps_poses(const Person& of) {
        return gsh::keeps_poses(of.motion->frame_count(), of.model->rig().prepared_bytes());
    }
    /// Prepares the pose of a frame unless that was done before. On a device all frames are prepared at once, because
    /// recorded steps, which follow, must not allocate.
    static void prepare_pose(Person& of, std::size_t frame) {
        const Rig<B, T>& rig = of.model->rig();
        const std::size_t frames = of.motion->frame_count();
        check_frame("AvatarScene::pose", frame, frames);
        of.poses.resize(frames);
        if (!of.poses[frame].prepared.empty()) return;
        const std::size_t first = B::host_memory ? frame : 0, end = B::host_memory ? frame + 1 : frames;
        for (std::size_t f = first; f < end; ++f) {
            rig.upload_pose(*of.motion, f, of.poses[f]);
            rig.prepare(of.poses[f]);
        }
    }
    /// The pose that the last call of pose() for this frame returned.
    [[nodiscard]] static const RigPose<B, T>& present_pose(const Person& of, std::size_t frame) {
        return of.refinement || !keeps_poses(of) ? of.pose : of.poses[frame];
    }
    void check_person(std::size_t person) const {
        if (person >= people_.size())
            throw ValueError("AvatarScene: person " + std::to_string(person) + " does not exist; the scene has " +
                             std::to_string(people_.size()) + " people");
    }
    [[nodiscard]] Person& at(std::size_t person) { return check_person(person), people_[person]; }
    [[nodiscard]] const Person& at(std::size_t person) const { return check_person(person), people_[person]; }
    /// The refinement that has the cameras, or null.
    [[nodiscard]] MotionRefinement<B, T>* camera_refinement() const {
        for (const Person& person : people_)
            if (person.refinement && person.refinement->camera_count()) return person.refinement;
        return nullptr;
    }

    B* backend_;
    std::vector<Person> people_;
    std::vector<Term> terms_;
    std::size_t size_ = 0; // number of all people's splats
    typename B::template Buffer<CameraGradient<T>> dL_dcamera_; // [1] or empty
    typename B::template Buffer<vec3<T>> dL_dcenter_;           // likewise
};

} // namespace gsh
