// SPDX-License-Identifier: Apache-2.0
/// A scene that is not part of gsh: every type that satisfies the concept trains in Trainer.
#include <gsh/cpu.hpp>
#include <gsh/train/splat_scene.hpp>
#include <gsh/train/static_model.hpp>
#include <gsh/train/trainer.hpp>

#include "support/gradient.hpp"
#include "support/learned.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

/// Round splats that stand on a grid; only their colours learn.
template <class B>
class Lights : public PlainScene<B, float> {
public:
    static constexpr std::size_t count = 16;

    explicit Lights(B& backend) : backend_(&backend), colors_(backend, std::vector<float>(3 * count, 0.5f)) {}

    [[nodiscard]] std::size_t size() const { return count; }
    [[nodiscard]] std::size_t frame_count() const { return 1; }
    void forward(std::size_t, const Deferred<vec3<float>>&, const SplatView<float>& splats) {
        for (std::size_t i = 0; i < count; ++i) {
            const auto row = static_cast<float>(i / 4), column = static_cast<float>(i % 4);
            splats.means[i] = {0.3f * column - 0.45f, 0.3f * row - 0.45f, 0};
            splats.covariances[i] = {0.02f, 0, 0, 0.02f, 0, 0.02f};
            splats.opacities[i] = 0.9f;
        }
        backend_->copy(view_as<const vec3<float>>(Span<const float>(colors_.values())), splats.colors);
    }
    void backward(std::size_t, const Deferred<vec3<float>>&, const SplatView<const float>& dL_dsplats,
                  Span<vec3<float>>) {
        const Span<vec3<float>> gradient = view_as<vec3<float>>(colors_.gradient());
        for (std::size_t i = 0; i < count; ++i) gradient[i] += dL_dsplats.colors[i];
    }
    [[nodiscard]] LearnedArrays<float> learned() { return {colors_.announce("colors", 0.02)}; }

private:
    B* backend_;
    LearnedBuffer<B> colors_;
};

static_assert(SplatScene<Lights<cpu::Serial>, cpu::Serial, float>);
static_assert(SplatScene<Lights<cpu::Threads>, cpu::Threads, float>);
static_assert(SplatScene<StaticModel<cpu::Serial, double>, cpu::Serial, double>);
static_assert(!SplatScene<Lights<cpu::Serial>, cpu::Serial, double>);
static_assert(!SplatScene<PlainScene<cpu::Serial, float>, cpu::Serial, float>); // no splats
static_assert(!SplatScene<int, cpu::Serial, float>);

struct Pictures {
    static constexpr int size = 24;
    Camera<double> camera = look_at<double>({0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.5, size, size);
    std::vector<std::uint8_t> pixels;

    Pictures() { // red on the left, blue on the right
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) {
                const bool left = x < size / 2;
                pixels.insert(pixels.end(), {std::uint8_t(left ? 230 : 20), 60, std::uint8_t(left ? 20 : 230), 255});
            }
    }
    [[nodiscard]] std::vector<Photo> photos() const { return {{"half", camera, 0, pixels}}; }
};

} // namespace

TEST_CASE("a scene of the user's own trains in Trainer, on any backend the same") {
    const Pictures pictures;
    const auto train = [&](auto backend) {
        using B = decltype(backend);
        Lights<B> lights(backend);
        Trainer<B, Lights<B>> trainer(backend, lights, pictures.photos(), 1, {.random_background = false});
        trainer.step();
        const double before = trainer.last_loss().loss;
        for (int step = 0; step < 80; ++step) trainer.step();
        CHECK(trainer.last_loss().loss < 0.7 * before);
        CHECK(&trainer.scene() == &lights);
        return test::learned_values(lights);
    };
    const auto colors = train(cpu::Serial());
    CHECK(train(cpu::Threads(2)) == colors);
    std::size_t red = 0, blue = 0;
    for (std::size_t i = 0; i < colors.size(); i += 3) {
        red += colors[i] > colors[i + 2] + 0.3f;
        blue += colors[i + 2] > colors[i] + 0.3f;
    }
    CHECK(red == 8);
    CHECK(blue == 8);
}

TEST_CASE("a plain scene has the photograph's camera, which does not learn") {
    const Pictures pictures;
    cpu::Serial backend;
    Lights<cpu::Serial> lights(backend);
    const Photo photo = pictures.photos()[0];
    CHECK(lights.camera(photo).camera.known.t == vec3<float>(photo.camera.t));
    CHECK(lights.camera(photo).camera.known.fx == static_cast<float>(photo.camera.fx));
    const CameraGradientView<float> gradient = lights.camera_gradient(photo);
    CHECK(gradient.camera.empty());
    CHECK(gradient.center.empty());
}

TEST_CASE("a photograph of a frame that the scene does not have is refused") {
    const Pictures pictures;
    cpu::Serial backend;
    Lights<cpu::Serial> lights(backend);
    auto photos = pictures.photos();
    photos[0].frame = 1;
    using TrainerType = Trainer<cpu::Serial, Lights<cpu::Serial>>;
    CHECK_THROWS_AS(TrainerType(backend, lights, photos, 1), ValueError);
}
