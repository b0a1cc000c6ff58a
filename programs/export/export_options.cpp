// SPDX-License-Identifier: Apache-2.0
#include "export/export_options.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/splat/splat_formats.hpp>

#include <charconv>
#include <string_view>

namespace gsh::programs {

std::vector<std::size_t> frames_of(const std::string& text, std::size_t count) {
    std::vector<std::size_t> numbers;
    const char *at = text.data(), *const end = at + text.size();
    while (true) {
        std::size_t number = 0;
        const auto [next, code] = std::from_chars(at, end, number);
        if (code != std::errc() || (next != end && *next != ':')) {
            numbers.clear();
            break;
        }
        numbers.push_back(number);
        if (next == end) break;
        at = next + 1;
    }
    const std::string option = "--frames " + text;
    check_value(numbers.size() == 2 || numbers.size() == 3, option, "is not A:B or A:B:S, frames from 0");
    const std::size_t step = numbers.size() == 3 ? numbers[2] : 1;
    check_value(step > 0, option, "has a step of 0, expected 1 or more");
    check_value(numbers[0] <= numbers[1], option, "ends before it begins");
    check_value(numbers[1] < count, option,
                "is beyond the motion, which has " + std::to_string(count) + " frames, from 0");
    std::vector<std::size_t> frames;
    for (std::size_t f = numbers[0]; f <= numbers[1]; f += step) frames.push_back(f);
    return frames;
}

std::size_t chosen_frame(const ExportOptions& o, std::size_t count) {
    const std::size_t frame = o.frame.value_or(0);
    check_value(frame < count, "--frame " + std::to_string(frame),
                "is beyond " + (o.poses.empty() ? "the pose" : o.poses[0].string()) + ", which has " +
                    std::to_string(count) + " frames, from 0");
    return frame;
}

FormatTraits check_options(const ExportOptions& o) {
    const auto traits = format_of(o.to);
    check_value(traits.has_value(), "--to " + o.to.string(), "has an unknown ending; known are " + known_endings());
    const bool avatar = o.input.extension() == ".gsh", glb = traits->is(SplatFormat::glb);
    const auto needs = [&](bool given, bool fits, const char* option, std::string_view what) {
        check_value(!given || fits, option, what);
    };
    needs(!o.poses.empty(), avatar, "--poses", "needs an avatar (.gsh)");
    const bool page = traits->kind == ExportKind::page;
    needs(o.poses.size() > 1, page, "--poses", "holds several motions; only .html takes more than one");
    needs(o.frame.has_value(), !o.poses.empty(), "--frame", "needs --poses");
    needs(o.is_moving(), !o.poses.empty(), "--frames", "needs --poses");
    needs(o.is_moving(), !o.frame, "--frames", "excludes --frame");
    needs(o.frame || o.is_moving(), o.poses.size() == 1, "--poses",
          "holds several motions; --frame and --frames choose from one");
    needs(page && o.as_stored, false, "--as-stored", "is not for .html, whose page shows bodies upright");
    needs(!o.light.is_default(), avatar, "--light", "needs an avatar (.gsh), as --light-turn and --exposure do");
    needs(!o.rig.is_default(), !o.poses.empty(), "--joint-map", "needs --poses, as --animation does");
    needs(o.up.has_value(), traits->is_y_down(), "--up",
          "is for " + y_down_endings() + "; the other formats have y up");
    needs(!o.input_up.empty(), !avatar, "--input-up", "is for a scene; an avatar (.gsh) has y up");
    needs(o.spz_version.has_value(), traits->is(SplatFormat::spz), "--spz", "is for files .spz");
    needs(o.clusters.has_value(), glb && o.is_moving(), "--clusters", "is for files .glb with --frames");
    needs(o.clusters.has_value(), !o.mesh, "--clusters", "excludes --mesh");
    needs(o.gaussians.has_value(), !o.largest, "--gaussians", "excludes --largest");
    needs(o.mesh, glb && avatar, "--mesh", "is for an avatar (.gsh) and a file .glb");
    const bool compact = traits->kind == ExportKind::avatar;
    needs(compact, avatar, "--to", "a file .gsh is made from an avatar (.gsh)");
    needs(compact, o.poses.empty() && o.light.is_default(), "--to",
          "a file .gsh holds no pose and keeps the avatar's light; leave out --poses and --light");
    needs(o.mesh && o.sh_degree, false, "--sh", "is not for --mesh, whose colours do not depend on the view");
    return *traits;
}

} // namespace gsh::programs
