// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_tables.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace gsh::programs {

namespace detail {

std::string grouped(std::uint64_t number) {
    std::string text = std::to_string(number);
    for (std::size_t at = text.size(); at > 3; at -= 3) text.insert(at - 3, 1, ',');
    return text;
}

std::string reference(std::size_t protocol) {
    return std::string("[").append(std::to_string(protocol + 1)).append("]");
}

} // namespace detail

namespace {

/// A row of the paper's tables: means over the subjects of a data set.
struct PublishedScore {
    std::string_view configuration, data;
    double psnr, ssim, lpips;
};

/// PeopleSnapshot: after 30 s, one set from the paper's ablation and one as the mean over its comparison.
/// GalaBasketball: after 70 s with ambient occlusion, after 50 s without.
constexpr std::array<PublishedScore, 11> published_scores{{
    {"paper", "PeopleSnapshot, ablation", 28.14, 0.9653, 0.0291},
    {"no-hash-sh", "PeopleSnapshot, ablation", 26.53, 0.9322, 0.0720},
    {"no-hash-vd", "PeopleSnapshot, ablation", 25.40, 0.9075, 0.1523},
    {"no-depth", "PeopleSnapshot, ablation", 24.09, 0.9365, 0.0594},
    {"no-normals", "PeopleSnapshot, ablation", 23.18, 0.9248, 0.0771},
    {"no-multiscale", "PeopleSnapshot, ablation", 25.46, 0.9462, 0.0563},
    {"paper", "PeopleSnapshot", 28.1600, 0.96525, 0.029125},
    {"baseline", "PeopleSnapshot", 26.7675, 0.960675, 0.035875},
    {"paper", "GalaBasketball", 40.9600, 0.996375, 0.003550},
    {"baseline", "GalaBasketball", 39.1825, 0.994375, 0.004175},
    {"no-ao", "GalaBasketball", 38.8250, 0.993250, 0.004675},
}};

std::string signed_number(double value, int digits) {
    if (std::isnan(value)) return "none";
    char text[32];
    std::snprintf(text, sizeof text, "%+.*f", digits, value);
    return text;
}

/// "12,000 of 1,000,000", or a dash if there is no table.
std::string share(std::size_t part, std::size_t all) {
    return all ? detail::grouped(part) + " of " + detail::grouped(all) : "–";
}

bool has_lpips(const std::vector<RunResult>& results) {
    return std::any_of(results.begin(), results.end(), [](const RunResult& result) {
        return std::any_of(result.marks.begin(), result.marks.end(),
                           [](const Mark& mark) { return mark.mean.lpips.has_value(); });
    });
}

/// The reference to a protocol, such as "[2]", by its position in the list.
std::string reference_to(const std::string& protocol, const std::vector<std::string>& protocols) {
    return detail::reference(
        static_cast<std::size_t>(std::find(protocols.begin(), protocols.end(), protocol) - protocols.begin()));
}

/// Adds cells to the end of a row.
void add_cells(std::vector<std::string>& row, const std::vector<std::string>& cells) {
    row.insert(row.end(), cells.begin(), cells.end());
}

} // namespace

std::vector<PublishedDifference> published_differences(std::string_view configuration, std::string_view reference) {
    std::vector<PublishedDifference> result;
    for (const PublishedScore& a : published_scores)
        for (const PublishedScore& b : published_scores)
            if (a.configuration == configuration && b.configuration == reference && a.data == b.data &&
                configuration != reference)
                result.push_back({a.data, a.psnr - b.psnr, a.ssim - b.ssim, a.lpips - b.lpips});
    return result;
}

std::vector<MarkDifference> mark_differences(const std::vector<RunResult>& results) {
    const auto names = [](const Mark& mark) {
        std::vector<std::string> all;
        for (const Json& image : mark.images) all.push_back(image.value("name", ""));
        return all;
    };
    std::vector<MarkDifference> differences;
    // A run by seconds has one result per budget, so the first configuration may have several results.
    for (const RunResult& result : results) {
        if (result.name == results.front().name) continue;
        for (const Mark& mark : result.marks)
            for (const RunResult& first : results) {
                if (first.name != results.front().name) continue;
                for (const Mark& other : first.marks) {
                    if (other.after != mark.after || names(other) != names(mark)) continue;
                    MarkDifference d{result.name,
                                     result.config,
                                     mark.after,
                                     mark.mean.psnr - other.mean.psnr,
                                     mark.mean.ssim - other.mean.ssim,
                                     mark.mean.psnr_person - other.mean.psnr_person,
                                     {},
                                     {},
                                     mark.protocol,
                                     other.protocol};
                    for (std::size_t r = 0; r < mark.regions.size(); ++r)
                        d.regions.push_back(mark.regions[r] - other.regions[r]);
                    if (mark.mean.lpips && other.mean.lpips) d.lpips = *mark.mean.lpips - *other.mean.lpips;
                    differences.push_back(std::move(d));
                }
            }
    }
    return differences;
}

std::vector<std::string> protocols_of(const std::vector<RunResult>& results) {
    std::vector<std::string> all;
    for (const RunResult& result : results)
        for (const Mark& mark : result.marks)
            if (std::find(all.begin(), all.end(), mark.protocol) == all.end()) all.push_back(mark.protocol);
    return all;
}

Table quality_table(const std::vector<RunResult>& results) {
    const bool lpips = has_lpips(results);
    const std::vector<std::string> protocols = protocols_of(results);
    Table table{{"configuration", "after"}};
    add_cells(table[0], figure_headings(lpips));
    add_cells(table[0], {"images", "protocol"});
    for (const RunResult& result : results)
        for (const Mark& mark : result.marks) {
            table.push_back({result.name, mark.after});
            add_cells(table.back(), figure_cells(mark.mean, mark.regions, lpips));
            add_cells(table.back(), {std::to_string(mark.images.size()), reference_to(mark.protocol, protocols)});
        }
    return table;
}

Table motion_table(const std::vector<RunResult>& results) {
    const bool lpips = has_lpips(results);
    const std::vector<std::string> protocols = protocols_of(results);
    Table table{{"configuration", "after", "motion"}};
    add_cells(table[0], figure_headings(lpips));
    add_cells(table[0], {"images", "protocol"});
    for (const RunResult& result : results)
        for (const Mark& mark : result.marks) {
            if (!mark.motion) continue;
            for (const auto& [word, figures] : {std::pair("seen", &mark.motion->seen), {"new", &mark.motion->unseen}}) {
                table.push_back({result.name, mark.after, word});
                add_cells(table.back(), figure_cells(figures->mean, figures->regions, lpips));
                add_cells(table.back(), {std::to_string(figures->images), reference_to(mark.protocol, protocols)});
            }
        }
    return table.size() > 1 ? table : Table();
}

Table people_table(const std::vector<RunResult>& results) {
    Table table{{"configuration", "after", "person", "PSNR", "SSIM"}};
    for (const std::string& region : region_names()) table[0].push_back(region);
    table[0].push_back("protocol");
    const std::vector<std::string> protocols = protocols_of(results);
    for (const RunResult& result : results)
        for (const Mark& mark : result.marks)
            for (const PersonFigures& person : mark.people) {
                table.push_back({result.name, mark.after, person.name, fixed(person.mean.whole.psnr, 2),
                                 fixed(person.mean.whole.ssim, 4)});
                for (const RegionMean& region : person.mean.regions) table.back().push_back(fixed(region.psnr, 2));
                table.back().push_back(reference_to(mark.protocol, protocols));
            }
    return table.size() > 1 ? table : Table();
}

Table worth_table(const std::vector<RunResult>& results) {
    const auto differences = mark_differences(results);
    if (differences.empty()) return {};
    const bool lpips = has_lpips(results);
    Table table{{"configuration", "after"}};
    add_cells(table[0], figure_headings(lpips));
    add_cells(table[0], {"in the paper", "protocols"});
    const std::vector<std::string> protocols = protocols_of(results);
    for (const MarkDifference& d : differences) {
        std::vector<std::string> row{d.name, d.after, signed_number(d.psnr, 2), signed_number(d.ssim, 4)};
        if (lpips) row.push_back(signed_number(d.lpips.value_or(std::nan("")), 4));
        row.push_back(signed_number(d.psnr_person, 2));
        for (const double psnr : d.regions) row.push_back(signed_number(psnr, 2));
        std::string published;
        for (const auto& p : published_differences(d.config, results.front().config))
            published += (published.empty() ? "" : "; ") + signed_number(p.psnr, 2) + " dB, SSIM " +
                         signed_number(p.ssim, 4) + ", LPIPS " + signed_number(p.lpips, 4) + " (" +
                         std::string(p.data) + ")";
        row.push_back(published.empty() ? "–" : published);
        row.push_back(reference_to(d.protocol, protocols) + " − " + reference_to(d.reference_protocol, protocols));
        table.push_back(std::move(row));
    }
    return table;
}

Table cost_table(const std::vector<RunResult>& results) {
    Table table{{"configuration", "after", "training", "ms per step", "computed on", "Gaussians", "memory", "lookups",
                 "touched entries", "touched by ambient occlusion"}};
    for (const RunResult& result : results) {
        if (result.marks.empty()) continue;
        const RunCost& cost = result.cost;
        const Mark& last = result.marks.back();
        table.push_back({result.name, detail::grouped(last.steps) + " steps", fixed(last.seconds, 1) + " s",
                         fixed(cost.ms_per_step, 2), result.computed_on.text(), detail::grouped(cost.gaussians),
                         mebibytes(cost.memory), cost.entries ? detail::grouped(cost.lookups) : "–",
                         share(cost.touched, cost.entries), share(cost.ao_touched, cost.ao_entries)});
    }
    return table;
}

Table stage_table(const std::vector<RunResult>& results) {
    Table table{{"configuration"}};
    for (const RunResult& result : results) {
        const auto& stages = result.cost.ms_per_stage;
        if (stages.empty()) continue;
        if (table[0].size() == 1)
            for (const auto& [stage, ms] : stages) table[0].push_back(stage);
        std::vector<std::string> row{result.name};
        for (const auto& [stage, ms] : stages) row.push_back(fixed(ms, 2));
        table.push_back(std::move(row));
    }
    return table.size() > 1 ? table : Table();
}

Table settings_table(const std::vector<RunResult>& results) {
    Table table{{"configuration", "settings that differ from " + results.front().name}};
    for (const RunResult& result : results) {
        if (std::any_of(table.begin() + 1, table.end(), [&](const auto& row) { return row[0] == result.name; }))
            continue;
        std::string text;
        for (const auto& [key, value] : result.settings.items())
            if (results.front().settings.value(key, "") != value.get<std::string>())
                text += (text.empty() ? "" : ", ") + key + " = " + value.get<std::string>();
        if (result.name != results.front().name) table.push_back({result.name, text.empty() ? "none" : text});
    }
    return table.size() > 1 ? table : Table();
}

std::vector<Section> table_sections(const std::vector<RunResult>& results) {
    const std::string& first = results.front().name;
    std::vector<Section> sections;
    const auto add = [&](std::string title, std::string text, Table table) {
        if (table.size() > 1) sections.push_back({std::move(title), std::move(text), std::move(table)});
    };
    add("Quality",
        "Means over the test images. PSNR is in dB: of the full image, of the person, and of the parts of the person "
        "that an image shows. Faces and hands have few pixels and hardly change the PSNR of the full image.",
        quality_table(results));
    add("Seen and new motion",
        "Means over the test images of motion that was trained on, and of motion that was left out of training in "
        "every camera (--hold-out-motion).",
        motion_table(results));
    add("Each person", "Means over the test images that show enough of the person, on the pixels of the person.",
        people_table(results));
    add("Contribution of each part",
        "Figures minus those of " + first +
            ", after the same training and on the same images; PSNR in dB. If a part helps, the configuration without "
            "it has a negative difference in PSNR. The paper's differences are from other data, other hardware and "
            "other budgets, so only their signs can be compared." +
            (has_lpips(results)
                 ? " This holds for LPIPS, too. Most published tables compute LPIPS from images in [0, 1], as "
                   "--lpips-table does."
                 : ""),
        worth_table(results));
    add("Cost",
        "Time is training only, without loading, sampling, checkpoints and evaluation. Memory is the resident memory "
        "at the end of training, including the capture. Lookups are the table rows that the fields of colour and "
        "displacement read in one pass. Touched entries are the rows of their tables that at least one Gaussian reads; "
        "only these change in training.",
        cost_table(results));
    add("Time per stage", "Milliseconds per step.", stage_table(results));
    add("Settings that differ", "", settings_table(results));
    return sections;
}

std::string markdown_table(const Table& table) {
    const auto width_of = [](const std::string& text) { // characters, not bytes
        return static_cast<std::size_t>(
            std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
    };
    std::vector<std::size_t> widths(table[0].size(), 3);
    for (const auto& row : table)
        for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], width_of(row[c]));
    std::string text;
    for (std::size_t r = 0; r < table.size(); ++r) {
        text += "|";
        for (std::size_t c = 0; c < table[r].size(); ++c) {
            std::string cell = table[r][c];
            std::replace(cell.begin(), cell.end(), '|', '/');
            text += " " + cell + std::string(widths[c] - width_of(table[r][c]), ' ') + " |";
        }
        text += "\n";
        if (r > 0) continue;
        text += "|";
        for (const std::size_t width : widths) text += std::string(width + 2, '-') + "|";
        text += "\n";
    }
    return text;
}

std::string markdown_tables(const std::vector<RunResult>& results) {
    std::string text;
    for (const Section& section : table_sections(results)) {
        const bool first = text.empty();
        text += "## " + section.title + "\n" + (section.text.empty() ? "" : section.text + "\n\n") +
                markdown_table(section.table) + "\n";
        const auto protocols = first ? protocols_of(results) : std::vector<std::string>();
        for (std::size_t p = 0; p < protocols.size(); ++p) text += detail::reference(p) + " " + protocols[p] + "\n\n";
    }
    return text;
}

Json json_tables(const std::vector<RunResult>& results) {
    Json json{{"reference", results.front().name},
              {"figures", Json::array()},
              {"differences", Json::array()},
              {"costs", Json::array()}};
    for (const RunResult& result : results) {
        for (const Mark& mark : result.marks) {
            Json row{{"name", result.name}, {"configuration", result.config}};
            row.update(mark_json(mark));
            json["figures"].push_back(std::move(row));
        }
        Json row{{"name", result.name},
                 {"configuration", result.config},
                 {"steps", result.marks.empty() ? 0 : result.marks.back().steps},
                 {"seconds", result.marks.empty() ? 0.0 : result.marks.back().seconds}};
        add_machine(row, result.computed_on);
        row.update(cost_json(result.cost));
        row["settings"] = result.settings;
        json["costs"].push_back(std::move(row));
    }
    for (const MarkDifference& d : mark_differences(results)) {
        Json row{{"name", d.name},
                 {"configuration", d.config},
                 {"after", d.after},
                 {"psnr", number_or_null(d.psnr)},
                 {"ssim", number_or_null(d.ssim)},
                 {"psnr_person", number_or_null(d.psnr_person)}};
        for (std::size_t r = 0; r < d.regions.size(); ++r)
            row["psnr_regions"][region_names()[r]] = number_or_null(d.regions[r]);
        if (d.lpips) row["lpips"] = number_or_null(*d.lpips);
        row["paper"] = Json::array();
        for (const auto& p : published_differences(d.config, results.front().config))
            row["paper"].push_back({{"data", p.data}, {"psnr", p.psnr}, {"ssim", p.ssim}, {"lpips", p.lpips}});
        row["protocol"] = d.protocol;
        row["reference_protocol"] = d.reference_protocol;
        json["differences"].push_back(std::move(row));
    }
    return json;
}

} // namespace gsh::programs
