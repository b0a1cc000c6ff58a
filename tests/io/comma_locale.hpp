// SPDX-License-Identifier: Apache-2.0
/// @file  A locale in which numbers have a comma instead of a point, while a test runs.
#pragma once

#include "io/temporary.hpp"

#include <doctest/doctest.h>

#include <clocale>
#include <cstdlib>
#include <initializer_list>
#include <string>

namespace gsh::test {

/// Sets LC_NUMERIC to a German or French locale: one that is installed, or one that glibc's localedef makes here. If
/// there is neither, the locale stays as it is. The destructor sets it back.
class CommaLocale {
public:
    CommaLocale() : before_(std::setlocale(LC_NUMERIC, nullptr)) {
        if (set()) return;
        const std::string make = "localedef -f UTF-8 -i de_DE " + (folder_ / "de_DE.UTF-8").string() + " 2>/dev/null";
        if (std::system(make.c_str()) == 0) {
            ::setenv("LOCPATH", (folder_ / "").c_str(), 1);
            (void)set();
            ::unsetenv("LOCPATH");
        }
        if (*std::localeconv()->decimal_point != ',') MESSAGE("no locale with a comma was found");
    }
    ~CommaLocale() { std::setlocale(LC_NUMERIC, before_.c_str()); }
    CommaLocale(const CommaLocale&) = delete;
    CommaLocale& operator=(const CommaLocale&) = delete;

private:
    Temporary folder_;
    std::string before_;

    static bool set() {
        for (const char* name : {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "fr_FR"})
            if (std::setlocale(LC_NUMERIC, name)) return true;
        return false;
    }
};

} // namespace gsh::test
