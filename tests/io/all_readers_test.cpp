// SPDX-License-Identifier: Apache-2.0
/// @file  Every reader over damaged files: it reads or refuses with a short message that names the file, in bounded time
///        and memory.

#include "io/damage.hpp"
#include "io/every_sample.hpp"
#include "io/npz_files.hpp"
#include "io/temporary.hpp"

#include <gsh/io/file/input_file.hpp>

#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

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

/// Writes a sample as a seed of its fuzz target: a file as it is, a folder as a zip archive.
void write_seed(const test::Sample& sample, const fs::path& corpus) {
    fs::create_directories(corpus / sample.target);
    const fs::path seed = corpus / sample.target / sample.place.filename();
    if (fs::is_regular_file(sample.place)) {
        fs::copy_file(sample.place, seed, fs::copy_options::overwrite_existing);
        return;
    }
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(sample.place))
        if (entry.is_regular_file()) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    test::ZipFile zip(seed.string() + ".zip");
    for (const fs::path& file : files) zip.add(file.lexically_relative(sample.place).string(), read_file(file), true);
}

} // namespace

TEST_CASE("the seeds of the fuzz targets are written where a variable asks for it") {
    const char* to = std::getenv("GSH_WRITE_SEEDS");
    if (!to) return;
    const test::Temporary folder;
    for (const test::Sample& sample : test::write_samples(folder / "")) write_seed(sample, to);
}

TEST_CASE("damaged files of every kind are read or refused by name, in time and within memory") {
    const test::Temporary folder;
    const auto samples = test::write_samples(folder / "");
    for (const test::Sample& sample : samples) {
        CAPTURE(sample.place.string());
        if (sample.whole)
            CHECK_NOTHROW(sample.read(sample.place));
        else
            CHECK_THROWS_AS(sample.read(sample.place), Error);
    }
    const MemoryLimit limit;
    for (const test::Sample& sample : samples) {
        std::vector<fs::path> files;
        for (const std::string& name : sample.damage) files.push_back(sample.place / name);
        if (sample.damage.empty()) files.push_back(sample.place);
        for (const fs::path& file : files) {
            CAPTURE(file.string());
            const std::string good = read_file(file);
            const std::size_t refused = test::read_damaged(
                good, file, good.size() / 40 + 1, 200, [&](const fs::path&) { sample.read(sample.place); },
                sample.damage.empty() ? fs::path() : sample.place);
            CHECK(refused > 10);
            write_file(file, good, Sync::none);
        }
    }
}
