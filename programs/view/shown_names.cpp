// SPDX-License-Identifier: Apache-2.0
#include "view/shown_names.hpp"

#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <string_view>
#include <utility>

namespace gsh::programs {

namespace fs = std::filesystem;

namespace {

/// The last `count` parts of a path: "hard/poses.npz".
std::string last_parts(const fs::path& path, std::size_t count) {
    fs::path result;
    for (auto part = path.end(); part != path.begin() && count > 0; --count) {
        --part;
        if (*part == path.root_path()) break;
        result = result.empty() ? *part : *part / result;
    }
    return result.string();
}

constexpr std::array<std::string_view, 6> motion_endings{".npz", ".bvh", ".glb", ".gltf", ".vrm", ".vrma"};

/// "This page reads motions as .npz, .bvh, .glb, .gltf, .vrm and .vrma"
std::string accepted() {
    std::string text = "This page reads motions as ";
    for (const std::string_view ending : motion_endings)
        text.append(ending == motion_endings.front()  ? ""
                    : ending == motion_endings.back() ? " and "
                                                      : ", ")
            .append(ending);
    return text;
}

} // namespace

std::vector<std::string> names_of_files(const std::vector<fs::path>& files) {
    std::vector<fs::path> paths;
    for (const fs::path& file : files) {
        fs::path whole = fs::absolute(file).lexically_normal();
        if (!whole.has_filename()) whole = whole.parent_path(); // a folder with a slash at its end
        paths.push_back(std::move(whole));
    }
    std::vector<std::string> names;
    std::map<fs::path, int> seen;
    for (const fs::path& path : paths) {
        std::size_t parts = 1;
        const auto is_told_apart = [&] {
            return std::all_of(paths.begin(), paths.end(), [&](const fs::path& other) {
                return other == path || last_parts(other, parts) != last_parts(path, parts);
            });
        };
        while (!is_told_apart()) ++parts;
        const int times = ++seen[path];
        names.push_back(last_parts(path, parts) + (times > 1 ? " (" + std::to_string(times) + ")" : ""));
    }
    return names;
}

std::string page_words(std::string message) {
    static constexpr std::array<std::pair<std::string_view, std::string_view>, 8> words{{
        {"name them in a joint map (--joint-map FILE.json)",
         "gsh-motion can be told which joints they are, and makes an .npz that this page reads"},
        {"choose in a joint map (--joint-map FILE.json)",
         "gsh-motion can be told which of them it is, and makes an .npz that this page reads"},
        {"a joint map can choose others", "gsh-motion can be told others, and makes an .npz that this page reads"},
        {"state another by --input-fps, or by fps in a capture's cameras.json", "state another as File's fps"},
        {"(--input-fps)", "(File's fps)"},
        {"--input-fps", "File's fps"},
        {"give the folder that holds one for each frame",
         "gsh-motion makes an .npz, which this page reads, of the folder that holds one for each frame"},
        {": .npz, BVH, glTF or a folder", ": .npz, BVH or glTF"},
    }};
    for (const auto& [of_programs, of_page] : words)
        for (std::size_t at = 0; (at = message.find(of_programs, at)) != std::string::npos; at += of_page.size())
            message.replace(at, of_programs.size(), of_page);
    return message;
}

std::string page_error(const std::string& message, const std::string& name) {
    const std::string ending = fs::path(name).extension().string();
    const bool is_known = std::any_of(motion_endings.begin(), motion_endings.end(),
                                      [&](std::string_view known) { return gsh::detail::is_word(ending, known); });
    const std::string words = page_words(message);
    const bool is_of_format = !is_known || words.find("expected an .npz archive") != std::string::npos ||
                              words.find("not an .npz archive") != std::string::npos;
    return is_of_format ? words + ". " + accepted() : words;
}

} // namespace gsh::programs
