// SPDX-License-Identifier: Apache-2.0
/// The images that a check looks at are spread evenly over frames and cameras.
#include <gsh/check/capture_views.hpp>
#include <gsh/io/capture/capture_data.hpp>

#include <doctest/doctest.h>

#include <cstddef>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

using Pairs = std::vector<std::pair<std::size_t, std::size_t>>; // camera, frame

Pairs pairs(const std::vector<CaptureView>& views) {
    Pairs result;
    for (const CaptureView& view : views) result.emplace_back(view.camera, view.frame);
    return result;
}
/// All views of cameras with so many frames each.
std::vector<CaptureView> views_of(const std::vector<std::size_t>& frames) {
    std::vector<CaptureView> views;
    for (std::size_t c = 0; c < frames.size(); ++c)
        for (std::size_t f = 0; f < frames[c]; ++f) views.push_back({c, f});
    return views;
}

} // namespace

TEST_CASE("frames: all, or evenly spaced with the first and the last") {
    using Frames = std::vector<std::size_t>;
    CHECK(detail::spread_frames(4, 0) == Frames{0, 1, 2, 3});
    CHECK(detail::spread_frames(4, 9) == Frames{0, 1, 2, 3});
    CHECK(detail::spread_frames(9, 3) == Frames{0, 4, 8});
    CHECK(detail::spread_frames(9, 1) == Frames{4});
}

TEST_CASE("views: a number of each camera, evenly spaced") {
    const auto views = views_of({12, 2, 0, 6});
    CHECK(pairs(detail::spread_views(views, 4, 0)) ==
          Pairs{{0, 2}, {0, 6}, {0, 10}, {1, 0}, {1, 1}, {3, 1}, {3, 3}, {3, 5}});
    CHECK(detail::spread_views(views, 4, 400).size() == 20); // 12 of each at most
    CHECK(detail::spread_views(views_of({40}), 1, 400).size() == 12);

    CHECK(pairs(detail::few_views(views, 4, 20)) == pairs(views));
    CHECK(pairs(detail::few_views(views, 4, 19)) == // 4 of each
          Pairs{{0, 1}, {0, 4}, {0, 7}, {0, 10}, {1, 0}, {1, 1}, {3, 0}, {3, 2}, {3, 3}, {3, 5}});
    CHECK(detail::few_views(views_of({40, 40}), 2, 60).size() == 60);
}
