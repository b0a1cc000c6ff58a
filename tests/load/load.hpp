// SPDX-License-Identifier: Apache-2.0
/// @file  The loads of gsh-load, and what they share: the memory of the process, and the verdict.
#pragma once

#include <cstddef>
#include <fstream>
#include <iostream>
#include <string>

#include <unistd.h>

namespace gsh::load {

/// Resident memory of the process, bytes.
[[nodiscard]] inline std::size_t resident() {
    std::size_t all = 0, pages = 0;
    std::ifstream("/proc/self/statm") >> all >> pages;
    return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

/// What a load found. Each line is printed; one that does not hold makes the program end with exit code 1.
class Verdict {
public:
    void line(bool holds, const std::string& text) {
        std::cout << (holds ? "ok    " : "FAIL  ") << text << std::endl;
        all_hold_ = all_hold_ && holds;
    }
    [[nodiscard]] int exit_code() const { return all_hold_ ? 0 : 1; }

private:
    bool all_hold_ = true;
};

[[nodiscard]] inline std::string megabytes(double bytes) {
    const std::string text = std::to_string(bytes / 1e6);
    return text.substr(0, text.find('.') + 2) + " MB";
}

void pose_and_draw(std::size_t frames, Verdict& verdict);
void serve_pages(std::size_t pages, double seconds, Verdict& verdict);
void train_people(std::size_t people, std::size_t steps, Verdict& verdict);
void long_motion(std::size_t frames, Verdict& verdict);

} // namespace gsh::load
