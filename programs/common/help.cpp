// SPDX-License-Identifier: Apache-2.0
#include "common/help.hpp"

#include <gsh/core/error.hpp>

#include <algorithm>
#include <cctype>

namespace gsh::programs {

namespace {

constexpr std::string_view help_page = "docs/README.md"; // from the root of the repository

std::string_view heading_of(std::string_view doubt) {
    for (const Answer& answer : answers())
        if (std::ranges::count(answer.doubts, doubt)) return answer.heading;
    throw ValueError("help: " + std::string(help_page) + " has no answer to " + std::string(doubt));
}

} // namespace

const std::vector<Answer>& answers() {
    static const std::vector<Answer> all{
        {"I have no masks", {"no-masks"}},
        {"My masks are inverted, empty or torn", {"inverted-masks", "empty-masks", "torn-masks"}},
        {"The body is nowhere near the person",
         {"camera-to-world", "opengl-cameras", "transposed-rotation", "camera-position", "camera-units",
          "camera-far-off", "no-overlap", "degrees", "translation-units"}},
        {"The body is shifted, too large or too small",
         {"other-resolution", "principal-point", "focal-length", "translation-origin", "displaced-body", "body-size"}},
        {"The body lies or stands on its head", {"world-axes"}},
        {"Left and right are exchanged", {"mirrored-images", "mirrored-poses"}},
        {"The body lags behind the person", {"frame-order"}},
        {"Hands are stiff or clenched", {"mean-hand-missing", "mean-hand-twice"}},
        {"Poses and body do not fit each other", {"another-body"}},
        {"There are several people", {"absent-person"}},
        {"A few frames are wrong", {"single-images", "odd-frames", "doubtful-frames"}},
        {"Brightness and colours change between photographs", {"exposure-drift"}},
        {"The avatar is soft all over", {"rough-poses", "estimated-poses", "short-training"}},
        {"My hands are blurred", {"weak-hands"}},
        {"The face is flat", {"weak-face"}},
        {"It looks worse in a new motion", {"weak-new-motion"}},
        {"The back is blotchy", {"unseen-surface"}},
        {"A video gives a poor avatar",
         {"nobody-found", "body-beside-keypoints", "cut-person", "lost-parts", "no-turn", "part-of-a-turn", "fast-turn",
          "small-person", "few-hands", "unknown-height"}},
    };
    return all;
}

std::string help_text(const std::vector<std::string>& doubts) {
    std::vector<std::string_view> named;
    std::string text(help_page);
    for (const std::string& doubt : doubts) {
        const std::string_view heading = heading_of(doubt);
        if (std::ranges::count(named, heading)) continue;
        named.push_back(heading);
        text.append(", \"").append(heading).append("\"");
    }
    return text;
}

std::string help_link(std::string_view doubt) {
    std::string link = std::string(help_page) + "#"; // a heading is letters, commas and spaces
    for (const char c : heading_of(doubt))
        if (c == ' ')
            link += '-';
        else if (std::isalpha(static_cast<unsigned char>(c)))
            link += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return link;
}

} // namespace gsh::programs
