// SPDX-License-Identifier: Apache-2.0
/// @file  Static scenes, refinement and pose fits on the CUDA backend as on cpu::Serial, and steps that fail.
#include <gsh/core/rng.hpp>
#include <gsh/cuda.cuh>

#include "support/cuda_device.hpp"
#include "support/cuda_outcomes.hpp"
#include "support/serial_runs.hpp"
#include "support/small_runs.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace cuda_scenes { // joined builds: other tests have helpers of the same names

using namespace gsh;
using namespace test;
using cuda::Device;

TEST_CASE("a static scene trains on the device as on the CPU, through changes of its number of Gaussians") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const Outcome found = train_static<Device>(scene, 50);
    check_near(found, train_static<cpu::Serial>(scene, 50));
    check_same(found, train_static<Device>(scene, 50));
}

TEST_CASE("two people train on the device as on the CPU, with the same bits each time") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const Outcome found = train_people<Device>(scene, long_training);
    check_near(found, train_people<cpu::Serial>(scene, long_training));
    check_same(found, train_people<Device>(scene, long_training));
}

TEST_CASE("an overflow changes no bit of a static scene or of two people") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const auto compare = [](const Outcome& found, const Outcome& expected) {
        CHECK(found.failures > expected.failures); // where Gaussians are added, buffers of any size overflow
        check_same(found, expected);
    };
    compare(train_static<Device>(scene, 50, FirstView::far),
            train_static<Device>(scene, 50, FirstView::far_then_nearest));
    compare(train_people<Device>(scene, long_training, FirstView::far),
            train_people<Device>(scene, long_training, FirstView::far_then_nearest));
}

TEST_CASE("the paper's avatar with refined poses, shape and cameras trains as on the CPU") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const Outcome found = train_paper<Device>(scene, long_training);
    check_near(found, train_paper<cpu::Serial>(scene, long_training));
    check_same(found, train_paper<Device>(scene, long_training));
}

TEST_CASE("poses, shape and cameras are refined on the device as on the CPU") {
    if (skip_without_device()) return;
    const SmallScene scene;
    check_near(train_refined<Device>(scene), train_refined<cpu::Serial>(scene));
}

#if defined(GSH_CUDA_EMULATION)
TEST_CASE("a step is one graph that waits for nothing, also in a light, with refined poses and cameras") {
    const SmallScene scene;
    SmallTraining<Device> training(
        scene, [] { return Device(); }, 3, {.ao = AmbientOcclusion::pose},
        with_photo_memory(scene.photos[0].rgba.size()), {}, // the other photographs are brought
        even_light(2, 3, {0, 0.8, 0}, 3));
    MotionRefinement<Device> refinement(training.backend, training.rig, scene.motion, scene.cameras, everything());
    training.people.refine(refinement);
    const std::size_t epoch = scene.photos.size();
    training.steps(static_cast<int>(3 * epoch), 0.5); // buffers have their sizes, and each photograph has its graph
    training.trainer.settle();
    auto& machine = CudaEmulation::instance();
    const auto waits = machine.waits, allocations = machine.allocations, graphs = machine.graph_launches;
    const auto captures = machine.captures; // one camera does not learn: its steps are another kind
    training.steps(static_cast<int>(2 * epoch), 0.5);
    CHECK(machine.waits == waits);
    CHECK(machine.allocations == allocations);
    CHECK(machine.graph_launches == graphs + 2 * epoch);
    CHECK(machine.captures == captures);
}
#endif

TEST_CASE("a trainer that has released its memory on the device goes on with the same bits") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const auto train = [&](bool releases) {
        SmallTraining<Device> training(scene, [] { return Device(); }, 3, {.ao = AmbientOcclusion::time});
        auto& trainer = training.trainer;
        trainer.train_to(3 * scene.photos.size());
        if (releases) trainer.release_memory();
        trainer.train_to(5 * scene.photos.size());
        return training.parameters();
    };
    CHECK(train(true) == train(false));
}

TEST_CASE("a pose is fitted on the device as on the CPU") {
    if (skip_without_device()) return;
    const PosedScene scene;
    check_near(fit_pose<Device>(scene), fit_pose<cpu::Serial>(scene));
}

/// The camera of the first step is far away: there, the splats cover few tiles.
struct FirstSeenFromAfar {
    static constexpr std::uint64_t seed = 3;
    SmallScene scene;
    std::size_t first_camera;

    FirstSeenFromAfar() : first_camera(scene.photos[shuffled_indices(4, random_bits(seed, 0))[0]].camera_index) {
        for (Photo& photo : scene.photos)
            if (photo.camera_index == first_camera) photo.camera.t.z += 12;
    }
    /// The first step with another camera.
    template <class TrainerType>
    [[nodiscard]] std::size_t near_step(TrainerType& trainer) const {
        std::size_t step = 0;
        while (scene.photos[trainer.photo_of_step(step)].camera_index == first_camera) ++step;
        return step;
    }
};

TEST_CASE("a training to a number of steps takes all of them, whatever overflows and whoever looks at it before") {
    if (skip_without_device()) return;
    const FirstSeenFromAfar far;
    const SmallScene& scene = far.scene;
    const auto train = [&](bool looks) {
        SmallTraining<Device> training(scene, [] { return Device(); }, far.seed, {.ao = AmbientOcclusion::time});
        auto& trainer = training.trainer;
        const std::size_t near = far.near_step(trainer);
        Image<float> picture;
        while (looks && trainer.step_count() < 12) trainer.step(static_cast<double>(trainer.step_count()) / 30);
        if (looks) {
            trainer.render(scene.photos[trainer.photo_of_step(0)], picture); // settles
            CHECK(trainer.step_count() == near);
        }
        trainer.train_to(30);
        CHECK(trainer.step_count() == 30);
        return training.parameters();
    };
    CHECK(train(true) == train(false));
}

TEST_CASE("a trainer settles often enough to be able to take its steps back") {
    if (skip_without_device()) return;
    const FirstSeenFromAfar far;
    const SmallScene& scene = far.scene;
    SmallTraining<Device> training(scene, [] { return Device(); }, far.seed, {.ao = AmbientOcclusion::none});
    for (std::size_t i = 0; i <= most_unsettled_steps; ++i) training.trainer.step(0.5);
    CHECK(training.trainer.step_count() < most_unsettled_steps); // it went back to the step that failed
}

TEST_CASE("steps after an overflow change nothing, and are taken again with the bits of large buffers") {
    if (skip_without_device()) return;
    const FirstSeenFromAfar far;
    const SmallScene& scene = far.scene;
    const auto train = [&](bool large_from_the_start) {
        SmallTraining<Device> training(scene, [] { return Device(); }, far.seed, {.ao = AmbientOcclusion::time});
        MotionRefinement<Device> refinement(training.backend, training.rig, scene.motion, {}, test_time_params());
        training.people.refine(refinement);
        auto& trainer = training.trainer;
        const std::size_t near = far.near_step(trainer);
        Outcome outcome;
        if (large_from_the_start)
            trainer.render(scene.photos[trainer.photo_of_step(near)], outcome.pictures.emplace_back());
        outcome.pictures.clear();
        while (trainer.step_count() < 12) trainer.step(0.5);
        RepeatedStep<Device> others(training.backend); // does not make failed steps good
        if (!large_from_the_start)
            CHECK_THROWS_WITH_AS(others.run(0, [] {}), doctest::Contains("failed; settle it first"), ValueError);
        trainer.settle();
        CHECK(trainer.step_count() == (large_from_the_start ? 12 : near));
        others.run(0, [] {});
        CHECK(others.settle() == 0);
        while (trainer.step_count() < long_training) trainer.step(0.5);
        trainer.settle();
        CHECK(trainer.step_count() == long_training);
        CHECK(refinement.step_count() == long_training);
        observe(trainer, scene.photos[1], outcome);
        outcome.learned = training.parameters();
        const auto state = refinement.state();
        outcome.learned.insert(outcome.learned.end(), state.increments.begin(), state.increments.end());
        for (const std::uint64_t count : state.updates) outcome.losses.push_back(static_cast<double>(count));
        return outcome;
    };
    check_same(train(false), train(true));
}

struct Enlarge {
    Span<sym3<float>> covariances;
    float factor;
    GSH_HD void operator()(std::size_t i) const {
        sym3<float>& s = covariances[i];
        s = {s.xx * factor, s.xy * factor, s.xz * factor, s.yy * factor, s.yz * factor, s.zz * factor};
    }
};

/// A scene whose splats are larger in step `at`: then they cover more tiles than in all steps before.
class GrowingScene : public SmallTraining<Device>::SceneType {
    using Base = SmallTraining<Device>::SceneType;

public:
    GrowingScene(Device& device, SmallAvatar<Device>& model, const Motion& motion, std::uint64_t at)
        : Base(device, model, motion), device_(&device), at_(at) {}

    /// Multiplies the covariances in all other steps by a factor.
    void grow(float factor) { elsewhere_ = factor; }
    void set_progress(std::uint64_t step, double progress) {
        Base::set_progress(step, progress);
        step_ = step;
    }
    void forward(std::size_t frame, const Deferred<vec3<float>>& center, const SplatView<float>& splats) {
        Base::forward(frame, center, splats);
        device_->for_each(splats.covariances.size(), Enlarge{splats.covariances, step_ == at_ ? 30.0f : elsewhere_});
    }

private:
    Device* device_;
    std::uint64_t at_, step_ = 0;
    float elsewhere_ = 1;
};

/// A training of a growing scene that refines everything.
struct GrowingTraining {
    const SmallScene& scene;
    SmallTraining<Device> parts;
    MotionRefinement<Device> refinement;
    GrowingScene people;
    Trainer<Device, GrowingScene> trainer;
    std::vector<std::uint64_t> failed; // steps, in the order in which they were found

    GrowingTraining(const SmallScene& of, std::uint64_t at)
        : scene(of), parts(of, [] { return Device(); }, 3, {.ao = AmbientOcclusion::time}),
          refinement(parts.backend, parts.rig, of.motion, of.cameras, everything()),
          people(parts.backend, parts.model, of.motion, at),
          trainer(parts.backend, people, of.photos, 3, small_training) {
        people.refine(refinement);
    }
    /// Takes steps until there are `stop`, and settles after every `interval` of them.
    void train(std::uint64_t stop, std::uint64_t interval) {
        while (trainer.step_count() < stop) {
            const std::uint64_t next = std::min(stop, trainer.step_count() + interval);
            while (trainer.step_count() < next) trainer.step(0.5);
            trainer.settle();
            if (trainer.step_count() < next) failed.push_back(trainer.step_count());
        }
    }
    [[nodiscard]] Outcome outcome() {
        Outcome outcome;
        observe(trainer, scene.photos[1], outcome);
        outcome.learned = learned_values(parts.backend, parts.model);
        const auto state = refinement.state();
        outcome.learned.insert(outcome.learned.end(), state.increments.begin(), state.increments.end());
        for (const std::uint64_t count : state.updates) outcome.losses.push_back(static_cast<double>(count));
        return outcome;
    }
};

TEST_CASE("an overflow in the middle of a run with everything refined changes no bit") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const std::uint64_t at = long_training / 2, steps = long_training;
    const auto train = [&](bool large_from_the_start) {
        GrowingTraining training(scene, at);
        if (large_from_the_start) {
            training.people.grow(200); // far more than later, when the Gaussians have learned
            enlarge_buffers(FirstView::far_then_nearest, training.trainer, scene.photos);
            training.people.grow(1);
        }
        training.train(at - 5, at - 5);
        training.train(steps, steps);
        CHECK(std::count(training.failed.begin(), training.failed.end(), at) == (large_from_the_start ? 0 : 1));
        if (large_from_the_start) CHECK(training.failed.empty());
        CHECK(training.refinement.step_count() == steps);
        return training.outcome();
    };
    check_same(train(false), train(true));
}

TEST_CASE("settling after every step or rarely gives the same bits, also where a step overflows") {
    if (skip_without_device()) return;
    const SmallScene scene;
    const std::uint64_t at = 10, steps = 16;
    const auto train = [&](std::uint64_t interval) {
        GrowingTraining training(scene, at);
        training.train(steps, interval);
        CHECK(std::count(training.failed.begin(), training.failed.end(), at) == 1);
        return training.outcome();
    };
    check_same(train(1), train(steps));
}

/// Steps that refine everything, on a device that make() returns. A photograph at a time is in the device's memory.
template <class Make>
Outcome refine_on(const Make& make, const SmallScene& scene) {
    SmallTraining<Device> training(scene, make, 3, {.ao = AmbientOcclusion::time},
                                   with_photo_memory(scene.photos[0].rgba.size()));
    return refine(scene, training.backend, training.rig, training.model, training.people, training.trainer, 12);
}

TEST_CASE("training on the caller's stream gives the bits of the device's own") {
    if (skip_without_device()) return;
    const SmallScene scene;
    cudaStream_t mine = nullptr;
    REQUIRE(cudaStreamCreateWithFlags(&mine, cudaStreamNonBlocking) == cudaSuccess);
    const Outcome expected = refine_on([] { return Device(); }, scene);
    for (cudaStream_t stream : {mine, cudaStream_t(nullptr)}) // nullptr: the legacy default stream
        check_same(refine_on([&] { return Device(stream); }, scene), expected);
    CHECK(cudaStreamDestroy(mine) == cudaSuccess);
}

TEST_CASE("a Gaussian that is not finite in a recorded step is named when the trainer settles") {
    if (skip_without_device()) return;
    const SmallScene scene;
    SmallTraining<Device> training(scene, [] { return Device(); }, 3, {.ao = AmbientOcclusion::none});
    training.trainer.step(0.5);
    training.trainer.step(0.5);
    training.trainer.settle();
    spoil(training.backend, training.model, "log_scales", 21);
    training.trainer.step(0.5);
    CHECK_THROWS_WITH_AS(training.trainer.settle(), doctest::Contains("Gaussian 7 has a mean, covariance"), ValueError);
}

TEST_CASE("a Gaussian of several people that is not finite is named with its person") {
    if (skip_without_device()) return;
    const SmallScene scene;
    Cast<Device> cast(scene, {scene.motion, scene.motion}, scene.photos, [] { return Device(); },
                      {.ao = AmbientOcclusion::none});
    cast.trainer.train_to(2);
    spoil(cast.backend, cast.models[1], "log_scales", 21);
    cast.trainer.step(0.5);
    CHECK_THROWS_WITH_AS(cast.trainer.settle(), doctest::Contains("It is Gaussian 7 of person 1"), GaussianError);
}

} // namespace cuda_scenes
