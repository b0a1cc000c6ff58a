// SPDX-License-Identifier: Apache-2.0
#include <gsh/cpu.hpp>
#include <gsh/image/image.hpp>
#include <gsh/loss/metrics.hpp>
#include <gsh/photo/photo_loss.hpp>

#include "support/gradient.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

constexpr int noise_width = 22, noise_height = 19;

/// A few splats, and a photograph of noise with a plate of noise.
template <class B>
struct NoisyPhoto {
    B backend;
    Splats<B, double> splats;
    std::vector<std::uint8_t> pixels, plate;
    Photo photo;

    explicit NoisyPhoto(bool with_plate = false, B where = B()) : backend(std::move(where)) {
        test::Rng rng(3);
        splats.resize(9);
        for (std::size_t i = 0; i < 9; ++i) {
            splats.means[i] = rng.vec(-0.4, 0.4);
            splats.colors[i] = rng.vec(0.1, 0.9);
            splats.opacities[i] = rng.uniform(0.3, 0.9);
            const double a = rng.uniform(0.01, 0.04), b = rng.uniform(0.01, 0.04), c = rng.uniform(0.01, 0.04);
            splats.covariances[i] = {a, 0.002, -0.001, b, 0.003, c};
        }
        for (int i = 0; i < 4 * noise_width * noise_height; ++i) {
            pixels.push_back(static_cast<std::uint8_t>(rng.uniform(1, 254)));
            plate.push_back(i % 4 == 3 ? 255 : static_cast<std::uint8_t>(rng.uniform(1, 254)));
        }
        photo = {
            "noise", {mat3<double>(1.0), {0.02, -0.03, 2}, 24, 25, 10.7, 9.6, noise_width, noise_height}, 0, pixels};
        if (with_plate) photo.plate = plate;
    }
    [[nodiscard]] Camera<double> camera() const { return photo.camera; }
    [[nodiscard]] SplatView<const double> view() const { return splats.view(); }

    double loss(PhotoLoss<B, double>& loss) const { return loss_from(loss, camera()); }
    double loss_from(PhotoLoss<B, double>& loss, const Camera<double>& where) const {
        loss.set_photo(photo);
        loss.render(where, view());
        loss.compare();
        return loss.loss();
    }
};

using NoiseLoss = PhotoLoss<cpu::Serial, double>;

/// Numbers of splats, attribute after attribute.
template <class B>
std::vector<double> splat_numbers(Splats<B, double>& splats) {
    std::vector<double> all;
    for (std::size_t i = 0; i < splats.means.size(); ++i) {
        for (const double x : test::scalars(splats.means[i])) all.push_back(x);
        for (const double x : test::scalars(splats.covariances[i])) all.push_back(x);
        for (const double x : test::scalars(splats.colors[i])) all.push_back(x);
        all.push_back(splats.opacities[i]);
    }
    return all;
}

} // namespace

TEST_CASE("the loss is made of L1, SSIM and the mask's mean difference") {
    for (const bool with_plate : {false, true}) {
        NoisyPhoto<cpu::Serial> noise(with_plate);
        NoiseLoss l1(noise.backend, {.ssim_weight = 0, .background = {0.2, 0.4, 0.6}}),
            both(noise.backend, {.ssim_weight = 0.3, .background = {0.2, 0.4, 0.6}}),
            masked(noise.backend, {.ssim_weight = 0.3, .mask_weight = 0.5, .background = {0.2, 0.4, 0.6}});
        const double l1_loss = noise.loss(l1), both_loss = noise.loss(both), masked_loss = noise.loss(masked);
        const double psnr_of_step = both.psnr(), photometric = masked.values().loss;
        Image<double> color, alpha, truth, mask;
        both.picture(noise.photo, noise.view(), color, &alpha);
        both.photograph(noise.photo, truth, mask);
        double difference = 0, mask_difference = 0;
        for (std::size_t i = 0; i < color.data.size(); ++i) difference += std::abs(color.data[i] - truth.data[i]);
        for (std::size_t i = 0; i < mask.data.size(); ++i) mask_difference += std::abs(alpha.data[i] - mask.data[i]);
        difference /= 3 * noise_width * noise_height, mask_difference /= noise_width * noise_height;
        CHECK(l1_loss == doctest::Approx(difference));
        const SsimLoss<cpu::Serial, double> ssim_loss(noise.backend);
        PhotometricLoss<cpu::Serial, double>::Cache cache;
        ssim_loss.forward(std::as_const(color).view(), std::as_const(truth).view(), cache);
        CHECK(both_loss == doctest::Approx(0.7 * difference + 0.3 * ssim_loss.values(cache).loss));
        CHECK(photometric == both_loss);
        CHECK(masked_loss == doctest::Approx(both_loss + 0.5 * mask_difference));
        CHECK(psnr_of_step == doctest::Approx(psnr(color.view(), truth.view())));
    }
}

TEST_CASE("splats and photograph stand before the plate where there is one, else before the background") {
    NoisyPhoto<cpu::Serial> noise(true);
    NoiseLoss loss(noise.backend, {.background = {0.2, 0.4, 0.6}});
    for (std::size_t i = 3; i < noise.pixels.size(); i += 4) noise.pixels[i] = 0; // empty: alpha is 0 everywhere
    for (double& opacity : noise.splats.opacities) opacity = 0;
    Image<double> color, truth, mask;
    loss.picture(noise.photo, noise.view(), color);
    loss.photograph(noise.photo, truth, mask);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < noise_height; ++y)
            for (int x = 0; x < noise_width; ++x) {
                const double behind = noise.plate[static_cast<std::size_t>(4 * (y * noise_width + x) + c)] / 255.0;
                CHECK(color.at(c, y, x) == doctest::Approx(behind));
                CHECK(truth.at(c, y, x) == doctest::Approx(behind));
            }
    for (const double share : mask.data) CHECK(share == 0);
    loss.picture(noise.photo.camera, noise.view(), color); // from a camera, without a photograph
    CHECK(color.at(1, 3, 3) == doctest::Approx(0.4));
    noise.photo.plate = {};
    loss.photograph(noise.photo, truth, mask);
    CHECK(truth.at(2, 3, 3) == doctest::Approx(0.6));
    // Nothing is opaque, so photograph and render both show the background that was set with the photograph.
    loss.set_photo(noise.photo, {1, 0, 0});
    loss.render(noise.photo.camera, noise.view());
    loss.compare();
    CHECK(loss.values().l1 < 1e-12);
    loss.photograph(noise.photo, truth, mask); // pictures always have the background of the parameters
    CHECK(truth.at(2, 3, 3) == doctest::Approx(0.6));
}

TEST_CASE("at unknown pixels the photograph stays as it is, and splats lie over the estimated background") {
    for (const bool with_plate : {false, true}) {
        CAPTURE(with_plate);
        NoisyPhoto<cpu::Serial> noise(with_plate);
        const std::vector<UnknownPixel> unknown{{30, {10, 20, 30}}, {205, {200, 100, 50}}};
        noise.photo.unknown = unknown;
        NoiseLoss loss(noise.backend, {.background = {0.2, 0.4, 0.6}});
        Image<double> with, without, truth, plain, mask;
        loss.picture(noise.photo, noise.view(), with);
        loss.photograph(noise.photo, truth, mask);
        for (double& opacity : noise.splats.opacities) opacity = 0;
        Image<double> empty;
        loss.picture(noise.photo, noise.view(), empty);
        noise.photo.unknown = {};
        loss.picture(noise.photo, noise.view(), without);
        loss.photograph(noise.photo, plain, mask);
        for (int c = 0; c < 3; ++c)
            for (std::uint32_t i = 0; i < noise_width * noise_height; ++i) {
                const auto found = std::find_if(unknown.begin(), unknown.end(), [&](auto& u) { return u.index == i; });
                const auto channel = static_cast<std::size_t>(c);
                const std::size_t at = channel * noise_width * noise_height + i;
                if (found == unknown.end()) {
                    CHECK(truth.data[at] == plain.data[at]);
                    CHECK(empty.data[at] == without.data[at]);
                } else {
                    CHECK(truth.data[at] == doctest::Approx(noise.pixels[4 * i + channel] / 255.0));
                    CHECK(empty.data[at] == doctest::Approx(found->background[channel] / 255.0));
                }
            }
    }
    NoisyPhoto<cpu::Serial> noise;
    const std::vector<UnknownPixel> outside{{noise_width * noise_height, {}}};
    noise.photo.unknown = outside;
    CHECK_THROWS_AS(check_photo("test", noise.photo, 1), ValueError);
    noise.photo.unknown = {};
    CHECK_NOTHROW(check_photo("test", noise.photo, 1));
    for (const double weight : {-0.1, 1.1}) {
        noise.photo.weight = weight;
        CHECK_THROWS_AS(check_photo("test", noise.photo, 1), ValueError);
    }
}

TEST_CASE("hidden pixels are not compared, and give the render no gradient") {
    for (const bool half_chroma : {false, true}) {
        CAPTURE(half_chroma);
        NoisyPhoto<cpu::Serial> noise;
        noise.photo.half_chroma = half_chroma;
        std::vector<UnknownPixel> unknown{{30, {10, 20, 30}}};
        for (std::uint32_t i = 180; i < 200; ++i) unknown.push_back({i, {}, 1});
        noise.photo.unknown = unknown;
        NoiseLoss loss(noise.backend, {.ssim_weight = 0.3, .mask_weight = 0.5, .background = {0.2, 0.4, 0.6}});
        const double before = noise.loss(loss);
        for (const UnknownPixel& pixel : unknown) // what is seen there does not matter
            if (pixel.hidden)
                for (std::size_t c = 0; c < 4; ++c)
                    noise.pixels[4 * pixel.index + c] = static_cast<std::uint8_t>(70 * c);
        CHECK(noise.loss(loss) == before);
        noise.pixels[4 * 30] ^= 255;
        CHECK(noise.loss(loss) != before);

        // L1 and mask: the adjoint is the gradient. (A window of SSIM that overlaps hidden pixels sees a photograph that
        // follows the render, which the adjoint leaves out.)
        NoiseLoss plain(noise.backend, {.ssim_weight = 0, .mask_weight = 0.5, .background = {0.2, 0.4, 0.6}});
        Splats<cpu::Serial, double> dL_dsplats;
        dL_dsplats.resize(9);
        fill_zero(noise.backend, dL_dsplats.view());
        noise.loss(plain);
        plain.backward(noise.camera(), noise.view(), dL_dsplats.view());
        constexpr double scale = noise_width * noise_height;
        for (std::size_t i = 0; i < 9; ++i) {
            const auto colors = test::scalars(dL_dsplats.colors[i]);
            std::vector<double> scaled(colors.begin(), colors.end());
            for (double& g : scaled) g *= scale;
            test::check_gradient([&] { return scale * noise.loss(plain); }, test::scalars(noise.splats.colors[i]),
                                 Span<const double>(scaled), {.step = 1e-6, .tolerance = 2e-6});
        }

        // With every pixel hidden there is nothing to learn, with SSIM, too.
        unknown.clear();
        for (std::uint32_t i = 0; i < noise_width * noise_height; ++i) unknown.push_back({i, {}, 1});
        noise.photo.unknown = unknown;
        fill_zero(noise.backend, dL_dsplats.view());
        CHECK(std::abs(noise.loss(loss)) < 1e-12);
        loss.backward(noise.camera(), noise.view(), dL_dsplats.view());
        for (const double number : splat_numbers(dL_dsplats)) CHECK(number == 0);
    }
}

TEST_CASE("a cropped photograph gives the loss, the gradient and the pictures of the whole, bit for bit") {
    for (const bool with_plate : {false, true}) {
        CAPTURE(with_plate);
        NoisyPhoto<cpu::Serial> noise(with_plate);
        for (int y = 0; y < noise_height; ++y)
            for (int x = 0; x < noise_width; ++x)
                if (!PixelBox{6, 4, 9, 11}.contains(x, y)) noise.pixels[std::size_t(4 * (y * noise_width + x) + 3)] = 0;
        const std::vector<UnknownPixel> unknown{{3 * noise_width + 7, {10, 20, 30}}, {205, {200, 100, 50}}};
        noise.photo.unknown = unknown;
        const auto results = [&] {
            NoiseLoss loss(noise.backend, {.mask_weight = 0.3, .background = {0.2, 0.4, 0.6}});
            Splats<cpu::Serial, double> gradient;
            gradient.resize(noise.splats.means.size());
            fill_zero(noise.backend, gradient.view());
            std::vector<double> numbers{noise.loss(loss)};
            loss.backward(noise.camera(), noise.view(), gradient.view());
            Image<double> truth, mask;
            loss.photograph(noise.photo, truth, mask);
            for (const auto& more : {splat_numbers(gradient), truth.data, mask.data})
                numbers.insert(numbers.end(), more.begin(), more.end());
            return numbers;
        };
        const std::vector<double> whole = results();
        const std::vector<std::uint8_t> before(noise.photo.rgba.begin(), noise.photo.rgba.end());
        const std::vector<std::uint8_t> cropped = crop_photo(noise.photo);
        CHECK(*noise.photo.box == PixelBox{6, 3, 9, 12}); // with the unknown pixel above the mask
        CHECK(noise.photo.rgba.data() == cropped.data());
        CHECK_NOTHROW(check_photo("test", noise.photo, 1));
        noise.pixels.assign(noise.pixels.size(), 99); // the whole is not read any more
        CHECK(results() == whole);
        const std::vector<std::uint8_t> again = whole_photo(noise.photo);
        for (std::size_t i = 0; i < before.size(); i += 4) {
            const int x = static_cast<int>(i / 4) % noise_width, y = static_cast<int>(i / 4) / noise_width;
            const bool inside = noise.photo.box->contains(x, y);
            for (std::size_t c = i; c < i + 4; ++c) {
                CHECK(again[c] == (inside ? before[c] : 0));
                CHECK(noise.photo.pixel(x, y)[c - i] == again[c]);
            }
        }
        CHECK_THROWS_AS((void)crop_photo(noise.photo), ShapeError); // it is no whole photograph
        noise.photo.box->width += 1;
        CHECK_THROWS_AS(check_photo("test", noise.photo, 1), ShapeError);
        noise.photo.box = PixelBox{20, 3, 9, 12};
        CHECK_THROWS_AS(check_photo("test", noise.photo, 1), ValueError);
        noise.photo.box = PixelBox{6, 4, 9, 12};
        CHECK_THROWS_AS(check_photo("test", noise.photo, 1), ValueError); // the first unknown pixel is outside
    }
}

TEST_CASE("with half chroma the render is compared as the codec would have kept it") {
    NoisyPhoto<cpu::Serial> noise;
    NoiseLoss loss(noise.backend, {.ssim_weight = 0});
    Image<double> color, truth, mask;
    loss.picture(noise.photo, noise.view(), color);
    loss.photograph(noise.photo, truth, mask);
    HalfChroma<cpu::Serial, double> half(noise.backend);
    half.forward(color.view(), color.view());
    double l1 = 0;
    for (std::size_t i = 0; i < color.data.size(); ++i) l1 += std::abs(color.data[i] - truth.data[i]);
    const double full = noise.loss(loss);
    noise.photo.half_chroma = true;
    CHECK(noise.loss(loss) == doctest::Approx(l1 / (3 * noise_width * noise_height)));
    CHECK(noise.loss(loss) != full);
}

TEST_CASE("the adjoint is the gradient of the loss with respect to splats and camera, and adds") {
    for (const double mask_weight : {0.0, 0.5}) {
        CAPTURE(mask_weight);
        NoisyPhoto<cpu::Serial> noise(mask_weight > 0);
        noise.photo.half_chroma = mask_weight > 0;
        NoiseLoss loss(noise.backend,
                       {.filter = {.dilation = 0.1, .compensate_opacity = true}, .mask_weight = mask_weight});
        Splats<cpu::Serial, double> dL_dsplats;
        dL_dsplats.resize(9);
        fill_zero(noise.backend, dL_dsplats.view());
        std::vector<CameraGradient<double>> dL_dcamera(1);
        const auto backward = [&] {
            noise.loss(loss);
            loss.backward(noise.camera(), noise.view(), dL_dsplats.view(), dL_dcamera);
        };
        backward();
        // The loss is a mean; scaled, so that the tolerance of 1e-6 is strict.
        constexpr double scale = noise_width * noise_height;
        const auto value = [&] { return scale * noise.loss(loss); };
        const auto check = [&](Span<double> x, Span<const double> dL_dx) {
            std::vector<double> scaled(dL_dx.begin(), dL_dx.end());
            for (double& g : scaled) g *= scale;
            test::check_gradient(value, x, Span<const double>(scaled), {.step = 1e-6, .tolerance = 2e-6});
        };
        for (std::size_t i = 0; i < 9; ++i) {
            CAPTURE(i);
            check(test::scalars(noise.splats.means[i]), test::scalars(dL_dsplats.means[i]));
            check(test::scalars(noise.splats.covariances[i]), test::scalars(dL_dsplats.covariances[i]));
            check(test::scalars(noise.splats.colors[i]), test::scalars(dL_dsplats.colors[i]));
            check({&noise.splats.opacities[i], 1}, {&dL_dsplats.opacities[i], 1});
        }
        check(test::scalars(noise.photo.camera.t), test::scalars(dL_dcamera[0].dL_dt));
        check({&noise.photo.camera.fx, 1}, {&dL_dcamera[0].dL_dfx, 1});

        const auto once = splat_numbers(dL_dsplats);
        const vec3<double> once_t = dL_dcamera[0].dL_dt;
        backward();
        const auto twice = splat_numbers(dL_dsplats);
        for (std::size_t i = 0; i < once.size(); ++i) CHECK(twice[i] == doctest::Approx(2 * once[i]));
        CHECK(length(dL_dcamera[0].dL_dt - 2.0 * once_t) <= 1e-12 * length(once_t));

        noise.photo.weight = 0.25;
        backward();
        const auto weighted = splat_numbers(dL_dsplats);
        for (std::size_t i = 0; i < once.size(); ++i) CHECK(weighted[i] == doctest::Approx(2.25 * once[i]));
    }
}

TEST_CASE("the camera that is rendered from need not be the photograph's own") {
    NoisyPhoto<cpu::Serial> noise;
    NoiseLoss loss(noise.backend);
    const double own = noise.loss(loss);
    Camera<double> moved = noise.camera();
    moved.t.x += 0.1;
    CHECK(noise.loss_from(loss, moved) != own);
    noise.photo.camera = moved;
    const double there = noise.loss(loss);
    CHECK(there != own);
}

TEST_CASE("losses and gradients are the same on threads bit for bit") {
    const auto run = [](auto where) {
        using B = decltype(where);
        NoisyPhoto<B> noise(true, std::move(where));
        PhotoLoss<B, double> loss(noise.backend, {.mask_weight = 0.5});
        Splats<B, double> dL_dsplats;
        dL_dsplats.resize(9);
        fill_zero(noise.backend, dL_dsplats.view());
        std::vector<double> all{noise.loss(loss)};
        loss.backward(noise.camera(), noise.view(), dL_dsplats.view());
        const auto gradient = splat_numbers(dL_dsplats);
        all.insert(all.end(), gradient.begin(), gradient.end());
        return all;
    };
    const auto expected = run(cpu::Serial());
    for (const std::size_t threads : {1, 2, 5}) CHECK(run(cpu::Threads(threads)) == expected);
}

TEST_CASE("pictures of several sizes follow each other") {
    NoisyPhoto<cpu::Serial> noise;
    NoiseLoss loss(noise.backend);
    const double first = noise.loss(loss);
    Camera<double> other = noise.camera();
    other.width = 7, other.height = 40;
    Image<double> color, alpha;
    loss.picture(other, noise.view(), color, &alpha);
    CHECK(color.data.size() == 3 * 7 * 40);
    CHECK(alpha.data.size() == 7 * 40);
    CHECK(noise.loss(loss) == first);
}

TEST_CASE("settings that cannot be are refused") {
    cpu::Serial backend;
    CHECK_THROWS_AS(NoiseLoss(backend, {.mask_weight = -1}), ValueError);
}
