// SPDX-License-Identifier: Apache-2.0
#include <gsh/body/motion_span.hpp>

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <limits>
#include <vector>

using namespace gsh;

namespace {

using SpanFrames = std::vector<std::size_t>;

std::vector<double> ten_frames() { return {0, 1, 2, 3, 4, 5, 6, 7, 8, 9}; }

/// Frames 0 to 5 at times 3, 0, 5, 1, 4, 2: in time order they are 1, 3, 5, 0, 4, 2.
const std::vector<double> unsorted_times{3, 0, 5, 1, 4, 2};

} // namespace

TEST_CASE("a share is the last part of the motion in time, in whole frames") {
    CHECK(span_frames({.share = 0.3}, ten_frames()) == SpanFrames{7, 8, 9});
    CHECK(span_frames({.share = 0.34}, ten_frames()) == SpanFrames{7, 8, 9});
    CHECK(span_frames({.share = 0.25}, ten_frames()) == SpanFrames{7, 8, 9}); // 2.5 is rounded up
    CHECK(span_frames({.share = 0.05}, ten_frames()) == SpanFrames{9});
    CHECK(span_frames({.share = 0.94}, ten_frames()).size() == 9);
    CHECK(span_frames({.share = 0.5}, unsorted_times) == SpanFrames{0, 2, 4});
    CHECK(span_frames({.share = 1 / 3.0}, unsorted_times) == SpanFrames{2, 4});
}

TEST_CASE("from one frame to another includes both, and what lies between them in time") {
    CHECK(span_frames({.first = 0, .last = 0}, ten_frames()) == SpanFrames{0});
    CHECK(span_frames({.first = 3, .last = 5}, ten_frames()) == SpanFrames{3, 4, 5});
    CHECK(span_frames({.first = 1, .last = 9}, ten_frames()).size() == 9);
    CHECK(span_frames({.first = 3, .last = 0}, unsorted_times) == SpanFrames{0, 3, 5}); // times 1, 2, 3
    CHECK(span_frames({.first = 0, .last = 2}, unsorted_times) == SpanFrames{0, 2, 4});
    const std::vector<double> equal{0, 1, 1, 1, 2};
    CHECK(span_frames({.first = 2, .last = 3}, equal) == SpanFrames{2, 3});
    CHECK(span_frames({.share = 0.6}, equal) == SpanFrames{2, 3, 4});
}

TEST_CASE("spans that are none, or everything, are refused by their name") {
    const auto refuse = [](MotionSpan span, std::initializer_list<std::string_view> said) {
        span.name = "the span";
        test::check_throws<ValueError>([&] { (void)span_frames(span, ten_frames()); }, said);
    };
    refuse({.share = -0.5}, {"the span", "-0.5", "above 0 and below 1"});
    refuse({.share = 1}, {"the span", "below 1"});
    refuse({.share = std::numeric_limits<double>::quiet_NaN()}, {"the span", "nan"});
    refuse({.share = 0.01}, {"the span", "none of 10 frames"});
    refuse({.share = 0.99}, {"the span", "all of 10 frames"});
    refuse({.first = 4, .last = 10}, {"the span", "frame 10 of 10 frames", "from 0 to 9"});
    refuse({.first = 5, .last = 4}, {"the span", "frame 5", "later than frame 4"});
    refuse({.first = 0, .last = 9}, {"the span", "all of 10 frames"});
    test::check_throws<ValueError>([] { (void)span_frames({.share = 0.5}, {}); }, {"none of 0 frames"});
    test::check_throws<ValueError>([] { (void)span_frames({.first = 0, .last = 0}, {}); }, {"frame 0 of 0 frames"});
}
