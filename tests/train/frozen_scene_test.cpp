// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>

#include "support/posed_scene.hpp"
#include "support/small_training.hpp"

#include <cstddef>
#include <cstring>
#include <deque>
#include <utility>
#include <vector>

using namespace gsh;
using test::PosedScene;
using test::SmallScene;
using test::SmallTraining;

namespace {

using SmallPeople = SmallTraining<cpu::Serial>::SceneType;
using OnePerson = FrozenPerson<SmallPeople, cpu::Serial>;

static_assert(FrozenScene<FrozenAvatar<cpu::Serial>, cpu::Serial, float>);
static_assert(FrozenScene<OnePerson, cpu::Serial, float>);
static_assert(!FrozenScene<SmallPeople, cpu::Serial, float>); // not frozen: its arrays learn

RefinementParams quick_fit() {
    RefinementParams config = test_time_params();
    config.pose.rate = 1e-2, config.transl.rate = 3e-3;
    return config;
}

template <class AnyScene>
std::vector<float> frozen_splats(AnyScene& scene, std::size_t frame) {
    Splats<cpu::Serial> splats;
    splats.resize(scene.size());
    scene.prepare(frame);
    scene.forward(frame, {0, 1, 3.5f}, splats.view());
    std::vector<float> all;
    for (const auto* vectors : {&splats.means, &splats.colors})
        for (const auto& v : *vectors) all.insert(all.end(), {v.x, v.y, v.z});
    all.insert(all.end(), splats.opacities.begin(), splats.opacities.end());
    return all;
}

/// Two people side by side, both refined.
struct TwoFrozen {
    SmallScene scene;
    cpu::Serial backend;
    std::vector<Motion> motions{scene.motion, scene.motion};
    std::deque<SurfaceSamples> samples;
    std::deque<RigData> rigs;
    std::deque<test::SmallAvatar<cpu::Serial>> models;
    std::deque<MotionRefinement<cpu::Serial>> refinements;
    SmallPeople people;

    TwoFrozen() : people(backend, cast()) {
        for (const std::size_t p : {0, 1}) {
            refinements.emplace_back(backend, rigs[p], motions[p], std::vector<Camera<double>>(), quick_fit());
            people.refine(refinements[p], p);
        }
    }

private:
    std::vector<CastMember<test::SmallAvatar<cpu::Serial>>> cast() {
        std::vector<CastMember<test::SmallAvatar<cpu::Serial>>> members;
        for (const std::size_t p : {0, 1}) {
            for (auto& transl : motions[p].transl) transl.x += p == 0 ? -0.3 : 0.3;
            samples.push_back(sample_surface(scene.body, shaped_vertices(scene.body, scene.betas),
                                             std::vector<double>(scene.body.vertex_count(), 4.0), 3 + p));
            rigs.push_back(make_rig(scene.body, scene.betas, samples.back()));
            models.push_back(test::small_avatar(backend, rigs.back(), samples.back(), 2, 3,
                                                {.ao = AmbientOcclusion::pose, .model = {.occlusion_start = 0}}));
            members.push_back({&models.back(), &motions[p]});
        }
        return members;
    }
};

} // namespace

TEST_CASE("a frozen avatar shows the avatar in the motion's pose and has nothing else to learn") {
    const PosedScene scene;
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, scene.avatar);
    MotionRefinement<cpu::Serial> motion(backend, scene.avatar.rig, scene.truth, {}, quick_fit());
    FrozenAvatar<cpu::Serial> frozen(avatar, motion);
    CHECK(frozen.size() == avatar.size());
    CHECK(frozen.frame_count() == PosedScene::frames);
    CHECK(&frozen.motion() == &motion);
    CHECK(frozen.learned().empty());

    RigPose<cpu::Serial> pose;
    Avatar<cpu::Serial>::Cache cache;
    Splats<cpu::Serial> expected, found;
    expected.resize(avatar.size()), found.resize(avatar.size());
    avatar.rig().upload_pose(scene.truth, 3, pose);
    avatar.pose(pose, {0, 1, 3.5f}, expected.view(), cache);
    frozen.forward(3, {0, 1, 3.5f}, found.view());
    for (std::size_t i = 0; i < avatar.size(); ++i) CHECK(length(found.means[i] - expected.means[i]) < 1e-6f);
}

TEST_CASE("a frozen person's splats are the scene's own, everybody's") {
    TwoFrozen two;
    two.people.set_progress(0, 0);
    OnePerson second(two.people, 1);
    CHECK(second.size() == two.people.size());
    CHECK(second.frame_count() == 2);
    CHECK(second.learned().empty());
    CHECK(&second.motion() == &two.refinements[1]);
    CHECK(frozen_splats(second, 0) == frozen_splats(two.people, 0));
    CHECK(frozen_splats(second, 0) != frozen_splats(second, 1));
}

TEST_CASE("a fit of one person in one frame moves that pose and nothing else") {
    TwoFrozen two;
    std::vector<Photo> photos;
    for (const Photo& photo : two.scene.photos)
        if (photo.frame == 1) photos.push_back(photo);
    two.people.set_progress(0, 0.5);
    const auto values = test::learned_values(two.people), gradients = test::learned_gradients(two.people);
    const Motion first = two.refinements[0].motion(), second = two.refinements[1].motion();
    OnePerson frozen(two.people, 1);
    PoseFit<cpu::Serial> fit(two.backend, {.dilation = 0.1, .compensate_opacity = true}, {.steps = 4});
    const PoseFitReport report = fit.fit(frozen, 1, photos);
    CHECK(report.steps == 4);
    CHECK(report.kept);
    CHECK(test::learned_values(two.people) == values);
    CHECK(test::learned_gradients(two.people) == gradients);
    CHECK(two.refinements[0].motion().pose == first.pose);
    CHECK(two.refinements[0].motion().transl == first.transl);
    const Motion moved = two.refinements[1].motion();
    CHECK(moved.transl[0] == second.transl[0]);
    CHECK(moved.transl[1] != second.transl[1]);
    for (std::size_t j = 0; j < 4; ++j) CHECK(moved.pose_at(0)[j] == second.pose_at(0)[j]);
    CHECK(two.models[0].occludes()); // the fit's progress does not change the scene's
}

TEST_CASE("a person whose poses are not refined, or who is not there, is refused") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    CHECK_THROWS_AS(OnePerson(training.people, 0), ValueError);
    CHECK_THROWS_AS(OnePerson(training.people, 1), ValueError);
}
