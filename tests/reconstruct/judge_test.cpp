// SPDX-License-Identifier: Apache-2.0
/// Figures of regions and people: a picture with a known error in one of them.
#include "reconstruct/small_people.hpp"

#include <gsh/cpu.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/reconstruct/judge.hpp>

#include <doctest/doctest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

using namespace gsh;
using test::small_input;

namespace {

/// A photograph and a render of it that is darker by 0.1 where `where` says so.
template <class Where>
Comparison<float> comparison_of(const Photo& photo, const Where& where) {
    const int height = photo.camera.height, width = photo.camera.width;
    Comparison<float> result{
        .score = {.name = photo.name}, .render = Image<float>(3, height, width), .truth = {}, .mask = {}};
    result.truth = result.render, result.mask = Image<float>(1, height, width);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            result.mask.at(0, y, x) = photo.pixel(x, y)[3] > 127 ? 1.0f : 0.0f;
            for (int c = 0; c < 3; ++c) {
                result.truth.at(c, y, x) = 0.5f;
                result.render.at(c, y, x) = where(y * width + x) ? 0.4f : 0.5f;
            }
        }
    return result;
}

} // namespace

TEST_CASE("an error in one region is in the figures of that region alone") {
    cpu::Threads backend(2);
    const ReconstructionInput input = small_input();
    Judge<cpu::Threads> judge(backend, input);
    const std::vector<Photo> photos = test_photos_of(input.capture);
    const std::vector<RegionLabels> labels = judge.labels_of(photos[0]);
    REQUIRE(labels.size() == 1);
    const auto in_face = [&](int i) { return labels[0].labels[static_cast<std::size_t>(i)] == 0; };
    const ImageScore score = judge.judge(comparison_of(photos[0], in_face), photos[0]).score;
    REQUIRE(score.regions.size() == judged_regions.size());
    CHECK(score.regions[0].psnr == doctest::Approx(20).epsilon(1e-5)); // 0.1 everywhere in the face
    CHECK(std::isinf(score.regions[1].psnr));
    CHECK(std::isinf(score.regions[2].psnr));
    CHECK(score.people.empty());
    CHECK(!score.lpips.has_value());
    CHECK(judge.lpips_protocol().empty());
}

TEST_CASE("each of two people has figures of their own") {
    cpu::Threads backend(2);
    const ReconstructionInput input = small_input(2);
    Judge<cpu::Threads> judge(backend, input);
    const std::vector<Photo> photos = test_photos_of(input.capture);
    const std::vector<RegionLabels> labels = judge.labels_of(photos[0]);
    REQUIRE(labels.size() == 2);
    const auto on_bob = [&](int i) { return labels[1].labels[static_cast<std::size_t>(i)] != RegionLabels::nothing; };
    const ImageScore score = judge.judge(comparison_of(photos[0], on_bob), photos[0]).score;
    REQUIRE(score.people.size() == 2);
    CHECK(score.people[0].whole.psnr > 25);
    CHECK(score.people[1].whole.psnr < 21);
    CHECK(score.people[1].whole.psnr > 19.99);

    // Given masks decide instead of the bodies.
    ReconstructionInput masked = input;
    masked.people[1].masks.resize(masked.capture.cameras.size() * masked.capture.frame_count());
    Image<std::uint8_t>& mask = masked.people[1].masks[photos[0].camera_index * masked.capture.frame_count()];
    mask = Image<std::uint8_t>(1, 64, 64);
    for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = labels[0].labels[i] != RegionLabels::nothing;
    Judge<cpu::Threads> by_mask(backend, masked);
    const ImageScore swapped = by_mask.judge(comparison_of(photos[0], on_bob), photos[0]).score;
    CHECK(swapped.people[1].whole.psnr > 25);
}
