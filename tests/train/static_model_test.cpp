// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/image/image.hpp>
#include <gsh/setup/static_start.hpp>
#include <gsh/train/evaluation.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/trainer.hpp>

#include "io/temporary.hpp"
#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// A ball with smooth colours and no background, ray traced from a ring of eight cameras and one between them, without
/// a rasterizer.
struct BallScene {
    static constexpr int size = 56;
    static constexpr double radius = 0.5;
    std::vector<std::vector<std::uint8_t>> images;
    std::vector<Photo> photos; // the last one is for evaluation

    BallScene() {
        for (int i = 0; i < 9; ++i) {
            const double angle = i < 8 ? 0.7854 * i : 0.4, height = i % 2 == 0 ? 0.5 : -0.4;
            const auto camera = look_at<double>({2 * std::sin(angle), i < 8 ? height : 0.1, 2 * std::cos(angle)},
                                                {0, 0, 0}, {0, 1, 0}, 0.7, size, size);
            images.push_back(photograph(camera));
            photos.push_back({"cam" + std::to_string(i), camera, 0, {}});
        }
        for (std::size_t i = 0; i < images.size(); ++i) photos[i].rgba = images[i];
    }
    BallScene(const BallScene&) = delete;

    std::vector<Photo> training() const { return {photos.begin(), photos.end() - 1}; }

private:
    static std::vector<std::uint8_t> photograph(const Camera<double>& camera) {
        constexpr int samples = 4; // per pixel and axis
        std::vector<std::uint8_t> rgba(4 * size * size);
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                vec3<double> sum(0.0);
                double hits = 0;
                for (int s = 0; s < samples * samples; ++s) {
                    const double u = x + (s % samples + 0.5) / samples, v = y + (s / samples + 0.5) / samples;
                    const vec3<double> ray = normalize(transposed_times(
                        camera.R, vec3<double>((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1)));
                    const vec3<double> from = camera.center();
                    const double b = dot(from, ray), c = dot(from, from) - radius * radius, root = b * b - c;
                    if (root < 0) continue;
                    const vec3<double> p = from + ray * (-b - std::sqrt(root));
                    sum += vec3<double>(0.5 + 0.4 * std::sin(5 * p.x + 2 * p.y), 0.5 + 0.4 * std::sin(4 * p.y - 1),
                                        0.5 + 0.4 * std::cos(6 * p.z));
                    hits += 1;
                }
                std::uint8_t* pixel = &rgba[static_cast<std::size_t>(4 * (y * size + x))];
                for (int k = 0; k < 3; ++k)
                    pixel[k] = static_cast<std::uint8_t>(hits > 0 ? 255 * sum[k] / hits + 0.5 : 0);
                pixel[3] = static_cast<std::uint8_t>(255 * hits / (samples * samples) + 0.5);
            }
        return rgba;
    }
};

StaticModelParams small_config(std::int64_t steps) {
    StaticModelParams config = static_model_params(steps);
    config.density.max_gaussians = 2000;
    config.sh_degree = 2;
    return config;
}

/// A static scene and its trainer, as a program makes them.
template <class B>
struct StaticTraining {
    StaticModel<B> model;
    Trainer<B, StaticModel<B>> trainer;

    StaticTraining(B& backend, const GaussianCloud<float>& start, const std::vector<Photo>& photos, std::uint64_t seed,
                   const StaticModelParams& config)
        : model(backend, start, config.extent != 0 ? config.extent : scene_extent(photos), seed, config),
          trainer(backend, model, photos, static_order_seed(seed), train_params_of(config)) {}
    StaticTraining(B& backend, const BallScene& scene, std::size_t points, const StaticModelParams& config,
                   std::uint64_t seed = 1)
        : StaticTraining(backend, start(scene.training(), points, seed), scene.training(), seed, config) {}
    StaticTraining(const StaticTraining&) = delete;

private:
    static GaussianCloud<float> start(const std::vector<Photo>& photos, std::size_t points, std::uint64_t seed) {
        return initial_gaussians<float>(visual_hull_points(photos, hull_box(photos), points, seed));
    }
};

std::vector<float> cloud_numbers(const GaussianCloud<float>& cloud) {
    std::vector<float> all = cloud.opacity_logits;
    for (const auto& v : cloud.means) all.insert(all.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.log_scales) all.insert(all.end(), {v.x, v.y, v.z});
    for (const auto& v : cloud.quats) all.insert(all.end(), {v.w, v.x, v.y, v.z});
    for (const auto& v : cloud.sh) all.insert(all.end(), {v.x, v.y, v.z});
    return all;
}

} // namespace

TEST_CASE("a small scene is learnt from eight views and shown from a ninth") {
    const BallScene scene;
    cpu::Threads backend(2);
    StaticTraining training(backend, scene, 400, small_config(350));
    auto& [model, trainer] = training;
    const double before = compare(trainer, scene.photos.back()).score.psnr;
    for (int step = 0; step < 350; ++step) trainer.step();
    const auto score = compare(trainer, scene.photos.back()).score;
    CAPTURE(before);
    CAPTURE(score.psnr);
    CAPTURE(model.size());
    CHECK(score.psnr > 30);
    CHECK(score.psnr > before + 8);
    CHECK(trainer.step_count() == 350);
    CHECK(model.total_change().cloned + model.total_change().split > 20);
    CHECK(model.total_change().pruned > 0);
    CHECK(model.size() <= 2000);
    CHECK(model.cloud().sh_degree == 2);
    CHECK(std::isfinite(trainer.last_loss().loss));
    Image<float> color, alpha;
    trainer.render(scene.photos[0].camera, 0, color, &alpha);
    CHECK(alpha.at(0, 28, 28) > 0.9f);
    CHECK(alpha.at(0, 1, 1) < 0.1f);
}

TEST_CASE("the same seed gives the same scene bit for bit, whatever the thread count") {
    const BallScene scene;
    StaticModelParams config = small_config(45);
    config.density.start = 5, config.density.interval = 10, config.density.reset_interval = 20,
    config.density.stop = 40;
    config.sh_interval = 15;
    const auto train = [&](auto backend, std::uint64_t seed) {
        StaticTraining training(backend, scene, 300, config, seed);
        for (int step = 0; step < 45; ++step) training.trainer.step();
        CHECK(training.model.size() != 300);
        return cloud_numbers(training.model.cloud());
    };
    const auto expected = train(cpu::Serial(), 1);
    for (const std::size_t threads : {2, 5}) {
        CAPTURE(threads);
        CHECK(train(cpu::Threads(threads), 1) == expected);
    }
    CHECK(train(cpu::Serial(), 2) != expected);
}

TEST_CASE("a degree more changes no picture") {
    const BallScene scene;
    cpu::Serial backend;
    StaticModelParams config = small_config(100);
    config.density.start = 1000;
    config.density.reset_interval = 0;
    config.sh_interval = 4;
    config.sh_degree = 3;
    StaticTraining training(backend, scene, 50, config);
    std::vector<int> degrees;
    for (int step = 0; step < 14; ++step) {
        training.trainer.step();
        degrees.push_back(training.model.cloud().sh_degree);
    }
    CHECK(degrees == std::vector<int>{0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3});

    // The picture does not change when the degree rises after a step.
    config.sh_degree = 0;
    StaticTraining other(backend, scene, 50, config);
    config.sh_degree = 3;
    StaticTraining raised(backend, scene, 50, config);
    for (int step = 0; step < 4; ++step) other.trainer.step(), raised.trainer.step();
    Image<float> a, b;
    other.trainer.render(scene.photos[8].camera, 0, a);
    raised.trainer.render(scene.photos[8].camera, 0, b);
    CHECK(raised.model.cloud().sh_degree == 1);
    CHECK(a.data == b.data);
}

TEST_CASE("a budget of steps keeps the proportions of 30,000") {
    const StaticModelParams whole = static_model_params(30000), tenth = static_model_params(3000),
                            tiny = static_model_params(1);
    CHECK(whole.density.start == 500);
    CHECK(whole.density.stop == 15000);
    CHECK(whole.density.interval == 100);
    CHECK(whole.density.reset_interval == 3000);
    CHECK(whole.sh_interval == 1000);
    CHECK(tenth.steps == 3000);
    CHECK(tenth.density.start == 50);
    CHECK(tenth.density.stop == 1500);
    CHECK(tenth.density.reset_interval == 300);
    CHECK(tenth.density.interval == 25);
    CHECK(tiny.sh_interval == 1);
    CHECK_THROWS_AS((void)static_model_params(0), ValueError);
}

TEST_CASE("the trainer refuses what it cannot train on") {
    const BallScene scene;
    cpu::Serial backend;
    const auto photos = scene.training();
    const GaussianCloud<float> cloud(4, 1);
    const auto refuse = [&](const GaussianCloud<float>& start, const std::vector<Photo>& views,
                            const StaticModelParams& config, std::string_view word) {
        test::check_throws([&] { StaticTraining<cpu::Serial>(backend, start, views, 0, config); }, {word});
    };
    refuse(cloud, {}, {}, "no photographs");
    refuse({}, photos, {}, "no Gaussians");
    refuse(cloud, photos, {.sh_degree = 0}, "degree 1");
    refuse(cloud, photos, {.sh_degree = 5}, "0 to 4");
    refuse(cloud, photos, {.density = {.max_gaussians = 3}}, "max_gaussians");
    refuse(cloud, photos, {.steps = 0}, "steps");
    refuse(cloud, {photos[0]}, {}, "extent");
    auto broken = photos;
    broken[1].rgba = broken[1].rgba.subspan(0, 8);
    refuse(cloud, broken, {}, "cam1");

    GaussianCloud<float> faint(4, 0);
    for (float& x : faint.opacity_logits) x = -20;
    StaticTraining<cpu::Serial> training(backend, faint, photos, 0, {.density = {.start = 0, .interval = 1}});
    test::check_throws<ValueError>([&] { training.trainer.step(); }, {"no Gaussian is left after step 1"});
}

TEST_CASE("a static scene trains as 3DGS does: one background, rates that its own schedule moves") {
    const StaticModelParams config = static_model_params(1000);
    const TrainParams train = train_params_of(config);
    CHECK(!train.random_background);
    CHECK(train.background == config.background);
    CHECK(train.ssim_weight == config.ssim_weight);
    CHECK(train.filter.dilation == config.filter.dilation);
    for (const double progress : {0.0, 0.5, 1.0}) CHECK(train.rate_factor(progress) == 1);

    const BallScene scene;
    cpu::Serial backend;
    StaticModel<cpu::Serial> model(backend, GaussianCloud<float>(4, 2), 2.5, 0, config);
    const auto means_rate = [&](std::uint64_t step) {
        model.set_progress(step, 0);
        return test::learned_array(model, "means").rate;
    };
    CHECK(means_rate(0) == doctest::Approx(2.5 * 1.6e-4));
    CHECK(means_rate(500) == doctest::Approx(2.5 * 1.6e-5));
    CHECK(means_rate(1000) == doctest::Approx(2.5 * 1.6e-6));
    const auto sh = test::learned_array(model, "sh");
    CHECK(sh.rate == 2.5e-3);
    CHECK(sh.other.where == LearnedArray<float>::OtherRate::Where::columns);
    CHECK(sh.other.width == 27);
    CHECK(sh.other.first == 3);
    CHECK(sh.other.rate == doctest::Approx(2.5e-3 / 20));
    CHECK(model.extent() == 2.5);
    CHECK(scene_extent(scene.training()) > 2);
    CHECK_THROWS_AS((void)scene_extent({scene.photos[0]}), ValueError);
}

TEST_CASE_TEMPLATE("a static scene's adjoint is the gradient of its splats, and adds", B, cpu::Serial, cpu::Threads) {
    test::Rng rng(3);
    constexpr std::size_t N = 9;
    GaussianCloud<double> start(N, 2);
    for (std::size_t i = 0; i < N; ++i) {
        start.means[i] = rng.vec();
        start.quats[i] = rng.quat();
        start.log_scales[i] = rng.vec(-2, -1);
        start.opacity_logits[i] = rng.uniform(-1, 1);
    }
    for (auto& value : start.sh) value = rng.vec(-0.2, 0.2);
    B backend{};
    StaticModel<B, double> model(backend, start, 1, 0, {});
    Splats<B, double> splats, weights;
    splats.resize(N), weights.resize(N);
    fill_zero(backend, weights.view());
    for (std::size_t i = 0; i < N; ++i) {
        weights.means[i] = rng.vec(), weights.colors[i] = rng.vec(), weights.opacities[i] = rng.uniform(-1, 1);
        weights.covariances[i] = {rng.uniform(), rng.uniform(), rng.uniform(),
                                  rng.uniform(), rng.uniform(), rng.uniform()};
    }
    const vec3<double> center{0.5, 0.3, 4};
    const auto loss = [&] {
        model.forward(0, center, splats.view());
        double sum = 0;
        for (std::size_t i = 0; i < N; ++i) {
            sum += dot(splats.means[i], weights.means[i]) + dot(splats.colors[i], weights.colors[i]) +
                   splats.opacities[i] * weights.opacities[i];
            const auto a = test::scalars(splats.covariances[i]), b = test::scalars(weights.covariances[i]);
            for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
        }
        return sum;
    };
    const auto backward = [&] {
        loss();
        model.backward(0, center, std::as_const(weights).view(), {});
    };
    backward();
    for (const LearnedArray<double>& array : model.learned()) {
        CAPTURE(array.name);
        double largest = 0;
        for (const double value : array.gradient) largest = std::max(largest, std::abs(value));
        CHECK(largest > 1e-3);
        test::check_gradient(loss, array.values, Span<const double>(array.gradient), {.stride = 3});
    }
    const auto once = test::learned_gradients(model);
    backward();
    const auto twice = test::learned_gradients(model);
    for (std::size_t i = 0; i < once.size(); ++i) CHECK(twice[i] == doctest::Approx(2 * once[i]));
}
