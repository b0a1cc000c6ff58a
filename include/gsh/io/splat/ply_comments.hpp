// SPDX-License-Identifier: Apache-2.0
/// @file  What the comments of a PLY file state about its Gaussians: which way is up, and the pixel filter.
#pragma once

#include <gsh/gaussian/axis_turn.hpp>
#include <gsh/gaussian/splats.hpp>
#include <gsh/io/file/file_author.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/splat/still_splats.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Comment lines for the header of a PLY file. The vertical is stated as gsh.up, and y down also as gsh.axes RDF,
/// because earlier versions of gsh wrote y down turned about z. The filter is stated as gsh.filter and as Postshot's
/// "antialiased". Brush's SplatRenderMode and the "Vertical Axis" of other programs are only read.
inline std::string ply_comments(const SplatNotes& notes) {
    std::string text = "comment written by " + file_author() + "\n";
    if (notes.up) text += "comment gsh.up " + std::string(name_of(*notes.up)) + "\n";
    if (notes.up == UpAxis::minus_y) text += "comment gsh.axes RDF\n";
    if (notes.filter) {
        char number[32];
        const auto end = std::to_chars(number, number + sizeof number, notes.filter->dilation).ptr;
        text += "comment gsh.filter dilation " + std::string(number, end) +
                (notes.filter->compensate_opacity ? " compensated\n" : " plain\n");
        text += std::string("comment antialiased ") + (notes.filter->compensate_opacity ? "1\n" : "0\n");
    }
    return text;
}

/// What the comments of a header state.
struct PlyStatements {
    SplatNotes notes;
    std::optional<mat3<double>> y_up = {}; ///< the axes of gsh's frame, where a vertical is stated
    std::vector<std::string> unknown = {}; ///< statements about the vertical that are in no known form

    void set_up(UpAxis up) { notes.up = up, y_up = y_up_axes(up); }
    /// A direction that is up: the coordinate axis nearest to it, to which the shortest rotation leads, goes to y.
    void set_up(const vec3<double>& direction) {
        int axis = 0;
        for (int k = 1; k < 3; ++k)
            if (std::abs(direction[k]) > std::abs(direction[axis])) axis = k;
        vec3<double> nearest(0.0);
        nearest[axis] = direction[axis] < 0 ? -1 : 1;
        set_up(static_cast<UpAxis>(2 * axis + (direction[axis] < 0)));
        const vec3<double> unit = direction * (1 / length(direction));
        const vec3<double> turn = cross(unit, nearest);
        const double sine = length(turn);
        if (sine > 1e-9) y_up = *y_up * rotation_from_axis_angle(turn * (std::asin(std::min(sine, 1.0)) / sine));
    }
};

/// Three numbers with blanks, commas or brackets between them.
inline std::optional<vec3<double>> direction_of_text(std::string_view text) {
    std::string plain(text);
    std::replace_if(plain.begin(), plain.end(), [](char c) { return c == ',' || c == '[' || c == ']'; }, ' ');
    const std::vector<std::string_view> words = words_in(plain);
    if (words.size() != 3) return std::nullopt;
    vec3<double> v;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::string_view digits = words[k].substr(words[k].starts_with('+'));
        const auto [end, code] = std::from_chars(digits.data(), digits.data() + digits.size(), v[static_cast<int>(k)]);
        if (code != std::errc() || end != digits.data() + digits.size()) return std::nullopt;
    }
    const double norm = length(v);
    if (!(norm > 1e-6 && norm < 1e6)) return std::nullopt;
    return v;
}

/// "Vertical Axis: z" and the like, in any case of letters. nerfstudio 1.1.5 writes z and means +z. Brush writes three
/// numbers, the direction that is up, or y, by which it means y down: the custom, so that nothing is stated.
inline void heed_vertical_axis(std::string_view value, PlyStatements& stated) {
    std::string name;
    for (const char c : trimmed(value)) name.push_back(c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c);
    if (name == "y") return;
    if (name.starts_with('+')) name.erase(0, 1);
    if (const auto up = up_axis_called(name))
        stated.set_up(*up);
    else if (const auto direction = direction_of_text(name))
        stated.set_up(*direction);
    else
        stated.unknown.push_back("the comment 'Vertical Axis: " + shortened(trimmed(value)) +
                                 "' names no direction; expected x, -x, y, -y, z, -z or three numbers");
}

/// What the comments of a header state. gsh's own words have precedence over those of other programs, and a later line
/// over an earlier one.
inline PlyStatements statements_of_comments(const std::vector<std::string>& comments) {
    PlyStatements own, foreign;
    bool by_gsh = false, has_axes = false;
    for (const std::string& comment : comments) {
        const std::size_t colon = comment.find(':');
        if (colon != comment.npos && is_word(trimmed(std::string_view(comment).substr(0, colon)), "vertical axis"))
            heed_vertical_axis(std::string_view(comment).substr(colon + 1), foreign);
        if (comment.starts_with("gsh.up "))
            if (const auto up = up_axis_called(trimmed(std::string_view(comment).substr(7)))) own.set_up(*up);
        if (comment.starts_with("written by gsh ")) by_gsh = true;
        if (comment == "gsh.axes RDF") has_axes = true;
        if (comment == "antialiased 1") foreign.notes.filter = PixelFilter{.dilation = 0.3, .compensate_opacity = true};
        if (comment == "antialiased 0") foreign.notes.filter = PixelFilter{};
        if (comment == "SplatRenderMode: mip")
            foreign.notes.filter = PixelFilter{.dilation = 0.1, .compensate_opacity = true};
        if (comment == "SplatRenderMode: default") foreign.notes.filter = PixelFilter{};
        constexpr std::string_view filter = "gsh.filter dilation ";
        if (comment.starts_with(filter)) {
            double dilation = 0;
            const char* const last = comment.data() + comment.size();
            const auto [end, code] = std::from_chars(comment.data() + filter.size(), last, dilation);
            const std::string_view rest(end, static_cast<std::size_t>(last - end));
            if (code == std::errc() && dilation >= 0 && dilation < 1e6 && (rest == " compensated" || rest == " plain"))
                own.notes.filter = PixelFilter{.dilation = dilation, .compensate_opacity = rest == " compensated"};
        }
    }
    // Earlier versions of gsh wrote y down as half a turn about z, and no axes.
    if (own.notes.up == UpAxis::minus_y && by_gsh && !has_axes) own.y_up = axes_of_letters("LDB");
    if (!own.notes.up) own.notes.up = foreign.notes.up, own.y_up = foreign.y_up, own.unknown = foreign.unknown;
    if (!own.notes.filter) own.notes.filter = foreign.notes.filter;
    return own;
}

/// Turns Gaussians that were read as stored to y up, if a vertical is stated, and notes what the file states.
inline void heed_statements(StillSplats& splats, const PlyStatements& stated, const std::string& name) {
    if (stated.y_up) turn_axes(splats.cloud, *stated.y_up);
    splats.notes = stated.notes;
    for (const std::string& text : stated.unknown) splats.warnings.push_back(name + ": " + text);
}

} // namespace gsh::detail
