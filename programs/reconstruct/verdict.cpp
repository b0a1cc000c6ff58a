// SPDX-License-Identifier: Apache-2.0
#include "reconstruct/verdict.hpp"

#include "common/figures.hpp"

#include <cmath>

namespace gsh::programs {

namespace {

constexpr double good_person = 27, fair_person = 23, good_face = 27, good_hands = 22; // dB

/// The grade, and what it looks like.
std::string grade(double person) {
    if (person >= good_person) return "Good: differences from the photographs show side by side, not at first sight.";
    if (person >= fair_person) return "Fair: the person is recognised at once, but details are soft.";
    return "Poor: details are lost, or parts are in the wrong place.";
}

} // namespace

Verdict verdict_of(const VerdictInput& input) {
    Verdict verdict;
    if (std::isnan(input.person)) {
        verdict.headline = "No test image shows the person, so the avatar is not judged.";
        return verdict;
    }
    verdict.headline = grade(input.person);
    const auto add = [&](const char* doubt, const std::string& text) { verdict.advice.push_back({doubt, text}); };
    const bool is_good = input.person >= good_person;
    if (!is_good && !input.refined)
        add("estimated-poses",
            "Poses were taken as they are. If they are estimates, --refine fits them to the photographs; wrong poses "
            "are the most frequent reason for a soft avatar. gsh-check shows whether they agree.");
    if (!is_good && 2 * input.steps < input.usual_steps)
        add("short-training", "Training was short, " + std::to_string(input.steps) + " steps. Continue with --resume " +
                                  "--steps " + std::to_string(input.usual_steps) + ".");
    if (!input.doubtful_frames.empty())
        add("doubtful-frames",
            "Frames " + frames_text(input.doubtful_frames) +
                " fit their photographs much worse than the others and hardly counted. Look at their poses and masks.");
    if (input.hands < good_hands)
        add("weak-hands", "The hands are weak, at " + fixed(input.hands, 1) +
                              " dB. Their poses decide: give the hands' poses, or --refine with --keypoints.");
    if (input.face < good_face)
        add("weak-face",
            "The face is weak, at " + fixed(input.face, 1) +
                " dB. It needs more pixels: film from nearer, or in a larger size, and use more --gaussians.");
    if (input.seen_motion && input.new_motion && *input.new_motion < *input.seen_motion - 3)
        add("weak-new-motion",
            "New motion is " + fixed(*input.seen_motion - *input.new_motion, 1) +
                " dB worse than seen motion. Film poses that are nearer to those that you will show.");
    if (input.gaussians > 0 && 50 * input.unseen > input.gaussians)
        add("unseen-surface",
            fixed(100 * static_cast<double>(input.unseen) / static_cast<double>(input.gaussians), 0) +
                "% of the surface was seen by no photograph, and its colours are guessed. Film from more sides.");
    return verdict;
}

} // namespace gsh::programs
