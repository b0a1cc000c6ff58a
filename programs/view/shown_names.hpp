// SPDX-License-Identifier: Apache-2.0
/// @file  Names and messages for the page: names of files that tell them apart, and the words of the library's readers.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace gsh::programs {

/// The names of files without folders; where several have the same, with as many folders as tell them apart,
/// "hard/poses.npz"; a file that is given twice has a number the second time.
[[nodiscard]] std::vector<std::string> names_of_files(const std::vector<std::filesystem::path>& files);

/// A message of a reader of motions in words for the page. The page has no options of a program, so the message says
/// what can be done on the page instead.
[[nodiscard]] std::string page_words(std::string message);

/// The same for an error about the file `name`, which was opened on the page; says what is accepted if the format is
/// the reason.
[[nodiscard]] std::string page_error(const std::string& message, const std::string& name);

} // namespace gsh::programs
