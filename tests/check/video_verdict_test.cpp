// SPDX-License-Identifier: Apache-2.0
/// @file  The verdict on a video: nothing for a good one, and the worst first for others.
#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <gsh/check/video_verdict.hpp>

#include <string>
#include <vector>

using namespace gsh;

namespace {

/// One slow turn of a person whose height is known.
VideoFacts good_turn() {
    return {.cameras = 1,
            .photographs = 72,
            .height = 1.78,
            .turn_degrees = -355,
            .pose_held = true,
            .turn_images = 72,
            .keypoints_beside = 0.012,
            .person_pixels = 480,
            .hands_found = 0.9};
}

std::vector<std::string> names_of(const VideoFacts& facts) {
    std::vector<std::string> names;
    for (const VideoDoubt& doubt : video_verdict(facts)) names.push_back(doubt.doubt);
    return names;
}

using Names = std::vector<std::string>;

} // namespace

TEST_CASE("a good turn has no doubts, and several calibrated cameras need no turn") {
    CHECK(video_verdict(good_turn()).empty());
    VideoFacts several = good_turn();
    several.cameras = 4, several.calibrated = true, several.pose_held = false, several.turn_degrees = 20;
    several.height.reset();
    CHECK(video_verdict(several).empty());
}

TEST_CASE("each fault has its sentence") {
    VideoFacts facts = good_turn();
    SUBCASE("a lost foot") {
        facts.lost[12] = 12;
        REQUIRE(names_of(facts) == Names{"lost-parts"});
        CHECK(video_verdict(facts)[0].text.starts_with("masks lose the left foot in 12 of 72 images"));
    }
    SUBCASE("a pose that changes") {
        facts.pose_held = false, facts.turn_degrees = 40;
        REQUIRE(names_of(facts) == Names{"no-turn"});
        CHECK(video_verdict(facts)[0].text.starts_with("arms and legs are guessed in depth"));
    }
    SUBCASE("half a turn") {
        facts.turn_degrees = 181, facts.turn_images = 36;
        REQUIRE(names_of(facts) == Names{"part-of-a-turn"});
        CHECK(video_verdict(facts)[0].text == test::contains("181 of 360"));
    }
    SUBCASE("a fast turn") {
        facts.turn_images = facts.photographs = 12;
        REQUIRE(names_of(facts) == Names{"fast-turn"});
        CHECK(video_verdict(facts)[0].text == test::contains("turn more slowly"));
    }
    SUBCASE("nobody") {
        facts.without_person = 9;
        CHECK(names_of(facts) == Names{"nobody-found"});
    }
    SUBCASE("far keypoints") {
        facts.keypoints_beside = 0.06;
        CHECK(names_of(facts) == Names{"body-beside-keypoints"});
    }
    SUBCASE("cut") {
        facts.cut = 3;
        CHECK(names_of(facts) == Names{"cut-person"});
    }
    SUBCASE("small") {
        facts.person_pixels = 150;
        CHECK(names_of(facts) == Names{"small-person"});
    }
    SUBCASE("no hands") {
        facts.hands_found = 0.2;
        CHECK(names_of(facts) == Names{"few-hands"});
    }
    SUBCASE("no height") {
        facts.height.reset();
        CHECK(names_of(facts) == Names{"unknown-height"});
    }
}

TEST_CASE("the worst comes first, and of many parts the most frequent three") {
    VideoFacts facts = good_turn();
    facts.height.reset();
    facts.keypoints_beside = 0.07;
    facts.lost = {2, 0, 5, 0, 0, 0, 30, 0, 0, 0, 0, 0, 12, 0};
    CHECK(names_of(facts) ==
          Names{"body-beside-keypoints", "lost-parts", "lost-parts", "lost-parts", "unknown-height"});
    const auto doubts = video_verdict(facts);
    CHECK(doubts[1].text == test::contains("left hand in 30"));
    CHECK(doubts[2].text == test::contains("left foot in 12"));
    CHECK(doubts[3].text == test::contains("left upper arm in 5"));
    for (std::size_t i = 1; i < doubts.size(); ++i) CHECK(doubts[i - 1].weight >= doubts[i].weight);
    for (const VideoDoubt& doubt : doubts) CHECK(doubt.text.find('\n') == std::string::npos);
}
