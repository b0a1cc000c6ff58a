// SPDX-License-Identifier: Apache-2.0
/// @file  Named arrays of numbers with a JSON header in one block of bytes, for the page.
#pragma once

#include <nlohmann/json.hpp>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gsh::programs {

/// How a package stores numbers.
enum class Stored {
    exact,   ///< floats
    sixteen, ///< 65536 even steps between the least and the largest number of each column
    eight,   ///< 256 even steps, likewise
};

/// Builds a package:
///
///     8 bytes "GSHVIEW1", 4 bytes length of the header, the header (JSON, padded with blanks so that the arrays begin
///     at a multiple of 8), the arrays one after the other, each padded to a multiple of 8 bytes
///
/// The header has what the caller puts there, and under "arrays" for each array its name, type (f32, u8, u16, u32),
/// shape, its offset in bytes from the end of the header, and for steps `low` and `step` of each column:
/// number = low + step * stored. programs/web/package.js reads it. All numbers are little-endian.
class Package {
public:
    nlohmann::json header = nlohmann::json::object();

    /// Adds numbers of `columns` columns.
    void add(const std::string& name, const std::vector<float>& numbers, std::size_t columns,
             Stored stored = Stored::exact);
    /// Adds whole numbers, in the smallest type that holds them.
    void add_indices(const std::string& name, const std::vector<std::uint32_t>& numbers, std::size_t columns);

    /// The block of bytes.
    [[nodiscard]] std::string bytes() const;

private:
    void begin(const std::string& name, const char* type, std::size_t count, std::size_t columns);
    template <class T>
    void append(const std::vector<T>& numbers);
    template <class T>
    void add_steps(const std::string& name, const std::vector<float>& numbers, std::size_t columns, const char* type);

    nlohmann::json arrays_ = nlohmann::json::object();
    nlohmann::json* last_ = nullptr;
    std::string data_;
};

} // namespace gsh::programs
