// SPDX-License-Identifier: Apache-2.0
#include "view/view_page.hpp"

#include "common/base64.hpp"

#include <gsh/core/error.hpp>

#include <cstddef>

namespace gsh::programs {

namespace {

std::string_view web_file(std::string_view name) {
    for (const auto& [known, content] : web_files())
        if (known == name) return content;
    throw ValueError("make_page: programs/web/ has no file " + std::string(name));
}

/// Replaces each `before` NAME `after` by what `content` returns for the name.
template <class Content>
std::string replaced(const std::string& text, std::string_view before, std::string_view after, const Content& content) {
    std::string result;
    std::size_t at = 0;
    for (;;) {
        const std::size_t begin = text.find(before, at);
        if (begin == std::string::npos) return result + text.substr(at);
        const std::size_t name = begin + before.size(), end = text.find(after, name);
        check_value(end != std::string::npos, "make_page", "a reference in the page has no end");
        result += text.substr(at, begin - at) + content(text.substr(name, end - name));
        at = end + after.size();
    }
}

} // namespace

std::string make_page(const std::vector<PageData>& data, std::string_view more_script) {
    std::string page(web_file("index.html"));
    page = replaced(page, "<link rel=\"stylesheet\" href=\"", "\">",
                    [](const std::string& name) { return "<style>\n" + std::string(web_file(name)) + "</style>"; });
    std::string carried;
    for (const PageData& block : data)
        carried += "<script type=\"application/octet-stream\" data-carried=\"" + block.id + "\">" +
                   base64(block.bytes) + "</script>\n";
    const std::string marker = "<!-- data -->\n";
    const std::size_t at = page.find(marker);
    check_value(at != std::string::npos, "make_page", "index.html has no place for data");
    page.replace(at, marker.size(), carried);
    page = replaced(page, "<script src=\"", "\"></script>", [](const std::string& name) {
        return "<script data-module=\"" + name + "\">\n" + std::string(web_file(name)) + "</script>";
    });
    if (!more_script.empty()) {
        const std::size_t end = page.rfind("</body>");
        page.insert(end, "<script>\n" + std::string(more_script) + "</script>\n");
    }
    return page;
}

} // namespace gsh::programs
