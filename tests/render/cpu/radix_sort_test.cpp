// SPDX-License-Identifier: Apache-2.0
#include <gsh/backend/serial.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/core/rng.hpp>
#include <gsh/render/cpu/radix_sort.hpp>

#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

using namespace gsh;

namespace {

template <class Key>
struct Item {
    Key key;
    std::uint32_t index;
    bool operator==(const Item&) const = default;
};

} // namespace

TEST_CASE_TEMPLATE("radix_sort is a stable sort at any thread count", Key, std::uint32_t, std::uint64_t) {
    Rng rng(1);
    constexpr Key all = ~Key(0);
    for (const std::size_t n : {0, 1, 2, 17, 8192, 8193, 60000})
        for (const Key mask : {Key(0), Key(7), Key(0xFFFF), Key(0x3FFFFF), all}) {
            std::vector<Item<Key>> items(n);
            for (std::size_t i = 0; i < n; ++i) {
                const Key base = all - mask; // depths share their upper bits
                const Key key = base | (static_cast<Key>(rng.bits()) & mask);
                items[i] = {key, static_cast<std::uint32_t>(i)};
            }
            std::vector<Item<Key>> expected = items;
            std::sort(expected.begin(), expected.end(), [](const auto& a, const auto& b) {
                return a.key < b.key || (a.key == b.key && a.index < b.index);
            });
            const auto check = [&](auto& backend) {
                std::vector<Item<Key>> sorted = items, scratch(n);
                cpu::Buffer<std::uint32_t> histograms;
                const Span<Item<Key>> result =
                    cpu::radix_sort(backend, Span<Item<Key>>(sorted), Span<Item<Key>>(scratch), histograms);
                INFO(n << " items, " << backend.thread_count() << " threads");
                CHECK(std::equal(result.begin(), result.end(), expected.begin(), expected.end()));
            };
            cpu::Serial serial;
            check(serial);
            cpu::Threads two(2), seven(7);
            check(two);
            check(seven);
        }
}
