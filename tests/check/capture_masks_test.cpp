// SPDX-License-Identifier: Apache-2.0
/// Masks of stored images are those of the images, are read as rarely as the memory allows, and give the same check.
#include <gsh/check/capture_check.hpp>
#include <gsh/check/capture_masks.hpp>
#include <gsh/check/silhouette.hpp>

#include "check/box_scene.hpp"
#include "support/held_images.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>

using namespace gsh;
using namespace gsh::test::boxes;

namespace {

void check_same(const Silhouette& a, const Silhouette& b) {
    CHECK(a.height == b.height);
    CHECK(a.width == b.width);
    CHECK(a.inside == b.inside);
}

/// The number of images that are read when all masks of the scene are asked for twice at each of two sizes.
std::size_t reads_within(std::uint64_t memory) {
    Capture capture = scene().capture;
    invert(capture.images[0]); // begins inside
    const Capture held = capture;
    const std::shared_ptr<const test::HeldImages> images = test::store_images(capture, memory);
    const CaptureMasks masks(capture), of_held(held);
    for (const int reduction : {1, 7, 1, 7})
        for (const CaptureView& view : held.views(false)) {
            const Silhouette expected = mask_silhouette(held.image(view), reduction);
            check_same(masks.reduced(view, reduction), expected);
            check_same(of_held.reduced(view, reduction), expected);
        }
    return images->reads();
}

void check_same(const CaptureCheck& a, const CaptureCheck& b) {
    CHECK(texts(a) == texts(b));
    CHECK(a.reading.motions == b.reading.motions);
    CHECK(a.reading.cameras == b.reading.cameras);
    REQUIRE(a.views.size() == b.views.size());
    for (std::size_t i = 0; i < a.views.size(); ++i) {
        CHECK(a.views[i].mask == b.views[i].mask);
        CHECK(a.views[i].iou == b.views[i].iou);
        CHECK(a.views[i].missing == b.views[i].missing);
        CHECK(a.views[i].stops == b.views[i].stops);
        CHECK(a.views[i].background_removed == b.views[i].background_removed);
    }
}

/// The number of images that have an exposure.
std::ptrdiff_t exposed(const CaptureCheck& result) {
    return std::count_if(result.views.begin(), result.views.end(), [](const ViewCheck& v) { return v.stops; });
}

} // namespace

TEST_CASE("masks of stored images: read once for each size, or each time without memory") {
    const std::size_t count = scene().capture.images.size();
    CHECK(reads_within(1 << 20) == 2 * count);
    CHECK(reads_within(0) == 4 * count);
    const std::size_t some = reads_within(20'000); // what fits is not found again, because all come in turn
    CHECK(some > 2 * count);
    CHECK(some <= 4 * count);
}

TEST_CASE("a capture of stored images has the check of the same in memory") {
    Capture good = scene().capture;
    for (PixelImage& image : good.images) // something to look at
        for (std::size_t i = 0; i < image.data.size(); ++i)
            if (i % 4 != 3) image.data[i] = static_cast<std::uint8_t>(40 + i / 4 % 150);
    for (std::size_t i = 0; i < 4; ++i) good.images[1].data[i] = 0; // all others have a background
    Capture mirrored = good;
    for (PixelImage& image : mirrored.images) mirror(image);
    for (const Capture* held : {&good, &mirrored}) {
        const bool faulty = held == &mirrored;
        const CaptureCheck expected = check(*held);
        CHECK(expected.findings.empty() != faulty);
        CHECK((exposed(expected) > 20) != faulty);
        for (const std::uint64_t memory : {1 << 20, 0}) {
            Capture capture = *held;
            const std::shared_ptr<const test::HeldImages> images = test::store_images(capture, memory);
            check_same(check(capture), expected);
            // The photographs' colours are looked up as well where there is no fault.
            if (memory > 0) CHECK(images->reads() == (faulty ? 1 : 2) * held->images.size());
        }
    }
}
