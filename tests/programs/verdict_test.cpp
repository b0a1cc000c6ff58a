// SPDX-License-Identifier: Apache-2.0
/// @file  The verdict on an avatar: the sentence, and what it advises.
#include <doctest/doctest.h>

#include "reconstruct/verdict.hpp"

#include <cmath>
#include <string>

namespace {

using namespace gsh::programs;

VerdictInput good_avatar() {
    VerdictInput input{.person = 29, .face = 32, .hands = 26};
    input.gaussians = 170000, input.unseen = 900, input.refined = false;
    input.steps = input.usual_steps = 3000;
    return input;
}

bool advises(const Verdict& verdict, const std::string& words) {
    for (const Advice& advice : verdict.advice)
        if (advice.text.find(words) != std::string::npos) return true;
    return false;
}

TEST_CASE("verdict_of grades by the figure of the person") {
    VerdictInput input = good_avatar();
    CHECK(verdict_of(input).headline.starts_with("Good"));
    CHECK(verdict_of(input).advice.empty());
    input.person = 25;
    CHECK(verdict_of(input).headline.starts_with("Fair"));
    input.person = 18;
    CHECK(verdict_of(input).headline.starts_with("Poor"));
    input.person = INFINITY; // equal to every pixel
    CHECK(verdict_of(input).headline.starts_with("Good"));
    input.person = NAN;
    CHECK(verdict_of(input).headline == "No test image shows the person, so the avatar is not judged.");
    CHECK(verdict_of(input).advice.empty());
}

TEST_CASE("verdict_of advises what the figures show, and nothing else") {
    VerdictInput input = good_avatar();
    input.hands = 15.25;
    CHECK(verdict_of(input).advice.size() == 1);
    CHECK(advises(verdict_of(input), "The hands are weak, at 15.2 dB"));
    input = good_avatar();
    input.face = 20;
    CHECK(verdict_of(input).advice.size() == 1);
    CHECK(advises(verdict_of(input), "The face is weak"));
    input = good_avatar();
    input.face = input.hands = NAN; // a capture from behind, with mittens
    CHECK(verdict_of(input).advice.empty());
    input = good_avatar();
    input.unseen = 17000;
    CHECK(advises(verdict_of(input), "10% of the surface was seen by no photograph"));
    input = good_avatar();
    input.seen_motion = 30.0, input.new_motion = 26.5;
    CHECK(advises(verdict_of(input), "New motion is 3.5 dB worse"));
    input.new_motion = 28.0;
    CHECK(verdict_of(input).advice.empty());
    input = good_avatar();
    input.doubtful_frames = {3, 4, 5, 9};
    CHECK(advises(verdict_of(input), "Frames 3-5, 9 fit their photographs much worse"));
}

TEST_CASE("verdict_of names poses and length of a training only where the avatar is not good") {
    VerdictInput input = good_avatar();
    input.steps = 300;
    CHECK(verdict_of(input).advice.empty());
    input.person = 24;
    CHECK(advises(verdict_of(input), "--refine"));
    CHECK(advises(verdict_of(input), "300 steps. Continue with --resume --steps 3000."));
    input.usual_steps = 600; // half of them suffice
    CHECK(!advises(verdict_of(input), "300 steps"));
    input.refined = true, input.steps = 3000;
    CHECK(verdict_of(input).advice.empty());
}

} // namespace
