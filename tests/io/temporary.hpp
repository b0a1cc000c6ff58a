// SPDX-License-Identifier: Apache-2.0
/// @file  A directory for one test, and a check of an error's message.
#pragma once

#include "support/contains.hpp"

#include <doctest/doctest.h>

#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <stdlib.h>

#include <filesystem>
#include <initializer_list>
#include <string>
#include <string_view>

namespace gsh::test {

/// A new directory. The destructor removes it.
class Temporary {
public:
    explicit Temporary(const std::filesystem::path& parent = std::filesystem::temp_directory_path()) {
        std::string name = (parent / "gsh-test-XXXXXX").string();
        REQUIRE(mkdtemp(name.data()) != nullptr);
        path_ = name;
    }
    ~Temporary() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    Temporary(const Temporary&) = delete;
    Temporary& operator=(const Temporary&) = delete;

    [[nodiscard]] std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
    [[nodiscard]] std::size_t file_count() const {
        std::size_t count = 0;
        for (const auto& entry : std::filesystem::directory_iterator(path_)) count += entry.is_regular_file();
        return count;
    }

private:
    std::filesystem::path path_;
};

/// The file without its last `bytes`.
inline void truncate_file(const std::filesystem::path& path, std::size_t bytes) {
    std::filesystem::resize_file(path, std::filesystem::file_size(path) - bytes);
}

/// Checks that the function throws E and that the message contains all of the words.
template <class E = Error, class Deed>
void check_throws(const Deed& deed, std::initializer_list<std::string_view> words) {
    try {
        deed();
        FAIL_CHECK("nothing was thrown");
    } catch (const E& error) {
        const std::string message = error.what();
        for (const std::string_view word : words) {
            INFO("looking for '" << std::string(word) << "' in: " << message);
            CHECK(message == gsh::test::contains(word));
        }
    } catch (const std::exception& error) {
        FAIL_CHECK("another type was thrown: " << std::string(error.what()));
    }
}

} // namespace gsh::test
