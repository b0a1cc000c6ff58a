// SPDX-License-Identifier: Apache-2.0
/// @file  Safetensors files as Python writes them, and invalid ones.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace gsh::test {

/// Length, header and numbers. Each of them may be invalid.
inline std::string safetensors_bytes(const std::string& header, const std::string& data) {
    std::string bytes;
    for (int i = 0; i < 8; ++i) bytes.push_back(static_cast<char>(std::uint64_t(header.size()) >> 8 * i & 255));
    return bytes + header + data;
}

/// Half of a float, rounded towards zero; for numbers that a normal half can hold.
inline std::uint16_t half_bits(float value) {
    const auto bits = std::bit_cast<std::uint32_t>(value);
    const auto exponent = static_cast<std::int32_t>(bits >> 23 & 255) - 112;
    const std::uint32_t magnitude =
        exponent <= 0 ? 0 : static_cast<std::uint32_t>(exponent) << 10 | (bits >> 13 & 1023);
    return static_cast<std::uint16_t>((bits >> 16 & 0x8000u) | magnitude);
}

/// Collects tensors, then writes them one behind the other.
class SafetensorsFile {
public:
    /// dtype F32, F64, F16 or BF16.
    void add(const std::string& name, const std::string& shape, Span<const float> values,
             std::string_view dtype = "F32") {
        const std::size_t begin = data_.size();
        for (const float value : values) {
            if (dtype == "F64") append(static_cast<double>(value));
            else if (dtype == "F16") append(half_bits(value));
            else if (dtype == "BF16") append(static_cast<std::uint16_t>(std::bit_cast<std::uint32_t>(value) >> 16));
            else append(value);
        }
        header_ += ", \"" + name + "\": {\"dtype\": \"" + std::string(dtype) + "\", \"shape\": [" + shape +
                   "], \"data_offsets\": [" + std::to_string(begin) + ", " + std::to_string(data_.size()) + "]}";
    }
    void write(const std::filesystem::path& path) const {
        std::string header = "{\"__metadata__\": {\"format\": \"pt\"}" + header_ + "}";
        header.resize((header.size() + 7) / 8 * 8, ' '); // padded as the original library does
        write_file(path, safetensors_bytes(header, data_));
    }

private:
    std::string header_, data_;

    template <class T>
    void append(T value) {
        data_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    }
};

} // namespace gsh::test
