#!/usr/bin/env bash
# nlohmann-json 3.11.2 (Debian 12): destroying a value takes new memory, as much as a list or an object itself.
#
# Expected: a destructor frees memory. One that is noexcept cannot report that there is none.
# Seen: ~basic_json moves the children of each list and object to a vector that it allocates, against deep recursion: 16
#   bytes a child, for flat lists of numbers too. A list of a million numbers takes 16 MB, and 16 MB more while it is
#   destroyed.
# Output: bytes allocated by destructors: 16000000 for the list, 4800 for a flat object of 300 members.
# Matters: the peak of memory of a program that reads JSON, such as glTF by tinygltf, is where it lets go of it. Where
#   memory has run out, the exception of the failed allocation leaves a noexcept destructor, which ends the program; a
#   caller that would have caught std::bad_alloc never sees it. Taking lists and objects apart by hand, from the leaves
#   up, avoids it: an empty one allocates nothing.
# It needs g++ and apt's package lists of Debian 12 (bookworm); the package is unpacked here, not installed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
apt-get download nlohmann-json3-dev=3.11.2-2 >log.txt 2>&1
dpkg -x nlohmann-json3-dev_*.deb json
cat >destroy.cpp <<'CPP'
#include <nlohmann/json.hpp>

#include <cstdio>
#include <cstdlib>
#include <new>
#include <string>

static std::size_t allocated = 0;

void* operator new(std::size_t size) {
    allocated += size;
    if (void* block = std::malloc(size)) return block;
    throw std::bad_alloc();
}
void operator delete(void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }

template <class Change>
std::size_t bytes_of_destructor(nlohmann::json value, const Change& change) {
    auto* kept = new nlohmann::json(std::move(value));
    change(*kept);
    allocated = 0;
    delete kept;
    return allocated;
}

int main() {
    using nlohmann::json;
    const auto nothing = [](json&) {};
    json object = json::object();
    for (int i = 0; i < 300; ++i) object["member " + std::to_string(i)] = i;
    std::printf("a number: %zu\n", bytes_of_destructor(1.5, nothing));
    std::printf("a list of a million numbers: %zu\n", bytes_of_destructor(json(std::vector<double>(1000000, 1.5)), nothing));
    std::printf("an object of 300 numbers: %zu\n", bytes_of_destructor(object, nothing));
    std::printf("the list, emptied before: %zu\n", bytes_of_destructor(
        json(std::vector<double>(1000000, 1.5)), [](json& list) { list.get_ref<json::array_t&>().clear(); }));
}
CPP
g++ -std=c++17 -O1 -Ijson/usr/include destroy.cpp -o destroy
./destroy | tee seen.txt
diff - seen.txt <<'TXT' || { echo "changed: what destructors allocate"; exit 1; }
a number: 0
a list of a million numbers: 16000000
an object of 300 numbers: 4800
the list, emptied before: 0
TXT
