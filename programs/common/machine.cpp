// SPDX-License-Identifier: Apache-2.0
#include "common/machine.hpp"

#include "common/gpu.hpp"

#include <gsh/core/config.hpp>
#include <gsh/core/error.hpp>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>

namespace gsh::programs {

Machine::Machine(const BackendOption& option) : host_(option.threads) {
    const bool cuda = option.backend == "cuda";
    if (!cuda && option.device) throw ValueError("--device needs --backend cuda");
    const bool mixed = option.precision == "mixed";
    if (cuda)
        gpu_ = open_gpu(option.device.value_or(0), mixed);
    else if (mixed)
        host_.set_precision(Precision::mixed);
    computed_on_ = {option.backend, cuda ? name_of(*gpu_) : std::string(), option.precision, host_.thread_count(),
                    GSH_TEXT(GSH_ISA)};
}

std::optional<std::uint64_t> Machine::peak_gpu_memory() const {
    if (gpu_ == nullptr) return std::nullopt;
    return peak_memory_of(*gpu_);
}

std::uint64_t resident_bytes() {
    std::ifstream file("/proc/self/statm");
    std::uint64_t total = 0, resident = 0;
    file >> total >> resident;
    return resident * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

std::uint64_t peak_memory_bytes() {
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    return static_cast<std::uint64_t>(usage.ru_maxrss) * 1024; // Linux counts in KiB
}

std::uint64_t memory_of_machine() {
    const std::uint64_t installed =
        static_cast<std::uint64_t>(sysconf(_SC_PHYS_PAGES)) * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
    std::uint64_t most = installed;
    std::ifstream groups("/proc/self/cgroup"); // lines of NUMBER:CONTROLLERS:/PATH; version 2 has no controllers
    for (std::string line; std::getline(groups, line);) {
        const auto first = line.find(':'), second = line.find(':', first + 1);
        if (first == std::string::npos || second == std::string::npos) continue;
        const std::string controllers = line.substr(first + 1, second - first - 1);
        if (!controllers.empty() && ("," + controllers + ",").find(",memory,") == std::string::npos) continue;
        const std::string root = controllers.empty() ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory";
        const char* const name = controllers.empty() ? "/memory.max" : "/memory.limit_in_bytes";
        for (std::string path = line.substr(second + 1);;
             path.resize(path.rfind('/'))) { // a group's limit is its parts'
            std::uint64_t limit = 0;
            if (std::ifstream file(root + path + name); file >> limit) most = std::min(most, limit); // not for "max"
            if (path.rfind('/') == std::string::npos) break;
        }
    }
    return most;
}

std::string processor_name() {
    std::ifstream file("/proc/cpuinfo");
    for (std::string line; std::getline(file, line);)
        if (const auto colon = line.find(": "); line.starts_with("model name") && colon != std::string::npos)
            return line.substr(colon + 2);
    return "an unknown processor";
}

} // namespace gsh::programs
