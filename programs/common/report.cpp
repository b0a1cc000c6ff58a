// SPDX-License-Identifier: Apache-2.0
#include "common/report.hpp"

#include "common/base64.hpp"

#include <gsh/io/file/atomic_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::programs {

namespace detail {

std::string escape(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '&')
            out += "&amp;";
        else if (c == '<')
            out += "&lt;";
        else if (c == '>')
            out += "&gt;";
        else if (c == '"')
            out += "&quot;";
        else
            out += c;
    }
    return out;
}

namespace {

std::string number(double value, int digits = 4) {
    char text[32];
    std::snprintf(text, sizeof text, "%.*g", digits, value);
    return text;
}

/// A curve's points, or of very many the lowest and the highest of each piece, which look the same.
std::vector<std::pair<double, double>> drawn(const std::vector<std::pair<double, double>>& points) {
    constexpr std::size_t pieces = 1000; // a chart is narrower than that
    if (points.size() <= 2 * pieces) return points;
    std::vector<std::pair<double, double>> result;
    for (std::size_t k = 0; k < pieces; ++k) {
        const auto at = [&](std::size_t piece) {
            return points.begin() + static_cast<std::ptrdiff_t>(piece * points.size() / pieces);
        };
        auto [low, high] =
            std::minmax_element(at(k), at(k + 1), [](const auto& a, const auto& b) { return a.second < b.second; });
        if (high < low) std::swap(low, high);
        result.insert(result.end(), {*low, *high});
    }
    return result;
}

/// A small SVG line chart. All charts have the same width on a page, so their letters have the same size.
std::string chart(const Curve& curve) {
    constexpr double width = 360, height = 180, left = 46, right = 12, top = 8, bottom = 24;
    if (curve.points.size() < 2) return {};
    double x_max = 1, low = INFINITY, high = -INFINITY;
    for (const auto& [x, y] : curve.points) {
        x_max = std::max(x_max, x);
        low = std::min(low, y), high = std::max(high, y);
    }
    if (!(high > low)) high = low + 1;
    const auto px = [&](double x) { return left + (width - left - right) * x / x_max; };
    const auto py = [&](double y) { return height - bottom - (height - top - bottom) * (y - low) / (high - low); };

    std::string svg = "<svg viewBox=\"0 0 " + number(width) + " " + number(height) + "\" role=\"img\" aria-label=\"" +
                      escape(curve.title) + "\">";
    for (int i = 0; i <= 4; ++i) {
        const double y = low + (high - low) * i / 4;
        svg += "<line class=\"grid\" x1=\"" + number(left) + "\" x2=\"" + number(width - right) + "\" y1=\"" +
               number(py(y)) + "\" y2=\"" + number(py(y)) + "\"/><text x=\"" + number(left - 6) + "\" y=\"" +
               number(py(y) + 4) + "\" text-anchor=\"end\">" + number(y, 3) + "</text>";
        const double x = x_max * i / 4;
        svg += "<text x=\"" + number(px(x)) + "\" y=\"" + number(height - 6) + "\" text-anchor=\"" +
               (i == 4 ? "end" : "middle") + "\">" + number(x, 5) + "</text>";
    }
    svg += "<polyline points=\"";
    for (const auto& [x, y] : drawn(curve.points)) svg += number(px(x), 6) + "," + number(py(y), 6) + " ";
    return svg + "\"/></svg>";
}

/// An image element with its pixels inside.
std::string image(const Picture& picture) {
    const std::string_view png(reinterpret_cast<const char*>(picture.png.data()), picture.png.size());
    return "<img alt=\"" + escape(picture.caption) + "\" src=\"data:image/png;base64," + base64(png) + "\">";
}

std::string figure(const Picture& picture) {
    return "<figure>" + image(picture) + "<figcaption>" + escape(picture.caption) + "</figcaption></figure>";
}

/// Two pictures, of which a slider shows the left part of one and the right part of the other. It follows the mouse,
/// a finger and the arrow keys.
std::string wiper(const Picture& left, const Picture& right) {
    return "<figure class=\"wiper\"><div>" + image(right) + image(left) +
           "<input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"wipe between " +
           escape(left.caption) + " and " + escape(right.caption) + "\"></div><figcaption><span>" +
           escape(left.caption) + "</span><span>" + escape(right.caption) + "</span></figcaption></figure>";
}

constexpr std::string_view wiper_script =
    "<script>for(const box of document.querySelectorAll('.wiper div')){const slider=box.querySelector('input');"
    "const show=()=>box.style.setProperty('--at',slider.value+'%');slider.oninput=show;"
    "box.onpointermove=e=>{if(e.pointerType==='mouse'){const r=box.getBoundingClientRect();"
    "slider.value=100*(e.clientX-r.left)/r.width;show()}};show()}</script>";

} // namespace

std::string table(const std::vector<std::vector<std::string>>& rows) {
    std::string html = "<div class=\"wide\"><table>";
    for (std::size_t r = 0; r < rows.size(); ++r) {
        html += "<tr>";
        for (const auto& cell : rows[r])
            html += (r == 0 ? "<th>" : "<td>") + escape(cell) + (r == 0 ? "</th>" : "</td>");
        html += "</tr>";
    }
    return html + "</table></div>";
}

std::string page_head(const std::string& title) {
    return "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">"
           "<meta name=\"viewport\" content=\"width=device-width\"><title>" +
           escape(title) +
           "</title><style>"
           "body{font:16px/1.5 system-ui,sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;"
           "color:#222;background:#fff}h1{font-weight:600;line-height:1.2}h2{font-weight:600;margin-top:2.5rem}"
           "table{border-collapse:collapse;font-variant-numeric:tabular-nums}"
           "td,th{padding:.25rem 1rem .25rem 0;text-align:left;vertical-align:top;border-bottom:1px solid #ddd}"
           ".wide{overflow-x:auto}.facts td:last-child,.more{color:#555}"
           "figure{margin:0 0 1.5rem}img{max-width:100%}figcaption{color:#555}"
           ".verdict{font-size:1.25rem}pre{background:#f4f4f4;padding:.6rem .8rem;margin:.2rem 0 1rem;overflow-x:auto}"
           ".wiper{max-width:40rem}.wiper div{position:relative;--at:50%}.wiper img{display:block;width:100%}"
           ".wiper img+img{position:absolute;inset:0;clip-path:inset(0 calc(100% - var(--at)) 0 0)}"
           ".wiper div::after{content:'';position:absolute;top:0;bottom:0;left:var(--at);width:2px;background:#1769aa;"
           "pointer-events:none}"
           ".wiper input{position:absolute;inset:0;width:100%;height:100%;margin:0;opacity:0;cursor:ew-resize;"
           "touch-action:pan-y}"
           ".wiper div:focus-within{outline:3px solid #1769aa}.wiper figcaption{display:flex;justify-content:"
           "space-between}"
           ".curves{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,22rem),1fr));gap:1rem 2rem}"
           "svg{width:100%;max-width:30rem}svg text{font-size:12px;fill:#555}.grid{stroke:#eee}"
           "polyline{fill:none;stroke:#1769aa;stroke-width:1.5}"
           "@media(max-width:36rem){.facts tr{display:block;padding:.4rem 0;border-bottom:1px solid #ddd}"
           ".facts td,.facts th{display:inline;border:0;padding-right:.5rem}.facts td:last-child{display:block}}"
           "</style></head><body><h1>" +
           escape(title) + "</h1>";
}

} // namespace detail

void write_report(const std::filesystem::path& path, const Report& report) {
    using namespace detail;
    std::string html = page_head(report.title);
    if (!report.verdict.empty()) html += "<p class=\"verdict\">" + escape(report.verdict) + "</p>";
    if (!report.render.png.empty()) html += wiper(report.render, report.photograph);
    if (!report.turn.png.empty()) html += figure(report.turn);
    if (!report.advice.empty()) {
        html += "<h2>What would make it better</h2><ul>";
        for (const auto& [text, more] : report.advice)
            html += "<li>" + escape(text) + " <span class=\"more\">Read " + escape(more) + ".</span></li>";
        html += "</ul>";
    }
    if (!report.next.empty()) {
        html += "<h2>What to do next</h2>";
        for (const auto& [purpose, command] : report.next)
            html += "<div>" + escape(purpose) + "</div><pre>" + escape(command) + "</pre>";
    }
    html += "<h2>Figures</h2><table class=\"facts\">";
    for (const Fact& fact : report.facts)
        html += "<tr><th>" + escape(fact.name) + "</th><td>" + escape(fact.value) + "</td><td>" + escape(fact.meaning) +
                "</td></tr>";
    html += "</table>";
    if (report.motion.size() > 1)
        html += "<h2>Seen and new motion</h2><p>Means over the test images of motion that was trained on, and of "
                "motion that was left out of training.</p>" +
                table(report.motion);
    if (report.people.size() > 1)
        html += "<h2>Each person</h2><p>On the pixels that show the person.</p>" + table(report.people);
    if (!report.pictures.empty()) {
        html += "<h2>Test images: render, truth, error</h2>";
        for (const auto& picture : report.pictures) html += figure(picture);
    }
    if (!report.curves.empty()) {
        html += "<h2>Training</h2><div class=\"curves\">";
        for (const auto& curve : report.curves)
            html += "<figure><figcaption>" + escape(curve.title) + " (" + escape(curve.unit) + ") over " +
                    escape(curve.over) + "</figcaption>" + chart(curve) + "</figure>";
        html += "</div>";
    }
    if (report.images.size() > 1) html += "<h2>Every test image</h2>" + table(report.images);
    if (report.stages.size() > 1) html += "<h2>Time per stage</h2>" + table(report.stages);
    html += "<h2>How the figures were taken</h2><p>" + escape(report.protocol) + "</p>";
    write_file(path, html + std::string(wiper_script) + "</body></html>\n");
}

} // namespace gsh::programs
