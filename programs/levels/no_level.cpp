// SPDX-License-Identifier: Apache-2.0
/// @file  What runs in place of a program on a machine for which the program was not built (GSH_PROGRAMS_ISA_LEVELS).

#include <cstdio>

int main() {
    std::fprintf(stderr,
                 "%s: this processor has none of the instruction sets that the program was built for (%s), or glibc "
                 "is older than 2.33; build gsh on this machine, or for x86-64, too\n",
                 GSH_PROGRAM_NAME, GSH_PROGRAM_LEVELS);
    return 2;
}
