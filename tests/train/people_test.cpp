// SPDX-License-Identifier: Apache-2.0
/// Several people in one training: each learns their own part of one picture.
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/joint_error.hpp>
#include <gsh/io/model/checkpoint.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/frozen_scene.hpp>
#include <gsh/train/pose_fit.hpp>
#include <gsh/train/refinement.hpp>
#include <gsh/train/trainer.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"
#include "support/small_training.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>
#include <vector>

using namespace gsh;
using test::SmallScene;
using test::SmallTraining;

namespace {

/// The small scene's motion somewhere else.
Motion moved(Motion motion, const vec3<double>& by) {
    for (auto& transl : motion.transl) transl += by;
    return motion;
}
const vec3<double> beside{0.35, 0, -0.2}, in_front{0.12, 0.02, 0.5}, behind_the_cameras{0, 0, 40};

/// Some people of the small scene's form in one training.
template <class B, class T = float>
struct Cast {
    using Model = AvatarModel<B, T, 4, 2, 1>;
    using TrainerType = Trainer<B, T, Model>;

    B backend;
    std::vector<Motion> motions;
    std::deque<SurfaceSamples> samples;
    std::deque<RigData> rigs;
    std::deque<Model> models;
    TrainerType trainer;

    Cast(const SmallScene& scene, std::vector<Motion> poses, std::vector<Photo> photos, B where = B(),
         const AvatarConfig& avatar = {}, const TrainConfig& config = {.rates = {.quats = 0, .sh = 5e-3}},
         double density = 12)
        : backend(std::move(where)), motions(std::move(poses)),
          trainer(backend, people(scene, avatar, density), std::move(photos), 3, config) {}
    Cast(const Cast&) = delete;

    std::vector<T> parameters(std::size_t person) {
        std::vector<T> all;
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const auto& group = models[person].parameters()[static_cast<ParameterGroup>(g)];
            all.insert(all.end(), group.begin(), group.end());
        }
        return all;
    }
    void steps(int count, double progress = 0) {
        for (int i = 0; i < count; ++i) trainer.step(progress);
    }
    Image<T> picture(const Camera<double>& camera, std::size_t frame, Image<T>* alpha = nullptr) {
        Image<T> color;
        trainer.render(camera, frame, color, alpha);
        return color;
    }

private:
    std::vector<CastMember<Model>> people(const SmallScene& scene, const AvatarConfig& avatar, double density) {
        std::vector<CastMember<Model>> cast;
        for (std::size_t p = 0; p < motions.size(); ++p) {
            samples.push_back(sample_surface(scene.body, shaped_vertices(scene.body, scene.betas),
                                             std::vector<double>(scene.body.vertex_count(), density), 3));
            rigs.push_back(make_rig(scene.body, scene.betas, samples.back()));
            models.emplace_back(backend, rigs.back(), samples.back(), 3, test::small(avatar));
            cast.push_back({&models.back(), &motions[p]});
        }
        return cast;
    }
};

constexpr AvatarConfig stored{.hash_displacement = false, .hash_sh = false};

/// Solid people in colours of their own: red or blue, with a random pattern in green.
template <class B, class T>
void paint(Cast<B, T>& cast) {
    test::Rng rng(17);
    for (std::size_t p = 0; p < cast.models.size(); ++p) {
        auto& parameters = cast.models[p].parameters();
        for (T& opacity : parameters[ParameterGroup::opacity_logits]) opacity = T(4);
        auto& sh = parameters[ParameterGroup::sh];
        for (std::size_t i = 0; i < sh.size(); i += 12) {
            sh[i] = T(p == 0 ? 1.5 : -1.5);
            sh[i + 1] = static_cast<T>(rng.uniform(-1, 1));
            sh[i + 2] = T(p == 0 ? -1.5 : 1.5);
        }
    }
}

/// Photographs of two painted people, one in front of the other, taken by their own renderer.
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
    CHECK(cast.trainer.splat_count() == 2 * alone.model.size());
}

TEST_CASE("two people learn the same on any number of threads") {
    const TwoPeople scene;
    const AvatarConfig shaded{.ao = AmbientOcclusion::time};
    const TrainConfig config{.rates = {.quats = 0, .sh = 5e-3}, .ao_start = 0};
    Cast<cpu::Serial> serial(scene.scene, scene.motions, scene.photos, {}, shaded, config);
    serial.steps(10);
    CHECK(serial.parameters(0) != serial.parameters(1));
    CHECK(serial.trainer.mean_occlusion(1).size() == serial.models[1].size());
    for (const std::size_t threads : {1, 2, 5}) {
        CAPTURE(threads);
        Cast<cpu::Threads> threaded(scene.scene, scene.motions, scene.photos, cpu::Threads(threads), shaded, config);
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
    // The same people named in the other order are the same picture.
    Cast<cpu::Serial> swapped(scene, {front, back}, scene.photos, {}, stored);
    paint(swapped);
    for (const auto group : {ParameterGroup::sh, ParameterGroup::opacity_logits})
        std::swap(swapped.models[0].parameters()[group], swapped.models[1].parameters()[group]);
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
    // Red for the first, blue for the second: nobody learned the other's colours.
    const std::size_t count = 48 * 48;
    for (const std::size_t p : {0, 1}) {
        Cast<cpu::Serial> apart(scene.scene, {scene.motions[p]}, scene.photos);
        for (std::size_t g = 0; g < parameter_group_count; ++g)
            apart.models[0].parameters()[static_cast<ParameterGroup>(g)] =
                cast.models[p].parameters()[static_cast<ParameterGroup>(g)];
        Image<float> alpha;
        const Image<float> color = apart.picture(scene.photos[1].camera, scene.photos[1].frame, &alpha);
        double red = 0, blue = 0;
        for (std::size_t i = 0; i < count; ++i)
            if (alpha.data[i] > 0.9f) red += color.data[i], blue += color.data[2 * count + i];
        CHECK((p == 0 ? red - blue : blue - red) > 0.2 * (red + blue));
    }
}

TEST_CASE("the gradient of one picture reaches both people, and is right") {
    const SmallScene scene;
    test::Rng rng(5);
    std::vector<std::uint8_t> noise(scene.photos[0].rgba.size(),
                                    255); // few differences near the kink of L1, small steps to miss those
    for (std::size_t i = 0; i < noise.size(); ++i)
        if (i % 4 != 3) noise[i] = static_cast<std::uint8_t>(rng.uniform(0, 255));
    Photo photo = scene.photos[0];
    photo.rgba = noise;
    // Rates that move nothing: a step then is a loss and, in its first moment, a tenth of the gradient.
    TrainConfig config;
    config.random_background = false; // each step sees the same
    LearningRates& r = config.rates;
    for (double* rate : {&r.joints, &r.quats, &r.log_scales, &r.opacity_logits, &r.displacement, &r.sh,
                         &r.stored_displacements, &r.stored_sh, &r.ao})
        *rate = 1e-200;
    Cast<cpu::Serial, double> cast(scene, {scene.motion, moved(scene.motion, in_front)}, {photo}, {},
                                   {.initial_thickness = 1, .sh_dc_scale = 20}, config, 2);
    for (auto& model : cast.models) {
        for (double& opacity : model.parameters()[ParameterGroup::opacity_logits]) opacity = rng.uniform(-1, 1.5);
        for (double& scale : model.parameters()[ParameterGroup::log_scales])
            scale += rng.uniform(-0.3, 0.3); // round ones do not turn
        for (double& weight : model.parameters()[ParameterGroup::joint_network]) weight = rng.uniform(-0.2, 0.2);
        for (double& entry : model.parameters()[ParameterGroup::joint_table]) entry = rng.uniform(-0.1, 0.1);
    }
    const auto loss = [&] {
        cast.trainer.step();
        return cast.trainer.last_loss().loss;
    };
    loss();
    std::array<Parameters<cpu::Serial, double>, 2> gradient;
    for (const std::size_t p : {0, 1}) {
        gradient[p].become_zero_like(cast.backend, cast.models[p].parameters());
        for (std::size_t g = 0; g < parameter_group_count; ++g) {
            const auto group = static_cast<ParameterGroup>(g);
            for (std::size_t i = 0; i < gradient[p][group].size(); ++i)
                gradient[p][group][i] = 10 * cast.trainer.first_moment(p)[group][i];
        }
    }
    using enum ParameterGroup;
    for (const std::size_t p : {0, 1})
        for (const auto group : {joints, quats, log_scales, opacity_logits, joint_table, joint_network}) {
            CAPTURE(p);
            CAPTURE(parameter_group_names[static_cast<std::size_t>(group)]);
            const Span<double> values = cast.models[p].parameters()[group];
            double largest = 0;
            for (const double value : gradient[p][group]) largest = std::max(largest, std::abs(value));
            CHECK(largest > 1e-6);
            test::check_gradient(loss, values, Span<const double>(gradient[p][group]),
                                 {.step = 1e-7,
                                  .tolerance = 2e-6,
                                  .elements = test::spread_elements(values.size(),
                                                                    cast.models[p].touched_entries(group), 2, 12)});
        }
}

TEST_CASE("two people go on from a checkpoint bit for bit, refinement and all") {
    const TwoPeople scene;
    const AvatarConfig shaded{.ao = AmbientOcclusion::time};
    const TrainConfig config{.rates = {.quats = 0, .sh = 5e-3}, .ao_start = 0.3};
    RefinementConfig moving;
    for (RefinedGroup* group : {&moving.pose, &moving.transl, &moving.expression}) group->start = 2 / 16.0;
    struct Everything {
        Cast<cpu::Serial> cast;
        std::deque<MotionRefinement<cpu::Serial>> refinements;

        Everything(const TwoPeople& of, const AvatarConfig& avatar, const TrainConfig& train, RefinementConfig refine)
            : cast(of.scene, of.motions, of.photos, {}, avatar, train) {
            for (const std::size_t p : {0, 1}) {
                refinements.emplace_back(cast.backend, cast.rigs[p], of.motions[p],
                                         p == 1 ? of.scene.cameras : std::vector<Camera<double>>(), refine);
                cast.trainer.refine(refinements[p], p);
            }
        }
        void run(int first, int last) {
            for (int i = first; i < last; ++i) cast.trainer.step(i / 16.0);
        }
    };
    Everything whole(scene, shaded, config, moving), first(scene, shaded, config, moving),
        second(scene, shaded, config, moving);
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
    // A scene of one person is another training.
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
    paint(cast); // the appearance is known
    Motion estimate = scene.motions[0];
    test::Rng rng(3);
    for (auto& v : estimate.pose) v += rng.vec(-0.05, 0.05);
    for (auto& t : estimate.transl) t += rng.vec(-0.02, 0.02);
    MotionRefinement<cpu::Serial> refinement(cast.backend, cast.rigs[0], estimate, {}, test_time_config());
    cast.trainer.refine(refinement);
    std::vector<Observation> observations;
    for (const Photo& photo : scene.photos)
        if (photo.frame == 0) observations.push_back({photo.camera, photo.rgba});
    using Frozen = FrozenScene<Cast<cpu::Serial>::TrainerType>;
    cast.trainer.query(0);
    Frozen frozen{&cast.trainer, 0, 0};
    PoseFit<cpu::Serial, float, Frozen> fit(cast.backend, frozen, cast.trainer.config().filter, {.steps = 80});
    const double before = fit.mean_loss(refinement, 0, observations);
    const PoseFitReport report = fit.fit(refinement, 0, observations);
    CHECK(report.kept);
    CHECK(report.loss_after < 0.5 * before);
    const auto error = [&](const Motion& motion) { return length(motion.transl[0] - scene.motions[0].transl[0]); };
    CHECK(error(refinement.motion()) < 0.7 * error(estimate));
}

TEST_CASE("people that do not fit together are refused") {
    const SmallScene scene;
    using TrainerType = Cast<cpu::Serial>::TrainerType;
    Cast<cpu::Serial> cast(scene, {scene.motion, scene.motion}, scene.photos);
    CHECK_THROWS_AS(TrainerType(cast.backend, {}, scene.photos, 1), ValueError);
    auto& models = cast.models;
    CHECK_THROWS_AS(
        TrainerType(cast.backend, {{&models[0], &scene.motion}, {&models[0], &scene.motion}}, scene.photos, 1),
        ValueError);
    Motion shorter = scene.motion;
    shorter.transl.pop_back();
    CHECK_THROWS_AS(TrainerType(cast.backend, {{&models[0], &scene.motion}, {&models[1], &shorter}}, scene.photos, 1),
                    ShapeError);
    CHECK_THROWS_AS((void)cast.trainer.model(2), ValueError);
    RefinementConfig config;
    std::deque<MotionRefinement<cpu::Serial>> refinements;
    for (const std::size_t p : {0, 1})
        refinements.emplace_back(cast.backend, cast.rigs[p], scene.motion, scene.cameras, config);
    cast.trainer.refine(refinements[0], 0);
    CHECK_THROWS_AS(cast.trainer.refine(refinements[1], 1), ValueError);
}
