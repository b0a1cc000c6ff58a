// SPDX-License-Identifier: Apache-2.0
/// @file  The tables of gsh-evaluate: quality of each configuration, contribution of each part, cost.
#pragma once

#include "common/figures.hpp"
#include "evaluate/evaluation_result.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::programs {

/// Rows of cells; the first row is the heading.
using Table = std::vector<std::vector<std::string>>;

/// A difference between two configurations in the paper's tables.
struct PublishedDifference {
    std::string_view data;
    double psnr, ssim, lpips;
};

/// The differences between two configurations that follow from the paper's tables; empty if there are none.
[[nodiscard]] std::vector<PublishedDifference> published_differences(std::string_view configuration,
                                                                     std::string_view reference);

/// The difference of a configuration to the first one, after the same training and on the same images.
struct MarkDifference {
    std::string name, config, after;
    double psnr, ssim, psnr_person;
    std::vector<double> regions;
    std::optional<double> lpips;
    std::string protocol, reference_protocol; ///< of the mark and of the first result's
};

/// Differences to the first result. A mark that the first result does not have, or that was evaluated on other images,
/// is left out.
[[nodiscard]] std::vector<MarkDifference> mark_differences(const std::vector<RunResult>& results);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A number with commas: "170,000".
std::string grouped(std::uint64_t number);

/// The reference to a protocol: "[1]" for the first one.
std::string reference(std::size_t protocol);

} // namespace detail

/// The distinct protocols, in the order in which they first occur. Tables refer to them by number.
[[nodiscard]] std::vector<std::string> protocols_of(const std::vector<RunResult>& results);

/// Figures of each mark.
[[nodiscard]] Table quality_table(const std::vector<RunResult>& results);

/// Figures of seen and of new motion at each mark; empty if no motion is held out.
[[nodiscard]] Table motion_table(const std::vector<RunResult>& results);

/// Figures of each of several people; empty for one person.
[[nodiscard]] Table people_table(const std::vector<RunResult>& results);

/// Differences to the first configuration, beside the paper's; empty if there are none.
[[nodiscard]] Table worth_table(const std::vector<RunResult>& results);

/// Time, memory and work of each run.
[[nodiscard]] Table cost_table(const std::vector<RunResult>& results);

/// Milliseconds per step and stage of each run whose stages were timed; empty if there is no such run.
[[nodiscard]] Table stage_table(const std::vector<RunResult>& results);

/// The settings of each configuration that differ from those of the first one.
[[nodiscard]] Table settings_table(const std::vector<RunResult>& results);

/// A table with its title and explanation.
struct Section {
    std::string title, text;
    Table table;
};

[[nodiscard]] std::vector<Section> table_sections(const std::vector<RunResult>& results);

/// A table in Markdown, with aligned columns.
[[nodiscard]] std::string markdown_table(const Table& table);

/// All tables. The protocols follow the first table, whose rows refer to them.
[[nodiscard]] std::string markdown_tables(const std::vector<RunResult>& results);

/// The same data as JSON: each mark with its protocol, cost and settings of its run, then the differences.
[[nodiscard]] Json json_tables(const std::vector<RunResult>& results);

} // namespace gsh::programs
