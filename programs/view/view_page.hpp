// SPDX-License-Identifier: Apache-2.0
/// @file  The page of gsh-view as one HTML file: the files of programs/web/, which are compiled into the program.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh::programs {

/// Name and content of each file of programs/web/. Defined in a source file that cmake/EmbedFiles.cmake writes.
const std::vector<std::pair<std::string_view, std::string_view>>& web_files();

/// A block of data that a page carries itself, so that it needs no server. programs/web/source.js reads it.
struct PageData {
    std::string id; ///< "scene" (describe), "gaussians" (package_scene), "motion-P-M" (package_motion)
    std::string bytes;
};

/// The page, with its style sheet and scripts inside. It refers to nothing outside itself but the server that it came
/// from; with data, not even to that. `more_script` is run after the page's own scripts; tests drive the page by it.
[[nodiscard]] std::string make_page(const std::vector<PageData>& data = {}, std::string_view more_script = {});

} // namespace gsh::programs
