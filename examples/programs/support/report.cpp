// SPDX-License-Identifier: Apache-2.0
#include "support/report.hpp"

#include "support/base64.hpp"

#include <gsh/io/file/atomic_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string_view>

namespace gsh::examples {

namespace detail {

std::string escape(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '&') out += "&amp;";
        else if (c == '<') out += "&lt;";
        else if (c == '>') out += "&gt;";
        else if (c == '"') out += "&quot;";
        else out += c;
    }
    return out;
}

namespace {

std::string number(double value, int digits = 4) {
    char text[32];
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    return text;
}

/// A small SVG line chart.
std::string chart(const Curve& curve) {
    constexpr double width = 520, height = 200, left = 56, right = 8, top = 8, bottom = 28;
    if (curve.points.size() < 2) return {};
    double x_max = 1, low = INFINITY, high = -INFINITY;
    for (const auto& [x, y] : curve.points) {
        x_max = std::max(x_max, x);
        low = std::min(low, y), high = std::max(high, y);
    }
    if (!(high > low)) high = low + 1;
    const auto px = [&](double x) { return left + (width - left - right) * x / x_max; };
    const auto py = [&](double y) { return height - bottom - (height - top - bottom) * (y - low) / (high - low); };

    std::string svg = "<svg viewBox=\"0 0 " + number(width) + " " + number(height) + "\" role=\"img\">";
    for (int i = 0; i <= 4; ++i) {
        const double y = low + (high - low) * i / 4;
        svg += "<line class=\"grid\" x1=\"" + number(left) + "\" x2=\"" + number(width - right) + "\" y1=\"" +
               number(py(y)) + "\" y2=\"" + number(py(y)) + "\"/><text x=\"" + number(left - 6) + "\" y=\"" +
               number(py(y) + 4) + "\" text-anchor=\"end\">" + number(y, 3) + "</text>";
        const double x = x_max * i / 4;
        svg += "<text x=\"" + number(px(x)) + "\" y=\"" + number(height - 8) + "\" text-anchor=\"middle\">" +
               number(x, 5) + "</text>";
    }
    svg += "<polyline points=\"";
    for (const auto& [x, y] : curve.points) svg += number(px(x), 6) + "," + number(py(y), 6) + " ";
    return svg + "\"/></svg>";
}

} // namespace

std::string table(const std::vector<std::vector<std::string>>& rows) {
    std::string html = "<table>";
    for (std::size_t r = 0; r < rows.size(); ++r) {
        html += "<tr>";
        for (const auto& cell : rows[r])
            html += (r == 0 ? "<th>" : "<td>") + escape(cell) + (r == 0 ? "</th>" : "</td>");
        html += "</tr>";
    }
    return html + "</table>";
}

std::string page_head(const std::string& title) {
    return "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">"
           "<meta name=\"viewport\" content=\"width=device-width\"><title>" +
           escape(title) +
           "</title><style>"
           "body{font:15px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;"
           "color:#222;background:#fff}h1{font-weight:600}h2{font-weight:600;margin-top:2rem}"
           "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
           "td,th{padding:.2rem .8rem .2rem 0;text-align:left;border-bottom:1px solid #ddd}"
           "figure{margin:0 0 1.5rem}img{max-width:100%;border:1px solid #ddd}"
           ".curves{display:flex;flex-wrap:wrap;gap:1rem}.curves figure{flex:1 1 24rem}"
           "svg{width:100%}svg text{font-size:11px;fill:#555}.grid{stroke:#eee}"
           "polyline{fill:none;stroke:#1769aa;stroke-width:1.5}</style></head><body><h1>" +
           escape(title) + "</h1>";
}

} // namespace detail

void write_report(const std::filesystem::path& path, const Report& report) {
    using namespace detail;
    std::string html = page_head(report.title) + "<p>" + escape(report.protocol) + "</p><table>";
    for (const auto& [name, value] : report.facts)
        html += "<tr><th>" + escape(name) + "</th><td>" + escape(value) + "</td></tr>";
    html += "</table>";
    if (report.motion.size() > 1)
        html += "<h2>Seen and new motion</h2><p>Means over the test images of motion that was trained on, and of "
                "motion that was left out of training.</p>" +
                table(report.motion);
    if (report.people.size() > 1)
        html += "<h2>Each person</h2><p>On the pixels that show the person.</p>" + table(report.people);
    if (!report.curves.empty()) {
        html += "<h2>Training</h2><div class=\"curves\">";
        for (const auto& curve : report.curves)
            html += "<figure><figcaption>" + escape(curve.title) + " (" + escape(curve.unit) +
                    ") over " + escape(curve.over) + "</figcaption>" + chart(curve) + "</figure>";
        html += "</div>";
    }
    if (!report.pictures.empty()) {
        html += "<h2>Test images: render, truth, error</h2>";
        for (const auto& picture : report.pictures) {
            const std::string_view png(reinterpret_cast<const char*>(picture.png.data()), picture.png.size());
            html += "<figure><img alt=\"" + escape(picture.caption) + "\" src=\"data:image/png;base64," + base64(png) +
                    "\"><figcaption>" + escape(picture.caption) + "</figcaption></figure>";
        }
    }
    if (report.images.size() > 1) html += "<h2>Every test image</h2>" + table(report.images);
    if (report.stages.size() > 1) html += "<h2>Time per stage</h2>" + table(report.stages);
    write_file(path, html + "</body></html>\n");
}

} // namespace gsh::examples
