// SPDX-License-Identifier: Apache-2.0
/// @file  Self-contained HTML pages with figures, curves and pictures, and the parts of such a page.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::programs {

/// A curve over steps, or over what `over` names.
struct Curve {
    std::string title, unit;
    std::vector<std::pair<double, double>> points; ///< (step, value)
    std::string over = "steps";
};

struct Picture {
    std::string caption;
    std::vector<std::uint8_t> png; ///< the encoded file
};

/// A figure, and what it means.
struct Fact {
    std::string name, value, meaning;
};

struct Report {
    std::string title;
    std::string verdict;                                     ///< one sentence
    std::vector<std::pair<std::string, std::string>> advice; ///< what is wrong and what to do; where to read more
    Picture render, photograph;                            ///< of the same size; the reader wipes from one to the other
    Picture turn;                                          ///< the person from all around
    std::vector<std::pair<std::string, std::string>> next; ///< what the reader can do, and the command for it
    std::vector<Fact> facts;
    std::string protocol;                         ///< the measures and how they were taken
    std::vector<std::vector<std::string>> images; ///< per-image rows; the first row is the heading
    std::vector<std::vector<std::string>> motion; ///< likewise, seen and new motion, if any is held out
    std::vector<std::vector<std::string>> people; ///< likewise, one row per person, if there are several
    std::vector<std::vector<std::string>> stages; ///< likewise, milliseconds per stage
    std::vector<Curve> curves;
    std::vector<Picture> pictures;
};

namespace detail {

std::string escape(const std::string& text);

/// A table that scrolls sideways where the page is narrower.
std::string table(const std::vector<std::vector<std::string>>& rows);

/// The beginning of a page, up to and including its heading.
std::string page_head(const std::string& title);

} // namespace detail

/// Writes the page. The file is written atomically.
void write_report(const std::filesystem::path& path, const Report& report);

} // namespace gsh::programs
