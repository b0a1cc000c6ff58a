// SPDX-License-Identifier: Apache-2.0
/// @file  The entry points that libFuzzer calls. One program holds all targets; its name chooses one: fuzz-NAME.
#include "fuzz/containers.hpp"
#include "fuzz/target.hpp"
#include "support/shown_message.hpp"

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <random>
#include <string>

#if __has_feature(address_sanitizer)
#include <sanitizer/allocator_interface.h>
#define GSH_FUZZ_COUNTS_MEMORY 1
#endif

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

namespace gsh::fuzz {

std::vector<Target>& targets() {
    static std::vector<Target> all;
    return all;
}

namespace {

const Target* chosen = nullptr;

/// Ends the process unless the message is what a user may see: one line of printable text that begins with the file.
void check_message(std::string_view message, std::string_view path) {
    // Who writes a joint map needs the names of the rig's joints: at most 200, shortened to 40 letters.
    const std::size_t most = message.find("joint map") == std::string_view::npos ? 500 : 10000;
    if (test::is_shown_message(message, path) && message.size() <= most + 2 * path.size()) return;
    std::fprintf(stderr, "fuzz: a message must begin with the file and be one short printable line: %s\n",
                 std::string(message.substr(0, 2000)).c_str());
    std::abort();
}

/// Bytes that are allocated, and the most there were since restart(). Several threads may allocate.
class Memory {
public:
    Memory() {
#ifdef GSH_FUZZ_COUNTS_MEMORY
        __sanitizer_install_malloc_and_free_hooks(
            [](const volatile void* at, std::size_t) { memory.add(static_cast<std::ptrdiff_t>(size_of(at))); },
            [](const volatile void* at) { memory.add(-static_cast<std::ptrdiff_t>(size_of(at))); });
#endif
    }
    void restart() {
        before_ = now_.load();
        most_ = before_;
    }
    /// Ends the process if an input of so many bytes took more memory than it may; keeps the largest for the report.
    void check(std::size_t input) {
        const auto used = static_cast<std::size_t>(most_ - before_);
        largest_ = std::max(largest_, used);
        if (used <= 2 * input + spare) return;
        std::fprintf(stderr, "fuzz: an input of %zu bytes took %zu bytes of memory\n", input, used);
        std::abort();
    }
    [[nodiscard]] std::size_t largest() const { return largest_; }

    static Memory memory;

private:
    static constexpr std::size_t spare = std::size_t(64) << 20; // beside twice the input
#ifdef GSH_FUZZ_COUNTS_MEMORY
    static std::size_t size_of(const volatile void* at) {
        return __sanitizer_get_allocated_size(const_cast<const void*>(at));
    }
#endif
    void add(std::ptrdiff_t size) {
        const std::ptrdiff_t sum = now_ += size;
        for (std::ptrdiff_t known = most_; sum > known && !most_.compare_exchange_weak(known, sum);) {
        }
    }

    std::atomic<std::ptrdiff_t> now_ = 0, most_ = 0;
    std::ptrdiff_t before_ = 0;
    std::size_t largest_ = 0;
};
Memory Memory::memory;

} // namespace

void run_once(const Target& target, std::string_view bytes) {
    const bool is_folder = target.file.ends_with("/");
    const std::filesystem::path path = is_folder
                                           ? unpack_to_scratch(target.file.substr(0, target.file.size() - 1), bytes)
                                           : std::filesystem::path(target.file);
    Memory::memory.restart();
    try {
        if (is_folder)
            target.run(path);
        else
            target.run(InputFile::in_memory(path, bytes));
    } catch (const Error& error) {
        check_message(error.what(), path.string());
    } catch (const std::exception& error) {
        std::fprintf(stderr, "fuzz: an exception that is not gsh's: %s\n", error.what());
        std::abort();
    }
    Memory::memory.check(bytes.size());
}

namespace {

/// Changes one part of a container, or their list.
void mutate_parts(Container& container, std::minstd_rand& random, std::size_t most) {
    auto& parts = container.parts;
    const auto any = [&](std::size_t count) { return static_cast<std::size_t>(random() % count); };
    Container::Part& part = parts[any(parts.size())];
    const bool has_list = container.kind == Container::Kind::zip || container.kind == Container::Kind::png;
    switch (has_list ? any(16) : 4) {
    case 0: // one is missing
        if (parts.size() > 1) parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(any(parts.size())));
        return;
    case 1: // one has the contents of another
        part.bytes = std::string(parts[any(parts.size())].bytes);
        return;
    case 2: // one stands there twice
        parts.push_back(Container::Part(part));
        return;
    case 3: // one has another's name
        part.name = std::string(parts[any(parts.size())].name);
        return;
    default:
        break;
    }
    const std::size_t room = std::max<std::size_t>(std::min(most, 2 * part.bytes.size() + 64), 1);
    std::string bytes = part.bytes;
    bytes.resize(std::max(room, bytes.size()));
    const std::size_t size =
        LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(bytes.data()), std::min(part.bytes.size(), room), room);
    bytes.resize(size);
    part.bytes = std::move(bytes);
}

/// Mutates the inside of a container with its checksums repaired, of containers within containers too.
std::string mutated(std::string_view bytes, std::minstd_rand& random, std::size_t most, int levels = 2) {
    if (auto container = levels > 0 && random() % 8 ? take_apart(bytes) : std::nullopt) {
        auto& part = container->parts[random() % container->parts.size()];
        if (random() % 2 && take_apart(part.bytes))
            part.bytes = mutated(part.bytes, random, most, levels - 1);
        else
            mutate_parts(*container, random, most);
        return put_together(*container);
    }
    std::string changed(bytes);
    changed.resize(std::max<std::size_t>(most, bytes.size()));
    changed.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(changed.data()), bytes.size(), changed.size()));
    return changed;
}

} // namespace

} // namespace gsh::fuzz

extern "C" int LLVMFuzzerInitialize(int*, char*** arguments) {
    const std::string program = std::filesystem::path((*arguments)[0]).filename().string();
    auto& all = gsh::fuzz::targets();
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
    for (const gsh::fuzz::Target& target : all)
        if (program == "fuzz-" + std::string(target.name)) gsh::fuzz::chosen = &target;
    std::atexit([] { std::fprintf(stderr, "stat::memory_of_an_input: %zu\n", gsh::fuzz::Memory::memory.largest()); });
    if (gsh::fuzz::chosen) return 0;
    if (program != "gsh-fuzz") std::fprintf(stderr, "%s: there is no such target\n", program.c_str());
    for (const gsh::fuzz::Target& target : all) std::printf("%s\n", std::string(target.name).c_str());
    std::exit(program == "gsh-fuzz" ? 0 : 2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    gsh::fuzz::run_once(*gsh::fuzz::chosen, {reinterpret_cast<const char*>(data), size});
    return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t most, unsigned seed) {
    std::minstd_rand random(seed);
    const std::string changed = gsh::fuzz::mutated({reinterpret_cast<const char*>(data), size}, random, most);
    if (changed.size() > most) return LLVMFuzzerMutate(data, size, most);
    std::memcpy(data, changed.data(), changed.size());
    return changed.size();
}
