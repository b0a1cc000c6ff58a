// SPDX-License-Identifier: Apache-2.0
/// @file  What the loads of gsh-load share: options, the memory of the process, and the verdict.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>

#include <unistd.h>

namespace gsh::load {

/// Options of the command line, by their names without dashes.
class Options {
public:
    Options(int argc, char** argv) {
        for (int i = 2; i < argc; i += 2) {
            const std::string name = argv[i];
            if (!name.starts_with("--") || i + 1 == argc)
                throw std::runtime_error("found '" + name + "', expected --NAME NUMBER");
            numbers_[name.substr(2)] = std::strtod(argv[i + 1], nullptr);
        }
    }
    /// The number of an option, or the usual one.
    [[nodiscard]] double number(const std::string& name, double usual) const {
        const auto found = numbers_.find(name);
        return found == numbers_.end() ? usual : found->second;
    }
    [[nodiscard]] std::size_t count(const std::string& name, std::size_t usual) const {
        return static_cast<std::size_t>(number(name, static_cast<double>(usual)));
    }

private:
    std::map<std::string, double> numbers_;
};

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

void pose_and_draw(const Options& options, Verdict& verdict);
void serve_pages(const Options& options, Verdict& verdict);
void train_people(const Options& options, Verdict& verdict);
void long_motion(const Options& options, Verdict& verdict);

} // namespace gsh::load
