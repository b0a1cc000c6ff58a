// SPDX-License-Identifier: Apache-2.0
/// @file  A program that uses the core, with its threads and its vectors.
#include <gsh/backend/threads.hpp>
#include <gsh/core/config.hpp>
#include <gsh/math/sh.hpp>

#include <cstddef>
#include <cstdio>
#include <vector>

namespace {

struct Count {
    gsh::Span<int> values;
    void operator()(std::size_t i) const { values[i] = gsh::sh_basis_count(static_cast<int>(i)); }
};

} // namespace

int main() {
    gsh::cpu::Threads backend(2);
    std::vector<int> values(4);
    backend.for_each(values.size(), Count{values});
    std::printf("gsh %s\n", GSH_VERSION_TEXT);
    return values == std::vector<int>{1, 4, 9, 16} ? 0 : 1;
}
