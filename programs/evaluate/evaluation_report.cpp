// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_report.hpp"

#include "common/base64.hpp"
#include "common/figures.hpp"
#include "common/report.hpp"
#include "common/staged_results.hpp"
#include "evaluate/evaluation_runs.hpp"
#include "evaluate/evaluation_tables.hpp"

#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <utility>

namespace gsh::programs {

namespace {

/// A row of a picture grid: its label, its PNG and its pixels.
struct GridRow {
    std::string label, png;
    PixelImage pixels;
};

/// The row of the photograph, then one row for each result that has a picture of the view.
std::vector<GridRow> grid_rows(const ShownView& view, const Photo& photo, const std::vector<RunResult>& results) {
    PixelImage truth = row_picture(view, truth_image(photo), nullptr);
    std::string truth_png = encode_png(truth);
    std::vector<GridRow> rows;
    rows.push_back({"photograph", std::move(truth_png), std::move(truth)});
    for (const RunResult& result : results) {
        if (std::find(result.shown.begin(), result.shown.end(), view.name) == result.shown.end()) continue;
        const Mark& last = result.marks.back();
        std::string label = result.name + ", " + last.after;
        for (const Json& image : last.images)
            if (image.value("name", "") == view.name && image.at("psnr").is_number())
                label += ": " + fixed(image.at("psnr"), 2) + " dB";
        const auto file = result.folder / (view.name + ".png");
        rows.push_back({std::move(label), read_file(file), read_image(file)});
    }
    return rows;
}

/// The text that names the columns of a row.
std::string columns_text(const ShownView& view) {
    if (view.crops.empty()) return "render, error times 5";
    return "render, error times 5, enlarged " +
           std::string(view.crops.size() == 3 ? "face, left hand, right hand" : "face or hands");
}

} // namespace

void write_evaluation(const EvaluationFolder& folder, const std::string& capture, const std::vector<ShownView>& views,
                      const std::vector<Photo>& photos, const std::vector<RunResult>& results) {
    using namespace detail;
    const std::string title = "Evaluation on " + capture;
    std::string markdown = "# " + title + "\n\n" + markdown_tables(results) + "## Pictures\n", page = page_head(title);
    StagedResults out(folder.path(""));
    bool first = true;
    for (const Section& section : table_sections(results)) {
        page += "<h2>" + escape(section.title) + "</h2><p>" + escape(section.text) + "</p>" + table(section.table);
        const auto protocols = std::exchange(first, false) ? protocols_of(results) : std::vector<std::string>();
        for (std::size_t p = 0; p < protocols.size(); ++p)
            page += "<p>" + reference(p) + " " + escape(protocols[p]) + "</p>";
    }
    for (const ShownView& view : views) {
        std::vector<GridRow> rows = grid_rows(view, photos[view.photo], results);
        const std::string heading = view.name + ": " + columns_text(view), file = "grids/" + view.name + ".png";
        markdown += "### " + heading + "\n![" + view.name + "](" + file + ")\n\nFrom the top:\n";
        page += "<h2>" + escape(heading) + "</h2><table>";
        std::vector<PixelImage> pixels;
        for (GridRow& row : rows) {
            markdown += "- " + row.label + "\n";
            page += "<tr><td>" + escape(row.label) + "</td><td><img alt=\"" + escape(view.name + ", " + row.label) +
                    "\" src=\"data:image/png;base64," + base64(row.png) + "\"></td></tr>";
            pixels.push_back(std::move(row.pixels));
        }
        markdown += "\n";
        page += "</table>";
        write_png(out.file(file), stacked(pixels));
    }
    write_json(out.file("tables.json"), json_tables(results));
    write_file(out.file("report.html"), page + "</body></html>\n");
    write_file(out.file("tables.md"), markdown);
    out.commit();
}

} // namespace gsh::programs
