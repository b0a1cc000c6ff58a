// SPDX-License-Identifier: Apache-2.0
/// @file  Damages a file in many ways: readers must return or throw gsh's errors with the file's name, nothing else.
#pragma once

#include "io/temporary.hpp"
#include "support/shown_message.hpp"

#include <doctest/doctest.h>

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/core/rng.hpp>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <exception>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

namespace gsh::test {

/// Checks a message about a file: it begins with the path of `read_folder`, or of the file's folder, is one line of
/// printable UTF-8, and beside the path has at most 1000 bytes, 500 but for the names of a rig's joints, which a joint
/// map needs.
inline void check_message(const std::string& message, const std::filesystem::path& path, const std::string& what,
                          const std::filesystem::path& read_folder = {}) {
    const std::string folder = (read_folder.empty() ? path.parent_path() : read_folder).string();
    const std::size_t most = message.find("The joints are") == std::string::npos ? 500 : 1000;
    if (!is_shown_message(message, folder) || message.size() > most + path.string().size())
        FAIL_CHECK(what << ": the message must begin with the file, be printable and short: "
                        << detail::shortened(message.substr(0, 40)) << " ... " << message.size()
                        << " bytes: " << message.substr(0, 800));
}

/// Calls `read(path)` for the file cut at every `step`-th byte, and with one to three bytes replaced, `count` times.
/// Messages begin with `folder`, or else with the file's. Returns how many readings were refused.
template <class Read>
std::size_t read_damaged(const std::string& bytes, const std::filesystem::path& path, std::size_t step,
                         std::size_t count, const Read& read, const std::filesystem::path& folder = {}) {
    std::size_t refused = 0;
    const auto attempt = [&](const std::string& content, const std::string& what) {
        std::filesystem::remove(path); // file systems write a file that replaces another one to the disk at once
        std::ofstream(path, std::ios::binary).write(content.data(), static_cast<std::streamsize>(content.size()));
        const auto begin = std::chrono::steady_clock::now();
        try {
            read(path);
        } catch (const Error& error) {
            ++refused;
            check_message(error.what(), path, what, folder);
        } catch (const std::exception& error) {
            FAIL_CHECK(what << ": another exception: " << std::string(error.what()));
        }
        const auto spent = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
        if (spent > 2) FAIL_CHECK(what << ": took " << spent << " s");
    };
    for (std::size_t size = 0; size < std::min<std::size_t>(bytes.size(), 65); ++size)
        attempt(bytes.substr(0, size), "cut at " + std::to_string(size));
    for (std::size_t size = 65; size < bytes.size(); size += step)
        attempt(bytes.substr(0, size), "cut at " + std::to_string(size));
    Rng rng(1);
    for (std::size_t n = 0; n < count; ++n) {
        std::string content = bytes;
        const std::size_t changes = 1 + n % 3;
        for (std::size_t k = 0; k < changes; ++k)
            content[static_cast<std::size_t>(rng.uniform(0, static_cast<double>(bytes.size())))] =
                static_cast<char>(static_cast<int>(rng.uniform(0, 256)));
        attempt(content, "change " + std::to_string(n));
    }
    return refused;
}

} // namespace gsh::test
