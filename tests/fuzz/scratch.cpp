// SPDX-License-Identifier: Apache-2.0
#include "fuzz/scratch.hpp"

#include "fuzz/containers.hpp"

#include <unistd.h>

#include <fstream>
#include <string>
#include <system_error>

namespace gsh::fuzz {

namespace {

/// A folder in memory, where there is one.
struct ScratchFolder {
    std::filesystem::path path;

    ScratchFolder() {
        std::error_code error;
        const bool shared = std::filesystem::is_directory("/dev/shm", error);
        path = (shared ? std::filesystem::path("/dev/shm") : std::filesystem::temp_directory_path()) /
               ("gsh-fuzz-" + std::to_string(::getpid()));
        std::filesystem::create_directories(path);
    }
    ~ScratchFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path, ignored);
    }
};

/// Whether a member's name stays in the folder, and no part of it is a folder and a file at once.
bool is_plain(const std::filesystem::path& name) {
    if (name.empty() || name.is_absolute() || name.string().size() > 200 || !name.has_filename()) return false;
    for (const auto& part : name)
        if (part == ".." || part == "." || part.string().find('\0') != std::string::npos) return false;
    return true;
}

} // namespace

const std::filesystem::path& scratch() {
    static const ScratchFolder folder;
    return folder.path;
}

std::filesystem::path unpack_to_scratch(std::string_view name, std::string_view archive) {
    const std::filesystem::path folder = scratch() / name;
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
    std::filesystem::create_directories(folder, ignored);
    const auto container = take_apart(archive);
    if (!container || container->kind != Container::Kind::zip) return folder;
    for (const Container::Part& part : container->parts) {
        if (!is_plain(part.name)) continue;
        const std::filesystem::path file = folder / part.name;
        std::filesystem::create_directories(file.parent_path(), ignored);
        std::ofstream(file, std::ios::binary).write(part.bytes.data(), static_cast<std::streamsize>(part.bytes.size()));
    }
    return folder;
}

} // namespace gsh::fuzz
