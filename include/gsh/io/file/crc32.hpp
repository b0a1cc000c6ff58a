// SPDX-License-Identifier: Apache-2.0
/// @file  CRC-32, the checksum of zip archives and PNG images.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace gsh {

/// CRC-32 of IEEE 802.3, eight bytes at a time.
///
/// Source  Kounavis and Berry, "A Systematic Approach to Building High Performance Software-based CRC Generators",
///         2005.
class Crc32 {
public:
    void add(const void* data, std::size_t size) {
        static const Tables tables = make_tables();
        const auto* bytes = static_cast<const unsigned char*>(data);
        for (; size >= 8; size -= 8, bytes += 8) {
            std::uint32_t low = 0, high = 0;
            std::memcpy(&low, bytes, 4);
            std::memcpy(&high, bytes + 4, 4);
            low ^= state_;
            state_ = tables[7][low & 255] ^ tables[6][low >> 8 & 255] ^ tables[5][low >> 16 & 255] ^
                     tables[4][low >> 24] ^ tables[3][high & 255] ^ tables[2][high >> 8 & 255] ^
                     tables[1][high >> 16 & 255] ^ tables[0][high >> 24];
        }
        for (; size > 0; --size, ++bytes) state_ = state_ >> 8 ^ tables[0][(state_ ^ *bytes) & 255];
    }
    [[nodiscard]] std::uint32_t value() const { return ~state_; }

private:
    using Tables = std::array<std::array<std::uint32_t, 256>, 8>;
    std::uint32_t state_ = ~0u;

    static Tables make_tables() {
        Tables tables{};
        for (std::uint32_t byte = 0; byte < 256; ++byte) {
            std::uint32_t c = byte;
            for (int bit = 0; bit < 8; ++bit) c = c & 1 ? 0xEDB88320u ^ c >> 1 : c >> 1;
            tables[0][byte] = c;
        }
        for (std::size_t k = 1; k < 8; ++k)
            for (std::size_t byte = 0; byte < 256; ++byte)
                tables[k][byte] = tables[k - 1][byte] >> 8 ^ tables[0][tables[k - 1][byte] & 255];
        return tables;
    }
};

} // namespace gsh
