// SPDX-License-Identifier: Apache-2.0
/// @file  What a video of a person lacks for a good avatar, and how to film a better one: sentences, worst first.
#pragma once

#include <gsh/check/lost_parts.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

/// What detection, fit and check found out about a video. A photograph is one image of one camera.
struct VideoFacts {
    std::size_t cameras = 1, photographs = 0;
    bool calibrated = false;
    std::optional<double> height;   ///< metres, as the user gave it
    double turn_degrees = 0;        ///< how far the person turned
    bool pose_held = false;         ///< whether in one pose
    std::size_t turn_images = 0;    ///< images of one camera from which the turn was taken
    std::size_t without_person = 0; ///< photographs in which nobody was found
    std::size_t cut = 0;            ///< photographs beyond whose border more than 2% of the body lies
    double keypoints_beside = 0;    ///< metres, median of the camera that fits worst
    double person_pixels = 0;       ///< median height of the person
    double hands_found = 1;         ///< share of hands with keypoints
    std::array<std::size_t, body_part_names.size()> lost = {}; ///< photographs whose mask lacks the part
};

/// One thing that is doubtful about the video.
struct VideoDoubt {
    std::string doubt = {}; ///< its name: "lost-parts"
    double weight = 0;      ///< how much it spoils, in [0, 1]
    std::string text = {};  ///< one line: what was found, and what to do
};

/// The doubts about a video, the worst first; none if nothing is in the way of a good avatar.
[[nodiscard]] inline std::vector<VideoDoubt> video_verdict(const VideoFacts& facts);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// "3 of 72 images"
inline std::string images_text(std::size_t count, std::size_t all) {
    return std::to_string(count) + " of " + std::to_string(all) + " images";
}

inline std::string whole_number(double value) {
    return std::to_string(static_cast<long>(std::lround(value)));
}

/// What is doubtful about a turn before one camera.
inline void add_turn_doubts(const VideoFacts& facts, std::vector<VideoDoubt>& doubts) {
    if (facts.cameras > 1 || facts.calibrated) return;
    constexpr double whole_turn = 330, few_images = 24;
    const double turned = std::abs(facts.turn_degrees);
    if (!facts.pose_held && turned < whole_turn)
        doubts.push_back({"no-turn", 0.6,
                          "arms and legs are guessed in depth, and some sides were not seen: one camera sees no depth, "
                          "and the person turned by " +
                              whole_number(turned) + " degrees; film one slow turn in one pose"});
    else if (!facts.pose_held)
        doubts.push_back({"no-turn", 0.4,
                          "arms and legs are guessed in depth: one camera sees no depth, and the pose changed during "
                          "the turn; film one slow turn in one pose, arms off the body"});
    else if (turned < whole_turn)
        doubts.push_back({"part-of-a-turn", 0.4,
                          "some sides were not seen: the person turned by " + whole_number(turned) +
                              " of 360 degrees; film one whole turn"});
    const double a_turn = turned > 0 ? 360 / turned * static_cast<double>(facts.turn_images) : few_images;
    if (facts.pose_held && a_turn < few_images)
        doubts.push_back({"fast-turn", 0.5 * (1 - a_turn / few_images) + 0.1,
                          "the turn was fast: it has only " + whole_number(a_turn) +
                              " images; turn more slowly, in 10 seconds or more, or take more images with --fps"});
}

} // namespace detail

inline std::vector<VideoDoubt> video_verdict(const VideoFacts& facts) {
    std::vector<VideoDoubt> doubts;
    const auto share = [&](std::size_t count) {
        return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(1, facts.photographs));
    };
    const auto images = [&](std::size_t count) { return detail::images_text(count, facts.photographs); };

    if (facts.without_person > 0)
        doubts.push_back({"nobody-found", std::min(1.0, 0.1 + 2 * share(facts.without_person)),
                          "nobody was found in " + images(facts.without_person) +
                              ", which are left out; cut the video with --begin and --end, and use more light"});
    constexpr double far = 0.04; // metres: twice what detectors miss by
    if (facts.keypoints_beside > far)
        doubts.push_back({"body-beside-keypoints", 0.9,
                          "the body lies " + detail::whole_number(1e3 * facts.keypoints_beside) +
                              " mm beside the keypoints: the detector was wrong, or focal length or calibration are; "
                              "look at the keypoints of the stages"});
    if (facts.cut > 0)
        doubts.push_back({"cut-person", std::min(1.0, 0.2 + share(facts.cut)),
                          "the person is cut by the border of " + images(facts.cut) +
                              ": what was not filmed is not learned; keep the whole person in the picture"});
    std::vector<VideoDoubt> lost;
    for (std::size_t k = 0; k < body_part_names.size(); ++k)
        if (facts.lost[k] > 0)
            lost.push_back({"lost-parts", std::min(0.8, 0.05 + 1.5 * share(facts.lost[k])),
                            "masks lose the " + std::string(body_part_names[k]) + " in " + images(facts.lost[k]) +
                                "; these pixels are left out; film before a background of other colours"});
    std::stable_sort(lost.begin(), lost.end(),
                     [](const VideoDoubt& a, const VideoDoubt& b) { return a.weight > b.weight; });
    constexpr std::size_t most_parts = 3; // more sentences of one kind tell nothing new
    if (lost.size() > most_parts) lost.resize(most_parts);
    doubts.insert(doubts.end(), lost.begin(), lost.end());
    detail::add_turn_doubts(facts, doubts);
    constexpr double small = 300; // pixels: below, a hand is less than 30 pixels wide
    if (facts.person_pixels < small)
        doubts.push_back({"small-person", 0.5 * (1 - facts.person_pixels / small) + 0.1,
                          "the person is " + detail::whole_number(facts.person_pixels) +
                              " pixels high: film upright and from nearer, or take larger images with --size"});
    constexpr double many_hands = 0.6;
    if (facts.hands_found < many_hands)
        doubts.push_back({"few-hands", 0.3 * (1 - facts.hands_found / many_hands) + 0.05,
                          "hands were found in " + detail::whole_number(100 * facts.hands_found) +
                              "% of the images, and fingers are guessed in the others; spread them a little, and "
                              "film from nearer or with --size 960"});
    if (!facts.height && facts.cameras == 1 && !facts.calibrated)
        doubts.push_back({"unknown-height", 0.1, "the person's size is a guess; give --height"});
    std::stable_sort(doubts.begin(), doubts.end(),
                     [](const VideoDoubt& a, const VideoDoubt& b) { return a.weight > b.weight; });
    return doubts;
}

} // namespace gsh
