// SPDX-License-Identifier: Apache-2.0
/// @file  Damages a file in many ways: readers must return or throw gsh's errors with the file's name, nothing else.
#pragma once

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <gsh/core/error.hpp>
#include <gsh/core/rng.hpp>

#include <cstddef>
#include <exception>
#include <filesystem>
#include <fstream>
#include <string>

namespace gsh::test {

/// Calls `read(path)` for the file cut at every `step`-th byte, and with one to three bytes replaced, `count` times.
/// Returns how many readings were refused.
template <class Read>
std::size_t read_damaged(const std::string& bytes, const std::filesystem::path& path, std::size_t step,
                         std::size_t count, const Read& read) {
    std::size_t refused = 0;
    const auto attempt = [&](const std::string& content, const std::string& what) {
        std::filesystem::remove(path); // file systems write a file that replaces another one to the disk at once
        std::ofstream(path, std::ios::binary).write(content.data(), static_cast<std::streamsize>(content.size()));
        try {
            read(path);
        } catch (const Error& error) {
            ++refused;
            const std::string message = error.what();
            if (message.find(path.filename().string()) == std::string::npos || message.find('\n') != std::string::npos)
                FAIL_CHECK(what << ": the message must name the file, in one line: " << message);
        } catch (const std::exception& error) {
            FAIL_CHECK(what << ": another exception: " << std::string(error.what()));
        }
    };
    for (std::size_t size = 0; size < bytes.size(); size += step)
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
