// SPDX-License-Identifier: Apache-2.0
/// @file  The programs are hardened: readelf finds in each of them what the compiler and the linker were asked for.
#include "support/skip.hpp"

#include <doctest/doctest.h>

#include <cstdio>
#include <filesystem>
#include <regex>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

/// What readelf prints of a program; empty where it is missing, or does not understand the file.
std::string elf_of(const std::string& name) {
    const std::string command =
        "LC_ALL=C readelf --wide --file-header --program-headers --dynamic --dyn-syms '" GSH_PROGRAM_DIR "/" + name +
        "' 2>&1";
    std::string text;
    if (std::FILE* const output = ::popen(command.c_str(), "r")) {
        char block[4096];
        while (const std::size_t count = std::fread(block, 1, sizeof block, output)) text.append(block, count);
        if (::pclose(output) != 0) text.clear();
    }
    return text;
}

bool has(const std::string& text, const char* pattern) {
    return std::regex_search(text, std::regex(pattern));
}

} // namespace

TEST_CASE("programs are position-independent, with full RELRO, a stack protector and checked functions of libc") {
#ifndef GSH_HARDENED
    return gsh::test::skip("a build with sanitizers is not hardened");
#else
    if (elf_of("gsh-render").empty()) return gsh::test::skip("readelf is not there");
    std::size_t count = 0;
    for (const auto& source : fs::directory_iterator(fs::path(GSH_SOURCE_DIR) / "programs")) {
        if (source.path().extension() != ".cpp") continue;
        std::string name = source.path().stem().string();
        name.replace(name.find('_'), 1, "-");
        CAPTURE(name);
        ++count;
        const std::string elf = elf_of(name);
        CHECK(has(elf, "Type:\\s+DYN "));
        CHECK(has(elf, "FLAGS_1\\).*\\bPIE\\b"));
        CHECK(has(elf, "\\bGNU_RELRO\\b"));
        CHECK(has(elf, "\\bBIND_NOW\\b"));
        CHECK(has(elf, "UND __stack_chk_fail@"));
#ifdef GSH_FORTIFIED
        CHECK(has(elf, "UND __[a-z]*printf_chk@"));
#endif
    }
    CHECK(count >= 11);
#endif
}
