// SPDX-License-Identifier: Apache-2.0
/// Several people in one training. Each avatar learns its own part of the picture.
#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/trainer.hpp>

#include "io/temporary.hpp"
#include "support/contains.hpp"
#include "support/gradient.hpp"
#include "support/learned.hpp"
#include "support/small_cast.hpp"
#include "support/small_training.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;
using test::Cast;
using test::moved;
using test::SmallScene;
using test::SmallTraining;

namespace {

const vec3<double> beside{0.35, 0, -0.2}, in_front{0.12, 0.02, 0.5}, behind_the_cameras{0, 0, 40};

const ConfiguredAvatarParams stored{.hash_displacement = false,
                                    .hash_sh = false,
                                    .appearance = {.sh_rate = test::small_sh_rate},
                                    .model = {.quat_rate = 0}};

/// Solid people in colours of their own: red or blue, with a random pattern in green.
template <class B, class T>
void paint(Cast<B, T>& cast) {
    test::Rng rng(17);
    for (std::size_t p = 0; p < cast.models.size(); ++p) {
        for (T& opacity : test::learned_array(cast.models[p], "opacity_logits").values) opacity = T(4);
        const Span<T> sh = test::learned_array(cast.models[p], "sh").values;
        for (std::size_t i = 0; i < sh.size(); i += 12) {
            sh[i] = T(p == 0 ? 1.5 : -1.5);
            sh[i + 1] = static_cast<T>(rng.uniform(-1, 1));
            sh[i + 2] = T(p == 0 ? -1.5 : 1.5);
        }
    }
}

/// Photographs by gsh's renderer of two painted people, one in front of the other.
struct TwoPeople {
    SmallScene scene;
    std::vector<Motion> motions{moved(scene.motion, {-0.1, 0, -0.2}), moved(scene.motion, in_front)};
    std::vector<std::vector<std::uint8_t>> pixels;
    std::vector<Photo> photos;

    TwoPeople() {
        Cast<cpu::Serial> truth(scene, motions, scene.photos, {}, stored);
        paint(truth);
        for (const Photo& photo : scene.photos) {
            Image<float> alpha;
            const Image<float> color = truth.picture(photo.camera, photo.frame, &alpha);
            pixels.emplace_back();
            const std::size_t count = alpha.data.size();
            for (std::size_t i = 0; i < count; ++i) {
                const float a = alpha.data[i];
                for (std::size_t c = 0; c < 3; ++c) // over white
                    pixels.back().push_back(byte(a > 0 ? (color.data[c * count + i] - (1 - a)) / a : 0));
                pixels.back().push_back(byte(a));
            }
        }
        photos = scene.photos;
        for (std::size_t i = 0; i < photos.size(); ++i) photos[i].rgba = pixels[i];
    }
    static std::uint8_t byte(float x) {
        return static_cast<std::uint8_t>(std::lround(255 * std::clamp(x, 0.0f, 1.0f)));
    }
};

} // namespace

TEST_CASE("somebody whom no camera sees changes nothing for the others, bit for bit") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> alone(scene);
    Cast<cpu::Serial> cast(scene, {moved(scene.motion, behind_the_cameras), scene.motion}, scene.photos);
    const auto unseen = cast.parameters(0);
    alone.steps(12), cast.steps(12);
    CHECK(cast.parameters(1) == alone.parameters());
    CHECK(cast.parameters(0) == unseen);
    CHECK(cast.trainer.last_loss().loss == alone.trainer.last_loss().loss);
    CHECK(cast.people.size() == 2 * alone.model.size());
}

TEST_CASE("an error about a Gaussian of several people names the person, in steps and in pictures") {
    const SmallScene scene;
    Cast<cpu::Serial> cast(scene, {scene.motion, scene.motion}, scene.photos);
    cast.steps(1);
    const std::size_t first = cast.models[0].size();
    test::spoil(cast.backend, cast.models[1], "log_scales", 15);
    const auto told = doctest::Contains("It is Gaussian 5 of person 1");
    CHECK_THROWS_WITH_AS(cast.steps(1), told, GaussianError);
    Image<float> picture;
    CHECK_THROWS_WITH_AS(cast.trainer.render(scene.photos[0], picture), told, GaussianError);
    CHECK(cast.people.name_of(first - 1) == "Gaussian " + std::to_string(first - 1) + " of person 0");
    CHECK(cast.people.name_of(first) == "Gaussian 0 of person 1");
    SmallTraining<cpu::Serial> alone(scene);
    test::spoil(alone.backend, alone.model, "log_scales", 15);
    try {
        alone.steps(1);
        FAIL("a NaN was accepted");
    } catch (const GaussianError& error) {
        CHECK(error.gaussian() == 5);
        CHECK(std::string(error.what()) != test::contains("person"));
        CHECK(std::string(error.what()).ends_with("; is a learning rate too high?")); // where something learns
    }
}

TEST_CASE("two people learn the same on any number of threads") {
    const TwoPeople scene;
    const ConfiguredAvatarParams shaded{.appearance = {.sh_rate = test::small_sh_rate},
                                        .ao = AmbientOcclusion::time,
                                        .model = {.occlusion_start = 0, .quat_rate = 0}};
    Cast<cpu::Serial> serial(scene.scene, scene.motions, scene.photos, {}, shaded);
    serial.steps(10);
    CHECK(serial.parameters(0) != serial.parameters(1));
    CHECK(mean_ao(serial.people, photographed_frames(scene.photos), 1).size() == serial.models[1].size());
    for (const std::size_t threads : {1, 2, 5}) {
        CAPTURE(threads);
        Cast<cpu::Threads> threaded(scene.scene, scene.motions, scene.photos, cpu::Threads(threads), shaded);
        threaded.steps(10);
        for (const std::size_t p : {0, 1}) CHECK(threaded.parameters(p) == serial.parameters(p));
    }
}

TEST_CASE("whoever stands in front hides the other, whatever their order") {
    const SmallScene scene;
    const Motion back = moved(scene.motion, {0, 0, -0.5}), front = moved(scene.motion, {0, 0, 0.5});
    Cast<cpu::Serial> one(scene, {back, front}, scene.photos, {}, stored),
        other(scene, {front, back}, scene.photos, {}, stored);
    paint(one), paint(other); // red behind blue, red before blue
    const Camera<double> camera = look_at<double>({0, 0.8, 3.5}, {0, 0.8, 0}, {0, 1, 0}, 0.5, 48, 48);
    const Image<float> a = one.picture(camera, 0), b = other.picture(camera, 0);
    Cast<cpu::Serial> nearer(scene, {front}, scene.photos, {}, stored);
    paint(nearer);
    Image<float> alpha;
    (void)nearer.picture(camera, 0, &alpha);
    const std::size_t count = 48 * 48;
    std::size_t covered = 0;
    for (std::size_t i = 0; i < count; ++i) {
        if (alpha.data[i] < 0.8f) continue;
        ++covered;
        CHECK(a.data[2 * count + i] > a.data[i] + 0.3f); // blue in front
        CHECK(b.data[i] > b.data[2 * count + i] + 0.3f); // red in front
    }
    CHECK(covered > 20);
    // The order of the people does not change the picture.
    Cast<cpu::Serial> swapped(scene, {front, back}, scene.photos, {}, stored);
    paint(swapped);
    for (const auto* name : {"sh", "opacity_logits"}) {
        const auto first = test::learned_array(swapped.models[0], name).values,
                   second = test::learned_array(swapped.models[1], name).values;
        std::swap_ranges(first.begin(), first.end(), second.begin());
    }
    const Image<float> c = swapped.picture(camera, 0);
    double difference = 0;
    for (std::size_t i = 0; i < c.data.size(); ++i)
        difference = std::max(difference, std::abs(double(c.data[i]) - double(a.data[i])));
    CHECK(difference < 1e-5);
}

TEST_CASE("two people, one before the other, are both learned") {
    const TwoPeople scene;
    Cast<cpu::Serial> cast(scene.scene, scene.motions, scene.photos);
    const auto psnr_of = [&] { return compare(cast.trainer, scene.photos[1]).score.psnr_person; };
    const double before = psnr_of();
    cast.steps(150);
    CAPTURE(before);
    CHECK(psnr_of() > before + 6);
    // The first is red and the second blue, so neither learned the other's colours.
    const std::size_t count = 48 * 48;
    for (const std::size_t p : {0, 1}) {
        Cast<cpu::Serial> apart(scene.scene, {scene.motions[p]}, scene.photos);
        const auto from = cast.models[p].learned(), to = apart.models[0].learned();
        for (std::size_t i = 0; i < from.size(); ++i)
            std::copy(from[i].values.begin(), from[i].values.end(), to[i].values.begin());
        Image<float> alpha;
        const Image<float> color = apart.picture(scene.photos[1].camera, scene.photos[1].frame, &alpha);
        double red = 0, blue = 0;
        for (std::size_t i = 0; i < count; ++i)
            if (alpha.data[i] > 0.9f) red += color.data[i], blue += color.data[2 * count + i];
        CHECK((p == 0 ? red - blue : blue - red) > 0.2 * (red + blue));
    }
}

TEST_CASE("people in one light cast shadows on each other, within reach") {
    const SmallScene scene;
    const auto brightness = [&](const vec3<double>& lamp, const vec3<double>& second, bool shadows,
                                std::size_t person) {
        LightData light{.points = {lamp}, .directions = {}, .log_intensities = {2.5}, .gloss = {-9, 2}};
        light.shadows = shadows;
        Cast<cpu::Serial> cast(scene, {scene.motion, moved(scene.motion, second)}, scene.photos, {}, stored,
                               test::small_training, 12, light);
        Splats<cpu::Serial> splats;
        splats.resize(cast.people.size());
        cast.people.prepare(0);
        cast.people.forward(0, vec3<float>(0, 1, 4), splats.view());
        double sum = 0;
        for (const auto& shading : cast.models[person].shading()) sum += static_cast<double>(shading.x);
        return sum;
    };
    const vec3<double> front{0, 0.8, 4}, back{0, 0.8, -4}, first_away = behind_the_cameras;
    // The second person stands in front of the first.
    CHECK(brightness(front, in_front, true, 0) < 0.7 * brightness(front, first_away, true, 0));
    CHECK(brightness(front, in_front, true, 1) == doctest::Approx(brightness(front, in_front, false, 1)).epsilon(0.3));
    // From behind, it is the first who hides the lamp from the second.
    CHECK(brightness(back, in_front, true, 1) < 0.7 * brightness(back, in_front, false, 1));
    CHECK(brightness(back, in_front, true, 0) == doctest::Approx(brightness(back, first_away, true, 0)).epsilon(0.05));
    // Whoever is out of reach changes nothing, to the last bit.
    CHECK(brightness(front, first_away, true, 0) == brightness(front, {0, 90, 0}, true, 0));
    CHECK(brightness(front, in_front, false, 0) == brightness(front, first_away, false, 0));
}

TEST_CASE("two people learn one light, whose arrays are listed once, and each keeps it when only a pose is fitted") {
    const TwoPeople scene;
    const LightData start = even_light(2, 3, {0, 0.8, 0}, 3);
    Cast<cpu::Serial> cast(scene.scene, scene.motions, scene.photos, {}, stored, test::small_training, 12, start);
    const auto light = cast.models[0].light();
    CHECK(light == cast.models[1].light());
    CHECK(test::learns(cast.models[0], "light_points"));
    CHECK_FALSE(test::learns(cast.models[1], "light_points"));
    cast.steps(5);
    const LightData learned = light->data();
    CHECK(learned.log_intensities[0] == doctest::Approx(start.log_intensities[0]));
    for (std::size_t k = 1; k < start.size(); ++k)
        CHECK(std::abs(learned.log_intensities[k] - start.log_intensities[k]) > 1e-4);
    for (std::size_t k = 0; k < 2; ++k) CHECK(length(learned.points[k] - start.points[k]) > 1e-4);

    std::deque<MotionRefinement<cpu::Serial>> refinements;
    for (const std::size_t p : {0, 1}) {
        refinements.emplace_back(cast.backend, cast.rigs[p], scene.motions[p], std::vector<Camera<double>>(),
                                 test_time_params());
        cast.people.refine(refinements[p], p);
    }
    const auto parameters = cast.parameters(0);
    PoseFit<cpu::Serial> fit(cast.backend, cast.trainer.config().filter, {.steps = 4});
    FrozenPerson<Cast<cpu::Serial>::SceneType> frozen(cast.people, 1);
    const Photo& photo = scene.photos[0];
    fit.fit(frozen, photo.frame, {photo});
    CHECK(cast.parameters(0) == parameters); // with the light
    const Motion fitted = refinements[1].motion();
    CHECK(fitted.pose != scene.motions[1].pose);
    for (const auto& angle : fitted.pose) CHECK(std::isfinite(angle.x));
}

TEST_CASE("the gradient of one picture reaches both people, and is right") {
    const SmallScene scene;
    test::Rng rng(5);
    std::vector<std::uint8_t> noise(scene.photos[0].rgba.size(),
                                    255); // few pixels are near the kink of L1, and small steps do not cross it
    for (std::size_t i = 0; i < noise.size(); ++i)
        if (i % 4 != 3) noise[i] = static_cast<std::uint8_t>(rng.uniform(0, 255));
    Photo photo = scene.photos[0];
    photo.rgba = noise;
    // With rates of 0 nothing moves. A step then gives the loss and, as first moment, a tenth of the gradient.
    constexpr double still = 1e-200;
    const ConfiguredAvatarParams config{.appearance = {.sh_dc_scale = 20, .sh_rate = still, .displacement_rate = still},
                                        .model = {.initial_thickness = 1,
                                                  .joint_rate = still,
                                                  .quat_rate = still,
                                                  .log_scale_rate = still,
                                                  .opacity_logit_rate = still}};
    Cast<cpu::Serial, double> cast(scene, {scene.motion, moved(scene.motion, in_front)}, {photo}, {}, config,
                                   {.random_background = false}, 2); // all steps have the same background
    for (auto& model : cast.models) {
        for (double& opacity : test::learned_array(model, "opacity_logits").values) opacity = rng.uniform(-1, 1.5);
        for (double& scale : test::learned_array(model, "log_scales").values)
            scale += rng.uniform(-0.3, 0.3); // round Gaussians would have no gradient of the rotation
        for (double& weight : test::learned_array(model, "shared_field.network").values)
            weight = rng.uniform(-0.2, 0.2);
        for (double& entry : test::learned_array(model, "shared_field.table").values) entry = rng.uniform(-0.1, 0.1);
    }
    const auto loss = [&] {
        cast.trainer.step();
        return cast.trainer.last_loss().loss;
    };
    loss();
    std::vector<std::vector<double>> gradients; // of the scene's arrays, copied before any further step
    for (const LearnedArray<double>& array : cast.people.learned()) {
        auto& gradient = gradients.emplace_back(array.first_moment.begin(), array.first_moment.end());
        for (double& value : gradient) value *= 10;
    }
    const LearnedArrays<double> arrays = cast.people.learned();
    CHECK(arrays.size() == 12);
    CHECK(arrays[0].name == "joints");
    CHECK(arrays[6].name == "person1/joints");
    for (std::size_t a = 0; a < arrays.size(); ++a) {
        CAPTURE(arrays[a].name);
        const Span<double> values = arrays[a].values;
        double largest = 0;
        for (const double value : gradients[a]) largest = std::max(largest, std::abs(value));
        CHECK(largest > 1e-6);
        test::check_gradient(loss, values, Span<const double>(gradients[a]),
                             {.step = 1e-7,
                              .tolerance = 2e-6,
                              .elements = test::spread_elements(
                                  values.size(), arrays[a].is_table() ? &arrays[a].touched_rows : nullptr,
                                  arrays[a].row_size, 12)});
    }
}

TEST_CASE("two people go on from a checkpoint bit for bit, refinement and all") {
    const TwoPeople scene;
    const ConfiguredAvatarParams shaded{.appearance = {.sh_rate = test::small_sh_rate},
                                        .ao = AmbientOcclusion::time,
                                        .model = {.occlusion_start = 0.3, .quat_rate = 0}};
    RefinementParams moving;
    for (RefinedGroup* group : {&moving.pose, &moving.transl, &moving.expression}) group->start = 2 / 16.0;
    struct Everything {
        Cast<cpu::Serial> cast;
        std::deque<MotionRefinement<cpu::Serial>> refinements;

        Everything(const TwoPeople& of, const ConfiguredAvatarParams& avatar, RefinementParams refine)
            : cast(of.scene, of.motions, of.photos, {}, avatar) {
            for (const std::size_t p : {0, 1}) {
                refinements.emplace_back(cast.backend, cast.rigs[p], of.motions[p],
                                         p == 1 ? of.scene.cameras : std::vector<Camera<double>>(), refine);
                cast.people.refine(refinements[p], p);
            }
        }
        void run(int first, int last) {
            for (int i = first; i < last; ++i) cast.trainer.step(i / 16.0);
        }
    };
    Everything whole(scene, shaded, moving), first(scene, shaded, moving), second(scene, shaded, moving);
    whole.run(0, 16), first.run(0, 9);
    const test::Temporary folder;
    const auto path = folder / "checkpoint.gsh";
    {
        ArchiveWriter writer(path, "checkpoint", checkpoint_version);
        add_trainer(writer, first.cast.trainer);
        for (const std::size_t p : {0, 1}) add_refinement(writer, first.refinements[p], p);
        writer.commit();
    }
    const ArchiveReader reader(path, "checkpoint", checkpoint_version);
    load_trainer(reader, second.cast.trainer);
    for (const std::size_t p : {0, 1}) load_refinement(reader, second.refinements[p], p);
    second.run(9, 16);
    for (const std::size_t p : {0, 1}) {
        CHECK(second.cast.parameters(p) == whole.cast.parameters(p));
        CHECK(second.refinements[p].state().increments == whole.refinements[p].state().increments);
        CHECK(whole.refinements[p].motion().pose != scene.motions[p].pose);
    }
    CHECK(whole.refinements[1].cameras()[1].t != scene.scene.cameras[1].t); // cameras learn from both people
    // A checkpoint of two people does not fit a scene of one.
    SmallTraining<cpu::Serial> alone(scene.scene);
    CHECK_THROWS_AS(load_trainer(reader, alone.trainer), ValueError);
    const auto single = folder / "single.gsh";
    {
        ArchiveWriter writer(single, "checkpoint", checkpoint_version);
        add_trainer(writer, alone.trainer);
        writer.commit();
    }
    CHECK_THROWS_AS(load_trainer(ArchiveReader(single, "checkpoint", checkpoint_version), second.cast.trainer),
                    ValueError);
}

TEST_CASE("a person's pose is found while somebody else stands in the way") {
    const TwoPeople scene;
    Cast<cpu::Serial> cast(scene.scene, scene.motions, scene.photos, {}, stored);
    paint(cast); // the appearance starts at the truth
    Motion estimate = scene.motions[0];
    test::Rng rng(3);
    for (auto& v : estimate.pose) v += rng.vec(-0.05, 0.05);
    for (auto& t : estimate.transl) t += rng.vec(-0.02, 0.02);
    MotionRefinement<cpu::Serial> refinement(cast.backend, cast.rigs[0], estimate, {}, test_time_params());
    cast.people.refine(refinement);
    std::vector<Photo> photos;
    for (const Photo& photo : scene.photos)
        if (photo.frame == 0) photos.push_back(photo);
    FrozenPerson<Cast<cpu::Serial>::SceneType, cpu::Serial> frozen(cast.people, 0);
    PoseFit<cpu::Serial> fit(cast.backend, cast.trainer.config().filter, {.steps = 80});
    const double before = fit.mean_loss(frozen, 0, photos);
    const PoseFitReport report = fit.fit(frozen, 0, photos);
    CHECK(report.kept);
    CHECK(report.loss_after < 0.5 * before);
    const auto error = [&](const Motion& motion) { return length(motion.transl[0] - scene.motions[0].transl[0]); };
    CHECK(error(refinement.motion()) < 0.7 * error(estimate));
}

TEST_CASE("poses that do not learn are prepared once, those of a refinement or of a very long motion never") {
    const SmallScene scene;
    Cast<cpu::Serial> cast(scene, {scene.motion}, scene.photos);
    const Rig<cpu::Serial, float>& rig = cast.models[0].rig();
    const auto list = [](const auto& buffer) { return std::vector(buffer.data(), buffer.data() + buffer.size()); };
    const auto* first = &cast.people.pose(1);
    CHECK(!first->prepared.empty());
    CHECK(list(cast.people.pose(0).pose) != list(first->pose));
    CHECK(&cast.people.pose(1) == first);
    RigPose<cpu::Serial> expected;
    rig.upload_pose(scene.motion, 1, expected);
    rig.prepare(expected);
    CHECK(list(first->prepared.vertex_offsets) == list(expected.prepared.vertex_offsets));
    CHECK(list(first->prepared.rotations) == list(expected.prepared.rotations));
    CHECK_THROWS_AS((void)cast.people.pose(scene.motion.frame_count()), ValueError);

    MotionRefinement<cpu::Serial> refinement(cast.backend, cast.rigs[0], scene.motion, {}, test_time_params());
    cast.people.refine(refinement);
    CHECK(cast.people.pose(1).prepared.empty());

    Motion longer = scene.motion;
    for (std::size_t f = most_pose_memory / rig.prepared_bytes(); f > 0; --f) {
        const auto pose = scene.motion.pose_at(0);
        longer.pose.insert(longer.pose.end(), pose.begin(), pose.end());
        const auto expression = scene.motion.expression_at(0);
        longer.expression.insert(longer.expression.end(), expression.begin(), expression.end());
        longer.transl.push_back(scene.motion.transl[0]);
        longer.timestamps.push_back(longer.timestamps.back() + 1);
    }
    Cast<cpu::Serial> marathon(scene, {longer}, scene.photos);
    CHECK(marathon.people.pose(1).prepared.empty());
    CHECK(list(marathon.people.pose(1).pose) == list(expected.pose));
}

TEST_CASE("people that do not fit together are refused") {
    const SmallScene scene;
    using SceneType = Cast<cpu::Serial>::SceneType;
    using Member = CastMember<Cast<cpu::Serial>::Model>;
    Cast<cpu::Serial> cast(scene, {scene.motion, scene.motion}, scene.photos);
    CHECK_THROWS_AS(SceneType(cast.backend, std::vector<Member>()), ValueError);
    auto& models = cast.models;
    CHECK_THROWS_AS(SceneType(cast.backend, {{&models[0], &scene.motion}, {&models[0], &scene.motion}}), ValueError);
    Motion shorter = scene.motion;
    shorter.transl.pop_back();
    CHECK_THROWS_AS(SceneType(cast.backend, {{&models[0], &scene.motion}, {&models[1], &shorter}}), ShapeError);
    CHECK_THROWS_WITH_AS((void)cast.people.model(2), "AvatarScene: person 2 does not exist; the scene has 2 people",
                         ValueError);
    using Frozen = FrozenPerson<SceneType, cpu::Serial>;
    CHECK_THROWS_AS(Frozen(cast.people, 0), ValueError); // its poses are not refined
    CHECK_THROWS_AS(Frozen(cast.people, 2), ValueError);
    RefinementParams config;
    std::deque<MotionRefinement<cpu::Serial>> refinements;
    for (const std::size_t p : {0, 1})
        refinements.emplace_back(cast.backend, cast.rigs[p], scene.motion, scene.cameras, config);
    cast.people.refine(refinements[0], 0);
    CHECK_THROWS_AS(cast.people.refine(refinements[1], 1), ValueError);
}
