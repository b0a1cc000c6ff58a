// SPDX-License-Identifier: Apache-2.0
/// @file  The tables of gsh-evaluate: how good each configuration is, what each part is worth, what it costs.
#pragma once

#include "support/evaluation_result.hpp"
#include "support/figures.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::examples {

/// Rows of cells; the first row is the heading.
using Table = std::vector<std::vector<std::string>>;

/// What the paper's tables say of the difference between two configurations.
struct PublishedDifference {
    std::string_view data;
    double psnr, ssim, lpips;
};

/// The differences between two configurations that the paper's tables allow to compute; none if there are none.
[[nodiscard]] std::vector<PublishedDifference> published_differences(std::string_view configuration,
                                                                     std::string_view reference);

/// What a configuration is worth beside the first one, after the same training and on the same images.
struct MarkDifference {
    std::string name, config, after;
    double psnr, ssim, psnr_person;
    std::vector<double> regions;
    std::optional<double> lpips;
    std::string protocol, reference_protocol; ///< of the mark and of the first result's
};

/// Differences to the first result. A mark that the first lacks, or that was judged on other images, has none.
[[nodiscard]] std::vector<MarkDifference> mark_differences(const std::vector<RunResult>& results);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// 170,000
std::string grouped(std::uint64_t number);

/// "[1]" for the first protocol.
std::string reference(std::size_t protocol);

} // namespace detail

/// Different protocols, in the order in which they first occur; tables refer to them by number.
[[nodiscard]] std::vector<std::string> protocols_of(const std::vector<RunResult>& results);

/// Figures of every mark.
[[nodiscard]] Table quality_table(const std::vector<RunResult>& results);

/// Figures of each of several people; empty where there is but one.
[[nodiscard]] Table people_table(const std::vector<RunResult>& results);

/// Differences to the first configuration, beside the paper's; empty if there are none.
[[nodiscard]] Table worth_table(const std::vector<RunResult>& results);

/// Time, memory and work of each run.
[[nodiscard]] Table cost_table(const std::vector<RunResult>& results);

/// Milliseconds per step and stage of each run that times them; empty if none does.
[[nodiscard]] Table stage_table(const std::vector<RunResult>& results);

/// Where the settings of each configuration differ from the first one's.
[[nodiscard]] Table settings_table(const std::vector<RunResult>& results);

/// A table and what to say about it.
struct Section {
    std::string title, text;
    Table table;
};

[[nodiscard]] std::vector<Section> table_sections(const std::vector<RunResult>& results);

/// A table in Markdown, its columns in line for those who read it as text.
[[nodiscard]] std::string markdown_table(const Table& table);

/// All tables; the protocols follow the first one, whose rows refer to them.
[[nodiscard]] std::string markdown_tables(const std::vector<RunResult>& results);

/// The same for programs: every mark with its protocol, cost and settings of its run, then the differences.
[[nodiscard]] Json json_tables(const std::vector<RunResult>& results);

} // namespace gsh::examples
