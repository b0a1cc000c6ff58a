// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/joint_error.hpp>
#include <gsh/cpu.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/refine/refinement.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/trainer.hpp>

#include "support/posed_scene.hpp"
#include "support/small_training.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

using namespace gsh;
using test::PosedScene;
using test::SmallScene;
using test::SmallTraining;

namespace {

using Refinement = MotionRefinement<cpu::Serial>;

/// A training on the posed scene's photographs with errors in the poses or cameras. Joints and displacements are fixed,
/// because they would otherwise learn a share of the poses' common error.
struct Estimated {
    PosedScene scene;
    Motion motion;
    std::vector<Camera<double>> cameras;
    cpu::Serial backend;
    test::SmallAvatar<cpu::Serial> model;
    AvatarScene<cpu::Serial, test::SmallAvatar<cpu::Serial>> people;
    SmallTraining<cpu::Serial>::TrainerType trainer;
    std::optional<Refinement> refinement;

    Estimated(Motion poses, std::vector<Camera<double>> calibration)
        : motion(std::move(poses)), cameras(std::move(calibration)),
          model(test::small_avatar(
              backend, scene.avatar.rig, samples(), motion.frame_count(), 3,
              {.hash_displacement = false, .appearance = {.stored_displacement_rate = 0}, .model = {.joint_rate = 0}})),
          people(backend, model, motion), trainer(backend, people, photos(), 3) {}
    Estimated(const Estimated&) = delete;

    void refine(const RefinementParams& config, bool with_cameras = false) {
        refinement.emplace(backend, scene.avatar.rig, motion, with_cameras ? cameras : std::vector<Camera<double>>(),
                           config);
        people.refine(*refinement);
    }
    void train(int steps) {
        for (int i = 0; i < steps; ++i) trainer.step(static_cast<double>(i) / steps);
    }

private:
    [[nodiscard]] SurfaceSamples samples() const { // the samples of which the scene's rig was made
        return sample_surface(scene.body, shaped_vertices(scene.body, scene.truth.betas),
                              std::vector<double>(scene.body.vertex_count(), 12.0), 4);
    }
    [[nodiscard]] std::vector<Photo> photos() const {
        std::vector<Photo> all;
        for (std::size_t f = 0; f < PosedScene::frames; ++f)
            for (Photo photo : scene.observe(f)) {
                photo.camera = cameras[photo.camera_index];
                all.push_back(photo);
            }
        return all;
    }
};

std::vector<float> trained(Estimated& training) {
    return test::learned_values(training.model);
}

/// The small scene in a room: photographs with a background picture behind the person, a different one per camera.
struct Plates {
    static constexpr int size = SmallScene::size;
    std::vector<PixelImage> images;

    Plates() {
        for (const int green : {40, 200}) {
            PixelImage plate(4, size, size);
            for (int y = 0; y < size; ++y)
                for (int x = 0; x < size; ++x) {
                    const int rgba[]{5 * x, green, 5 * y, 255};
                    std::copy_n(rgba, 4, plate.pixel(y, x));
                }
            images.push_back(std::move(plate));
        }
    }
    void behind(SmallScene& scene) const {
        for (Photo& photo : scene.photos) photo.plate = images[photo.camera_index].data;
    }
};

/// The mean squared error, as a user of the trainer would write it.
struct SquaredError {
    struct Cache {
        std::vector<double> values = std::vector<double>(4, 0);
    };
    void forward(const ImageView<const float>& render, const ImageView<const float>& truth, Cache& cache) const {
        double sum = 0;
        for (std::size_t i = 0; i < render.data.size(); ++i) sum += std::pow(render.data[i] - truth.data[i], 2);
        const double mse = sum / static_cast<double>(render.data.size()), unknown = std::nan("");
        cache.values = {mse, unknown, unknown, mse};
    }
    void backward(const ImageView<const float>& render, const ImageView<const float>& truth, float weight, Cache&,
                  const ImageView<float>& dL_drender) const {
        const float scale = 2 * weight / static_cast<float>(render.data.size());
        for (std::size_t i = 0; i < render.data.size(); ++i)
            dL_drender.data[i] += scale * (render.data[i] - truth.data[i]);
    }
    [[nodiscard]] PhotometricValues values(const Cache& cache) const {
        return PhotometricValues::from(cache.values.data());
    }
};

/// gsh's rasterizer, which counts its pictures.
struct CountingRasterizer {
    Rasterizer<cpu::Serial> of;
    int* pictures;

    using Cache = RasterCache<cpu::Serial, float>;
    void forward(const Deferred<Camera<float>>& camera, const SplatView<const float>& splats,
                 const Background<float>& background, const RenderTarget<float>& target, Cache& cache) const {
        ++*pictures;
        of.forward(camera, splats, background, target, cache);
    }
    void backward(const Deferred<Camera<float>>& camera, const SplatView<const float>& splats,
                  const Background<float>& background, const RenderGradient<float>& dL_dtarget, Cache& cache,
                  const SplatView<float>& dL_dsplats, Span<CameraGradient<float>> dL_dcamera) const {
        of.backward(camera, splats, background, dL_dtarget, cache, dL_dsplats, dL_dcamera);
    }
    void mend(Cache& cache) const { of.mend(cache); }
};

} // namespace

/// Each number moves by its rate against the sign of its gradient. In a namespace of its own, as a user's would be.
namespace users {
struct SignDescent {
    double share = 1; // of the rates
};
void take_steps(cpu::Serial&, const SignDescent& optimizer, const LearnedArrays<float>& arrays, double factor,
                std::int64_t) {
    for (const LearnedArray<float>& array : arrays)
        for (std::size_t i = 0; i < array.values.size(); ++i) {
            const float g = std::exchange(array.gradient[i], 0.0f);
            array.values[i] -= static_cast<float>(optimizer.share * factor * array.rate) *
                               static_cast<float>((g > 0) - (g < 0));
        }
}
} // namespace users

TEST_CASE("a user's image loss, rasterizer, optimiser and gains take the places of gsh's") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> given(scene), model(scene), with_loss(scene), with_steps(scene);
    const PhotoLossParams params = photo_loss_params(test::small_training);
    cpu::Serial backend;

    // Parts that only pass on what they get leave every bit as it is.
    int pictures = 0;
    const CountingRasterizer counting{Rasterizer<cpu::Serial>(backend, raster_params<float>(params.filter)), &pictures};
    PhotoLoss loss(backend, params, PhotometricLoss<cpu::Serial>(backend, {.ssim_weight = float(params.ssim_weight)}),
                   counting);
    Trainer<cpu::Serial, AvatarScene<cpu::Serial, test::SmallAvatar<cpu::Serial>>, float, decltype(loss)> same(
        model.backend, model.people, scene.photos, 3, test::small_training, std::move(loss), Adam(),
        PhotoGains<cpu::Serial>(backend, scene.photos, test::small_training.gain));
    given.steps(3);
    for (int i = 0; i < 3; ++i) same.step(0);
    CHECK(pictures == 3);
    CHECK(given.parameters() == model.parameters());
    CHECK(same.gains().gains() == given.trainer.gains().gains());
    same.release_memory();
    same.step(0);
    given.steps(1);
    CHECK(given.parameters() == model.parameters());

    // Others train, too.
    PhotoLoss<cpu::Serial, float, SquaredError> squared(backend, params, SquaredError());
    Trainer of_squares(with_loss.backend, with_loss.people, scene.photos, 3, test::small_training, std::move(squared));
    const auto improves = [](auto& trainer) {
        std::vector<double> loss_of_step;
        for (int i = 0; i < 60; ++i) trainer.step(0), loss_of_step.push_back(trainer.last_loss().loss);
        const auto mean = [&](std::size_t from) {
            return std::accumulate(loss_of_step.begin() + std::ptrdiff_t(from), loss_of_step.begin() + std::ptrdiff_t(from) + 8, 0.0);
        };
        return mean(52) / mean(0);
    };
    CHECK(improves(of_squares) < 0.7);
    CHECK(of_squares.last_loss().loss == doctest::Approx(std::pow(10, -of_squares.last_psnr() / 10)));
    Trainer by_sign(with_steps.backend, with_steps.people, scene.photos, 3, test::small_training,
                    PhotoLoss<cpu::Serial>(backend, params), users::SignDescent{0.5});
    CHECK(improves(by_sign) < 0.9);
}

TEST_CASE("a term of the loss gets each frame that counts, with a gradient where the motion learns") {
    struct Spy final : LossTerm<cpu::Serial> {
        std::vector<std::size_t> frames;
        std::vector<bool> learns;
        bool counts(std::size_t frame) const override { return frame != 1; }
        void backward(std::size_t frame, const RigPose<cpu::Serial>& pose, const RigPoseGradient<float>& dL_dpose) override {
            frames.push_back(frame), learns.push_back(!dL_dpose.empty());
            CHECK(pose.pose.size() == 4);
            if (!dL_dpose.transl.empty()) dL_dpose.transl[0] += vec3<float>(1, 0, 0);
        }
    };
    const PosedScene posed;
    Estimated still(posed.truth, posed.cameras), pushed(posed.truth, posed.cameras);
    const RefinementParams config{
        .pose = {}, .transl = {.rate = 1e-3}, .expression = {}, .betas = {}, .pose_bias = {}, .transl_bias = {}};
    still.refine(config), pushed.refine(config);
    Spy term;
    pushed.people.add(term);
    CHECK_THROWS_AS(pushed.people.add(term, 1), ValueError);
    still.train(15), pushed.train(15);
    CHECK(std::count(term.frames.begin(), term.frames.end(), 1u) == 0);
    CHECK(term.frames.size() == 12); // 15 photographs of 5 frames, 3 of them of frame 1
    CHECK(std::count(term.learns.begin(), term.learns.end(), true) == 12);
    const auto shift = [&](std::size_t frame) {
        return pushed.refinement->motion().transl[frame].x - still.refinement->motion().transl[frame].x;
    };
    CHECK(shift(0) < -1e-3); // the term's gradient is far larger than that of the photographs
    CHECK(std::abs(shift(1)) < 1e-3);

    Spy without;
    Estimated fixed(posed.truth, posed.cameras);
    fixed.people.add(without);
    fixed.train(3);
    CHECK(std::count(without.learns.begin(), without.learns.end(), true) == 0);
}

TEST_CASE("training learns") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const auto before = mean_score(
        {compare(training.trainer, scene.photos[0]).score, compare(training.trainer, scene.photos[3]).score});
    training.steps(120);
    const auto after = mean_score(
        {compare(training.trainer, scene.photos[0]).score, compare(training.trainer, scene.photos[3]).score});
    CAPTURE(before.psnr);
    CAPTURE(after.psnr);
    CHECK(after.psnr > before.psnr + 6);
    CHECK(after.psnr_person > before.psnr_person + 4);
    CHECK(after.ssim > before.ssim + 0.1);
    CHECK(training.trainer.step_count() == 120);
    CHECK(std::isfinite(training.trainer.last_loss().loss));
    CHECK(training.trainer.last_psnr() > 15);
}

TEST_CASE("a trainer that has released its memory goes on with the same bits") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> whole(scene), released(scene);
    whole.steps(8), released.steps(5);
    released.trainer.release_memory();
    Image<float> picture; // results are written from here
    released.trainer.render(scene.photos[0], picture);
    CHECK(*std::max_element(picture.data.begin(), picture.data.end()) > 0);
    released.steps(3);
    CHECK(released.parameters() == whole.parameters());
    CHECK(released.trainer.last_loss().loss == whole.trainer.last_loss().loss);
}

TEST_CASE("the history has loss and PSNR of each step since it was read") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    std::vector<double> losses;
    for (int step = 0; step < 5; ++step) {
        training.steps(1);
        losses.push_back(training.trainer.last_loss().loss);
    }
    const std::vector<StepValues> history = training.trainer.history();
    REQUIRE(history.size() == 5);
    for (std::size_t k = 0; k < 5; ++k) {
        CHECK(history[k].step == k + 1);
        CHECK(history[k].loss == losses[k]);
    }
    CHECK(history[4].psnr == training.trainer.last_psnr());
    CHECK(training.trainer.history().empty());
    training.steps(2);
    CHECK(training.trainer.history().size() == 2);
    training.trainer.resume(20, 0.5); // the steps until there belong to another run
    training.steps(1);
    const std::vector<StepValues> resumed = training.trainer.history();
    REQUIRE(resumed.size() == 1);
    CHECK(resumed[0].step == 21);
}

TEST_CASE("the same seed gives the same avatar bit for bit, whatever the thread count") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> serial(scene);
    serial.steps(15);
    const auto expected = serial.parameters();
    for (const std::size_t threads : {1, 2, 3, 7}) {
        CAPTURE(threads);
        SmallTraining<cpu::Threads> threaded(scene, cpu::Threads(threads));
        threaded.steps(15);
        CHECK(threaded.parameters() == expected);
    }
    SmallTraining<cpu::Serial> other(scene, cpu::Serial(), 4);
    other.steps(15);
    CHECK(other.parameters() != expected);
}

TEST_CASE("an epoch sees every photograph once, and each epoch in another order") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    std::vector<std::vector<std::size_t>> epochs;
    for (std::uint64_t epoch = 0; epoch < 8; ++epoch) {
        std::vector<std::size_t> seen;
        for (std::uint64_t step = 0; step < 4; ++step) seen.push_back(training.trainer.photo_of_step(4 * epoch + step));
        auto sorted = seen;
        std::sort(sorted.begin(), sorted.end());
        CHECK(sorted == std::vector<std::size_t>{0, 1, 2, 3});
        epochs.push_back(seen);
    }
    CHECK(std::any_of(epochs.begin(), epochs.end(), [&](const auto& order) { return order != epochs[0]; }));
}

TEST_CASE("groups with a rate of zero stay as they are") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    const auto before = training.parameters("quats");
    REQUIRE(!before.empty());
    training.steps(3);
    CHECK(training.parameters("quats") == before);
}

TEST_CASE("the trainer refuses photographs that do not fit") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    using TrainerType = SmallTraining<cpu::Serial>::TrainerType;
    CHECK_THROWS_AS(TrainerType(training.backend, training.people, {}, 1), ValueError);
    auto photo = scene.photos[0];
    photo.frame = 2;
    CHECK_THROWS_AS(TrainerType(training.backend, training.people, {photo}, 1), ValueError);
    photo = scene.photos[0];
    photo.rgba = photo.rgba.subspan(0, 8);
    CHECK_THROWS_AS(TrainerType(training.backend, training.people, {photo}, 1), ShapeError);
    photo = scene.photos[0];
    photo.plate = photo.rgba.subspan(0, 8);
    CHECK_THROWS_AS(TrainerType(training.backend, training.people, {photo}, 1), ShapeError);
}

TEST_CASE("rates stay as they are, then fall geometrically to their last value") {
    const TrainParams config{.decay_start = 0.6, .final_rate = 0.04};
    for (const double progress : {-1.0, 0.0, 0.3, 0.6}) CHECK(config.rate_factor(progress) == 1);
    CHECK(config.rate_factor(0.8) == doctest::Approx(0.2));
    CHECK(config.rate_factor(0.9) == doctest::Approx(0.2 * std::sqrt(0.2)));
    for (const double progress : {1.0, 2.0}) CHECK(config.rate_factor(progress) == doctest::Approx(0.04));
    CHECK(TrainParams{.decay_start = 1, .final_rate = 0.04}.rate_factor(1) == 1); // rates never fall
    CHECK(TrainParams{.decay_start = 0, .final_rate = 0.04}.rate_factor(0.5) == doctest::Approx(0.2));
    CHECK(baseline_train_params().rate_factor(1) == 1);
}

TEST_CASE("the trainer refuses a configuration that would end in NaN") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene);
    using TrainerType = SmallTraining<cpu::Serial>::TrainerType;
    const auto refuse = [&](auto change) {
        TrainParams config;
        change(config);
        CHECK_THROWS_AS(TrainerType(training.backend, training.people, scene.photos, 1, config), ValueError);
    };
    refuse([](TrainParams& c) { c.decay_start = 1.5; });
    refuse([](TrainParams& c) { c.decay_start = NAN; });
    refuse([](TrainParams& c) { c.final_rate = 0; });
    refuse([](TrainParams& c) { c.final_rate = -0.1; }); // its powers are not numbers
    refuse([](TrainParams& c) { c.ssim_weight = 1.5; });
    refuse([](TrainParams& c) { c.filter.dilation = -0.1; });
    const auto refuse_avatar = [&](auto change) { // rates and starts belong to the avatar's arrays
        ConfiguredAvatarParams config{.ao = AmbientOcclusion::time};
        change(config);
        CHECK_THROWS_AS(SmallTraining<cpu::Serial>(scene, cpu::Serial(), 3, config), ValueError);
    };
    refuse_avatar([](ConfiguredAvatarParams& c) { c.appearance.sh_rate = -1e-3; });
    refuse_avatar([](ConfiguredAvatarParams& c) {
        c.appearance.displacement_rate = -1e-3;
    }); // the last weights of the shared network
    refuse_avatar([](ConfiguredAvatarParams& c) { c.occlusion.rate = NAN; });
    refuse_avatar([](ConfiguredAvatarParams& c) { c.model.occlusion_start = -1; });
    refuse_avatar([](ConfiguredAvatarParams& c) { c.model.occlusion_start = NAN; });
    refuse_avatar([](ConfiguredAvatarParams& c) { c.model.sh_start = -1; });
    refuse_avatar([](ConfiguredAvatarParams& c) { c.model.sh_start = NAN; });
    refuse_avatar([](ConfiguredAvatarParams& c) {
        c.hash_sh = false;
        c.appearance.stored_sh_rate = -1;
    });
}

TEST_CASE("estimated poses come closer to the true ones while the avatar is learned") {
    const PosedScene scene;
    RefinementParams config;
    config.pose = {.rate = 4e-3, .start = 0.25, .terms = {.pull = 1e-3}};
    config.transl = {.rate = 1e-3, .start = 0.25, .terms = {.pull = 1e-3}};
    config.expression = {};
    Estimated refined(scene.estimate(), scene.cameras), plain(scene.estimate(), scene.cameras);
    refined.refine(config);
    const auto error = [&](const Motion& motion) {
        return joint_errors(scene.body, motion, scene.truth, RootAlignment::position).mean_mm;
    };
    const double before = error(refined.motion);
    CHECK(error(refined.refinement->motion()) == before);
    refined.train(400), plain.train(400);
    const double after = error(refined.refinement->motion());
    const auto score = [&](Estimated& training) {
        std::vector<ImageScore> scores;
        for (const Photo& photo : training.trainer.photos()) scores.push_back(compare(training.trainer, photo).score);
        return mean_score(scores).psnr;
    };
    CAPTURE(before);
    CAPTURE(after);
    CAPTURE(score(plain));
    CAPTURE(score(refined));
    CHECK(after < 0.6 * before);
    CHECK(score(refined) > score(plain) + 3);
}

TEST_CASE("a camera that stands elsewhere than its file says finds its place, and the first one stays") {
    const PosedScene scene;
    auto cameras = scene.cameras;
    cameras[1].t += vec3<double>(0.03, -0.02, 0);
    RefinementParams config;
    for (RefinedGroup* group : {&config.pose, &config.transl, &config.expression}) *group = {};
    config.camera_rotation = {.rate = 1e-3, .start = 0.15, .terms = {.pull = 1e-3}};
    config.camera_translation = {.rate = 1e-3, .start = 0.15, .terms = {.pull = 1e-3}};
    Estimated refined(scene.truth, cameras);
    refined.refine(config, true);
    refined.train(300);
    const auto found = refined.refinement->cameras();
    // Compares the person's middle in the image, in pixels: rotation and translation have nearly the same effect.
    const auto seen = [](const Camera<double>& camera) { return to_pixel(camera, to_camera(camera, {0, 0.8, 0})); };
    const double before = length(seen(cameras[1]) - seen(scene.cameras[1])),
                 after = length(seen(found[1]) - seen(scene.cameras[1]));
    CAPTURE(before);
    CAPTURE(after);
    CHECK(after < 0.55 * before);
    CHECK(found[0].R == cameras[0].R);
    CHECK(found[0].t == cameras[0].t);
    CHECK(refined.refinement->motion().pose == scene.truth.pose);
}

TEST_CASE("a refinement that waits for its start changes nothing, and one that has started does") {
    const PosedScene scene;
    RefinementParams config;
    for (RefinedGroup* group : {&config.pose, &config.transl, &config.expression}) group->start = 0.2;
    for (RefinedGroup* group : {&config.camera_rotation, &config.camera_translation}) group->rate = 0;
    Estimated refined(scene.estimate(), scene.cameras), plain(scene.estimate(), scene.cameras);
    refined.refine(config, true);
    const auto run = [&](int first, int last) {
        for (int i = first; i < last; ++i) refined.trainer.step(i / 20.0), plain.trainer.step(i / 20.0);
    };
    run(0, 5); // the fifth step also moves a pose
    CHECK(trained(refined) == trained(plain));
    CHECK(refined.refinement->motion().pose != scene.estimate().pose);
    run(5, 20);
    CHECK(trained(refined) != trained(plain));
}

TEST_CASE("a frame that is left out of refinement trains at its estimate") {
    const PosedScene scene;
    RefinementParams config;
    for (RefinedGroup* group : {&config.pose, &config.transl}) group->start = 0;
    config.left_out = {2};
    Estimated refined(scene.estimate(), scene.cameras);
    refined.refine(config);
    for (int i = 0; i < 15; ++i) refined.trainer.step();
    const Motion motion = refined.refinement->motion();
    for (std::size_t frame = 0; frame < PosedScene::frames; ++frame)
        CHECK((motion.transl[frame] == refined.motion.transl[frame]) == (frame == 2));
}

TEST_CASE("a photograph's plate stands where the plain background would") {
    SmallScene scene;
    const Plates plates;
    plates.behind(scene);
    SmallTraining<cpu::Serial> training(scene);
    Image<float> color, alpha, over_plate, over_white;
    for (const Photo& photo : scene.photos) {
        training.trainer.photo_pixels(photo, color, alpha);
        training.trainer.render(photo, over_plate);
        training.trainer.render(photo.camera, photo.frame, over_white);
        std::size_t person = 0;
        for (int y = 0; y < Plates::size; ++y)
            for (int x = 0; x < Plates::size; ++x) {
                const std::size_t i = 4 * static_cast<std::size_t>(y * Plates::size + x);
                const bool inside = photo.rgba[i + 3] == 255;
                person += inside;
                for (int c = 0; c < 3; ++c) {
                    const auto k = i + static_cast<std::size_t>(c);
                    CHECK(color.at(c, y, x) == doctest::Approx((inside ? photo.rgba : photo.plate)[k] / 255.0));
                }
                CHECK(alpha.at(0, y, x) == (inside ? 1.0f : 0.0f));
            }
        CHECK(person > 100);
        for (int c = 0; c < 3; ++c) {
            CHECK(over_plate.at(c, 47, 47) ==
                  doctest::Approx(photo.plate[photo.plate.size() - 4 + static_cast<std::size_t>(c)] / 255.0));
            CHECK(over_white.at(c, 47, 47) == 1.0f);
        }
    }
}

TEST_CASE("over plates the same person is learned as over white, and the room stays out of it") {
    const SmallScene white;
    SmallScene room;
    const Plates plates;
    plates.behind(room);
    SmallTraining<cpu::Serial> in_room(room), before_white(white);
    const auto score = [](auto& training, const SmallScene& of) {
        return compare(training.trainer, of.photos[0]).score;
    };
    const double before = score(in_room, room).psnr;
    in_room.steps(160), before_white.steps(160);
    const double after = score(in_room, room).psnr;
    CAPTURE(before);
    CAPTURE(after);
    CHECK(after > before + 6);
    // Each is compared with the other's photographs.
    for (const SmallScene* scene : {&std::as_const(room), &white}) {
        const ImageScore a = score(in_room, *scene), b = score(before_white, *scene);
        CAPTURE(a.psnr_person);
        CAPTURE(b.psnr_person);
        CHECK(std::abs(a.psnr - b.psnr) < 1);
        CHECK(std::abs(a.psnr_person - b.psnr_person) < 1);
    }
}

TEST_CASE("somebody in the background's colour becomes opaque where the background changes, and only there") {
    SmallScene scene;
    for (std::vector<std::uint8_t>& rgba : scene.images) // the photographs refer to these
        for (std::size_t i = 0; i < rgba.size(); ++i)
            if (i % 4 < 3) rgba[i] = 255;   // a white person on white
    const auto opacity = [&](bool random) { // mean alpha where the masks are full
        SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3, {}, {.random_background = random});
        training.steps(60);
        double sum = 0;
        std::size_t count = 0;
        for (const Photo& photo : scene.photos) {
            Image<float> color, alpha;
            training.trainer.render(photo, color, &alpha);
            for (std::size_t i = 0; i < alpha.data.size(); ++i)
                if (photo.rgba[4 * i + 3] == 255) sum += alpha.data[i], ++count;
            for (int c = 0; c < 3; ++c)
                CHECK(color.view().row(c, 0)[0] == 1.0f); // pictures still have a white background
        }
        return sum / static_cast<double>(count);
    };
    const double random = opacity(true), plain = opacity(false);
    CAPTURE(plain);
    CHECK(random > 0.9);
    CHECK(plain < random - 0.1);
}

TEST_CASE("the time that fields read is the frame's number, whatever the time on a clock") {
    SmallScene scene;
    Motion& motion = scene.motion; // five frames, of which the photographs show the first two
    for (std::size_t frame = 2; frame < 5; ++frame) {
        for (std::size_t j = 0; j < 4; ++j) motion.pose.push_back(motion.pose[j]);
        motion.expression.insert(motion.expression.end(), {0, 0.5});
        motion.transl.push_back(motion.transl[0]);
        motion.timestamps.push_back(static_cast<double>(frame));
    }
    const auto train = [&] {
        SmallTraining<cpu::Serial> training(
            scene, cpu::Serial(), 3,
            {.head_time = true, .ao = AmbientOcclusion::time, .model = {.occlusion_start = 0}});
        training.steps(4);
        return training.parameters();
    };
    const auto expected = train();
    for (double& time : motion.timestamps) time = 7 + 0.1 * time;
    CHECK(train() == expected);
    // learn/frame_codes_test.cpp tests the codes. t = frame / frames, so the number of frames matters.
    motion.pose.resize(8), motion.expression.resize(4), motion.transl.resize(2), motion.timestamps.resize(2);
    CHECK(train() != expected);
}

TEST_CASE("ambient occlusion waits for its start: until then it neither learns nor shades") {
    const SmallScene scene;
    ConfiguredAvatarParams params{.model = {.occlusion_start = 0.4, .quat_rate = 0}};
    SmallTraining<cpu::Serial> plain(scene, cpu::Serial(), 3, params);
    params.ao = AmbientOcclusion::time;
    SmallTraining<cpu::Serial> shaded(scene, cpu::Serial(), 3, params);
    const auto ao = [&] {
        auto both = shaded.parameters("shadow_field.table");
        const auto network = shaded.parameters("shadow_field.network");
        both.insert(both.end(), network.begin(), network.end());
        return both;
    };
    const auto initial = ao();
    REQUIRE(!initial.empty());
    CHECK(!test::learns(plain.model, "shadow_field.table"));
    shaded.steps(6, 0.39), plain.steps(6, 0.39);
    CHECK(ao() == initial);
    for (const auto* name : {"joints", "shared_field.table", "shared_field.network", "opacity_logits", "log_scales"})
        CHECK(shaded.parameters(name) == plain.parameters(name));
    CHECK(!shaded.model.occludes());
    CHECK(shaded.mean_ao().empty());
    shaded.steps(6, 0.4), plain.steps(6, 0.4);
    CHECK(ao() != initial);
    CHECK(shaded.parameters("shared_field.table") != plain.parameters("shared_field.table"));
    CHECK(shaded.model.occludes());
    CHECK(!plain.model.occludes());
    CHECK(plain.mean_ao().empty());
}

TEST_CASE("ambient occlusion that follows the pose is learned, and has a mean") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3,
                                        {.ao = AmbientOcclusion::pose, .model = {.occlusion_start = 0}});
    const auto initial = training.parameters("shadow_field.network");
    training.steps(8);
    CHECK(training.parameters("shadow_field.network") != initial);
    CHECK(training.mean_ao().size() == training.model.size());
}

TEST_CASE("an observer is told of each stage once, in order, and changes nothing") {
    struct Recorder {
        std::vector<Stage> stages;
        int left = 0;
        void enter(Stage stage) { stages.push_back(stage); }
        void leave() { ++left; }
    } recorder;
    const SmallScene scene;
    SmallTraining<cpu::Serial> observed(scene), alone(scene);
    for (int i = 0; i < 3; ++i) observed.trainer.step(0, recorder);
    alone.steps(3);
    CHECK(observed.parameters() == alone.parameters());
    CHECK(recorder.left == 3);
    REQUIRE(recorder.stages.size() == 3 * stage_names.size());
    for (std::size_t i = 0; i < recorder.stages.size(); ++i)
        CHECK(recorder.stages[i] == static_cast<Stage>(i % stage_names.size()));
    StageClock clock;
    observed.trainer.step(0, clock);
    CHECK(clock.steps() == 1);
}

TEST_CASE("a trainer that is resumed goes on where it is told to") {
    const SmallScene scene;
    SmallTraining<cpu::Serial> training(scene, cpu::Serial(), 3,
                                        {.ao = AmbientOcclusion::time, .model = {.occlusion_start = 0.5}});
    CHECK(training.trainer.seed() == 3);
    training.trainer.resume(7, 0.6);
    CHECK(training.trainer.step_count() == 7);
    CHECK(training.trainer.progress() == 0.6);
    CHECK(training.model.occludes());
    training.trainer.resume(2, 0.4);
    CHECK(!training.model.occludes());
}
