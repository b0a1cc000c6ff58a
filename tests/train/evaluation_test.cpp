// SPDX-License-Identifier: Apache-2.0
#include <gsh/train/evaluation.hpp>

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

using namespace gsh;

namespace {

constexpr double equal_images = std::numeric_limits<double>::infinity();

ImageScore scored(double psnr, double ssim, double psnr_person) {
    return {.name = "any", .psnr = psnr, .ssim = ssim, .psnr_person = psnr_person};
}

/// A scene whose pictures are 0.6 at each of 12 x 12 pixels. The photograph has 0.5, and 0.1 in its two middle columns,
/// which show the person.
struct GrayTrainer {
    using Scalar = double;
    static constexpr int size = 12;
    bool without_person = false;
    std::size_t frame = 0; ///< the frame that was rendered last

    void render(const Photo& photo, Image<double>& image) {
        frame = photo.frame;
        image = Image<double>(3, size, size);
        for (double& value : image.data) value = 0.6;
    }
    void photo_pixels(const Photo&, Image<double>& image, Image<double>& alpha) const {
        image = Image<double>(3, size, size), alpha = Image<double>(1, size, size);
        for (int c = 0; c < 3; ++c)
            for (int y = 0; y < size; ++y)
                for (int x = 0; x < size; ++x) image.at(c, y, x) = person(x) ? 0.1 : 0.5;
        for (int y = 0; y < size; ++y)
            for (int x = 0; x < size; ++x) alpha.at(0, y, x) = person(x) ? 0.6 : 0.5; // exactly 1/2 is not inside
    }

private:
    [[nodiscard]] bool person(int x) const { return !without_person && (x == 5 || x == 6); }
};

/// Photographs of the cameras at the frames, camera by camera, without pixels.
std::vector<Photo> photos_at(const std::vector<std::size_t>& cameras, const std::vector<std::size_t>& frames) {
    std::vector<Photo> photos;
    for (const std::size_t camera : cameras)
        for (const std::size_t frame : frames) {
            photos.emplace_back();
            photos.back().name = std::to_string(camera) + "_" + std::to_string(frame);
            photos.back().camera_index = camera, photos.back().frame = frame;
        }
    return photos;
}

} // namespace

TEST_CASE("a mean is the mean of each figure, LPIPS only where it was asked for") {
    std::vector<ImageScore> scores{scored(20, 0.5, 10), scored(30, 0.75, 20), scored(40, 0.25, 60)};
    const ImageScore mean = mean_score(scores);
    CHECK(mean.name == "mean");
    CHECK(mean.psnr == doctest::Approx(30));
    CHECK(mean.ssim == doctest::Approx(0.5));
    CHECK(mean.psnr_person == doctest::Approx(30));
    CHECK(!mean.lpips);
    for (std::size_t i = 0; i < 3; ++i) scores[i].lpips = 0.1 * static_cast<double>(i * i); // 0, 0.1, 0.4
    REQUIRE(mean_score(scores).lpips);
    CHECK(*mean_score(scores).lpips == doctest::Approx(0.5 / 3));
    scores[2].lpips.reset();
    CHECK(!mean_score(scores).lpips); // there is no mean if an image lacks LPIPS

    CHECK(mean_score({scored(equal_images, 1, 30), scored(20, 1, 30)}).psnr == equal_images);
    const ImageScore none = mean_score({});
    for (const double figure : {none.psnr, none.ssim, none.psnr_person}) CHECK(std::isnan(figure));
    CHECK(!none.lpips);
}

TEST_CASE("a region's mean counts the images that show at least fifty pixels of it") {
    std::vector<ImageScore> scores(4);
    const RegionScore unseen{};
    scores[0].regions = {{.pixels = 50, .windows = 50, .psnr = 20, .ssim = 0.5}, unseen};
    scores[1].regions = {{.pixels = 49, .windows = 49, .psnr = 99, .ssim = 0.9}, unseen};
    scores[2].regions = {{.pixels = 900, .windows = 10, .psnr = 26, .ssim = 0.7}, unseen};
    scores[3].regions = {{.pixels = 60, .windows = 0, .psnr = equal_images}, unseen};
    const auto means = mean_regions(scores);
    REQUIRE(means.size() == 2);
    CHECK(means[0].images == 3);
    CHECK(means[0].equal == 1);
    CHECK(means[0].psnr == doctest::Approx(23));
    CHECK(means[0].ssim == doctest::Approx(0.6));
    CHECK(means[1].images == 0);
    CHECK(std::isnan(means[1].psnr));
    CHECK(std::isnan(means[1].ssim));
    CHECK(mean_regions({}).empty());
    CHECK(mean_regions(std::vector<ImageScore>(2)).empty());
}

TEST_CASE("each person has their own mean, as a whole and by region") {
    const auto of = [](std::size_t pixels, double psnr) {
        return RegionScore{.pixels = pixels, .windows = pixels, .psnr = psnr, .ssim = psnr / 100};
    };
    std::vector<ImageScore> scores(2);
    scores[0].people = {{.whole = of(100, 20), .regions = {of(60, 10), of(70, 11)}}, {.whole = of(100, 30)}};
    scores[1].people = {{.whole = of(200, 24), .regions = {of(10, 90), of(80, 15)}}, {.whole = of(20, 90)}};
    const auto means = mean_people(scores);
    REQUIRE(means.size() == 2);
    CHECK(means[0].whole.images == 2);
    CHECK(means[0].whole.psnr == doctest::Approx(22)); // images have equal weight, regardless of their number of pixels
    CHECK(means[0].whole.ssim == doctest::Approx(0.22));
    REQUIRE(means[0].regions.size() == 2);
    CHECK(means[0].regions[0].images == 1);
    CHECK(means[0].regions[0].psnr == doctest::Approx(10));
    CHECK(means[0].regions[1].images == 2);
    CHECK(means[0].regions[1].psnr == doctest::Approx(13));
    CHECK(means[1].whole.images == 1);
    CHECK(means[1].whole.psnr == doctest::Approx(30));
    CHECK(means[1].regions.empty());
    CHECK(mean_people({}).empty());
    CHECK(mean_people(std::vector<ImageScore>(2)).empty());
}

TEST_CASE("a photograph is compared with its own frame, whole and where its person is") {
    GrayTrainer trainer;
    Photo photo;
    photo.name = "cam3_0007", photo.frame = 7;
    const Comparison<double> compared = compare(trainer, photo);
    CHECK(trainer.frame == 7);
    CHECK(compared.score.name == "cam3_0007");
    CHECK(compared.render.data[0] == 0.6);
    CHECK(compared.truth.data[0] == 0.5);
    CHECK(compared.mask.data[5] == 0.6);
    // Two columns of twelve are off by 0.5, ten by 0.1: a mean square of (2 · 0.25 + 10 · 0.01) / 12 = 0.05.
    CHECK(compared.score.psnr == doctest::Approx(-10 * std::log10(0.05)));
    CHECK(compared.score.psnr_person == doctest::Approx(-10 * std::log10(0.25)));
    CHECK(!compared.score.lpips);
    CHECK(compared.score.regions.empty());
    CHECK(compared.score.people.empty());

    const std::vector<UnknownPixel> hidden{{5, {}, 1}};
    photo.unknown = hidden;
    const Comparison<double> without = compare(trainer, photo);
    CHECK(without.mask.data[5] == 0);
    CHECK(without.mask.data[4] == compared.mask.data[4]);
    for (std::size_t c = 0; c < 3; ++c) {
        const std::size_t at = c * without.mask.data.size() + 5;
        CHECK(without.truth.data[at] == without.render.data[at]);
    }
    CHECK(without.score.psnr > compared.score.psnr);

    trainer.without_person = true;
    CHECK_THROWS_AS((void)compare(trainer, photo), ValueError);
}

TEST_CASE("the similarity of two flat pictures is that of their means alone") {
    struct Flat : GrayTrainer {
        void photo_pixels(const Photo&, Image<double>& image, Image<double>& alpha) const {
            image = Image<double>(3, size, size), alpha = Image<double>(1, size, size);
            for (double& value : image.data) value = 0.5;
            for (double& value : alpha.data) value = 1;
        }
    } trainer;
    const ImageScore score = compare(trainer, Photo()).score;
    CHECK(score.psnr == doctest::Approx(20)); // off by 0.1 everywhere
    CHECK(score.psnr_person == doctest::Approx(20));
    CHECK(score.ssim == doctest::Approx((2 * 0.5 * 0.6 + 1e-4) / (0.25 + 0.36 + 1e-4))); // C₁ = 0.01²
}

TEST_CASE("test photographs are sorted by whether training saw their motion") {
    using Indices = std::vector<std::size_t>;
    const std::vector<double> times{0, 1, 2, 3, 4, 5};
    const Indices span{4, 5}, all{0, 1, 2, 3, 4, 5};
    // Cameras 0 and 1 train, camera 2 tests.
    MotionSplit split = split_by_motion(photos_at({0, 1}, {0, 1, 2, 3}), photos_at({2}, all), span, times);
    CHECK(split.seen == Indices{0, 1, 2, 3});
    CHECK(split.unseen == Indices{4, 5});
    CHECK(!split.between);

    // A frame of the span that the training cameras show in the test, too, is judged by the test camera; frame 1, which
    // neither training nor span has, is in neither list.
    std::vector<Photo> test = photos_at({2}, all);
    for (const Photo& photo : photos_at({0, 1}, {1, 4})) test.push_back(photo);
    split = split_by_motion(photos_at({0, 1}, {0, 2, 3}), test, span, times);
    CHECK(split.seen == Indices{0, 2, 3});
    CHECK(split.unseen == Indices{4, 5});

    // One camera: seen motion lies between frames in training. Frame 0 is before the first of these.
    split = split_by_motion(photos_at({0}, {1, 3}), photos_at({0}, {0, 2, 4, 5}), span, times);
    CHECK(split.between);
    CHECK(split.seen == Indices{1});
    CHECK(split.unseen == Indices{2, 3});
    split = split_by_motion(photos_at({0}, {0, 1, 2, 3}), photos_at({0}, span), span, times);
    CHECK(!split.between);
    CHECK(split.seen.empty());
    CHECK(split.unseen == Indices{0, 1});

    // Camera 2 judges seen motion but has no photograph of the span: the others judge new motion.
    test = photos_at({2}, {0, 1});
    test.push_back(photos_at({3}, {4})[0]);
    split = split_by_motion(photos_at({0}, {0, 1, 2, 3}), test, span, times);
    CHECK(split.seen == Indices{0, 1});
    CHECK(split.unseen == Indices{2});

    // Frames in another order than their times: 3 is the earliest, 0 between 3 and 5.
    const std::vector<double> shuffled{1, 4, 5, 0, 3, 2};
    split = split_by_motion(photos_at({0}, {3, 5}), photos_at({0}, {0, 1, 2, 4}), Indices{1, 2}, shuffled);
    CHECK(split.between);
    CHECK(split.seen == Indices{0});
    CHECK(split.unseen == Indices{1, 2});

    test::check_throws<ValueError>([&] { (void)split_by_motion(photos_at({0, 1}, {0, 4}), {}, span, times); },
                                   {"0_4", "for training", "left out"});
    test::check_throws<ValueError>([&] { (void)split_by_motion({}, photos_at({7}, {6}), span, times); },
                                   {"7_6", "frame 6", "6 frames"});
    test::check_throws<ValueError>([&] { (void)split_by_motion({}, {}, Indices{6}, times); }, {"span", "frame 6"});
}
