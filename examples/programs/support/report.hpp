// SPDX-License-Identifier: Apache-2.0
/// @file  Self-contained HTML pages: figures, curves and pictures in one file, and what pages are made of.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace gsh::examples {

/// A curve over steps.
struct Curve {
    std::string title, unit;
    std::vector<std::pair<double, double>> points; ///< (step, value)
};

struct Picture {
    std::string caption;
    std::vector<std::uint8_t> png; ///< the encoded file
};

struct Report {
    std::string title;
    std::string protocol;                                        ///< one sentence: what was measured, and how
    std::vector<std::pair<std::string, std::string>> facts;      ///< the table at the top
    std::vector<std::vector<std::string>> images;                ///< per-image rows; the first row is the heading
    std::vector<std::vector<std::string>> people;                ///< a row per person where there are several, likewise
    std::vector<std::vector<std::string>> stages;                ///< milliseconds per stage, likewise
    std::vector<Curve> curves;
    std::vector<Picture> pictures;
};

namespace detail {

std::string escape(const std::string& text);

std::string base64(const std::vector<std::uint8_t>& bytes);

std::string table(const std::vector<std::vector<std::string>>& rows);

/// Everything of a page up to its heading.
std::string page_head(const std::string& title);

} // namespace detail

/// Writes the page; the file appears whole or not at all.
void write_report(const std::filesystem::path& path, const Report& report);

} // namespace gsh::examples
