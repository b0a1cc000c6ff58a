// SPDX-License-Identifier: Apache-2.0
/// @file  Every reader over damaged files: it reads or refuses with a short message that names the file, in bounded time
///        and memory.

#include "io/damage.hpp"
#include "io/every_file.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>
#include <string>

using namespace gsh;
namespace fs = std::filesystem;

namespace {

/// Lets the process take at most 1 GiB more. Sanitizers need the addresses themselves.
class MemoryLimit {
public:
    MemoryLimit() {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
        ::getrlimit(RLIMIT_AS, &before_);
        std::size_t pages = 0;
        std::ifstream("/proc/self/statm") >> pages;
        rlimit limit = before_;
        limit.rlim_cur = static_cast<rlim_t>(pages) * static_cast<rlim_t>(::sysconf(_SC_PAGESIZE)) + (rlim_t(1) << 30);
        is_set_ = pages > 0 && ::setrlimit(RLIMIT_AS, &limit) == 0;
#endif
    }
    ~MemoryLimit() {
        if (is_set_) ::setrlimit(RLIMIT_AS, &before_);
    }
    MemoryLimit(const MemoryLimit&) = delete;
    MemoryLimit& operator=(const MemoryLimit&) = delete;

private:
    rlimit before_{};
    bool is_set_ = false;
};

} // namespace

TEST_CASE("damaged files of every kind are read or refused by name, in time and within memory") {
    const test::Temporary folder;
    const auto samples = test::write_file_samples(folder / "");
    for (const test::FileSample& sample : samples) {
        CAPTURE(sample.name);
        CHECK_NOTHROW(sample.read(folder / sample.name));
    }
    const MemoryLimit limit;
    for (const test::FileSample& sample : samples) {
        CAPTURE(sample.name);
        const fs::path file = folder / sample.name;
        const std::string good = read_file(file);
        const std::size_t refused = test::read_damaged(good, file, good.size() / 40 + 1, 200, sample.read);
        CHECK(refused > (sample.name == "a.jpg" ? 60 : 10));
        write_file(file, good, Sync::none);
    }
}
