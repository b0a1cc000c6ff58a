// SPDX-License-Identifier: Apache-2.0
#include "view/package.hpp"

#include <gsh/core/error.hpp>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace gsh::programs {

static_assert(std::endian::native == std::endian::little, "packages are little-endian");

void Package::begin(const std::string& name, const char* type, std::size_t count, std::size_t columns) {
    check_value(columns > 0 && count % columns == 0, "Package", name + " has an incomplete row");
    data_.resize((data_.size() + 7) / 8 * 8);
    last_ = &arrays_[name];
    *last_ = {{"type", type}, {"shape", {count / columns, columns}}, {"offset", data_.size()}};
}

template <class T>
void Package::append(const std::vector<T>& numbers) {
    data_.append(reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(T));
}

template <class T>
void Package::add_steps(const std::string& name, const std::vector<float>& numbers, std::size_t columns,
                        const char* type) {
    constexpr auto most = static_cast<double>(std::numeric_limits<T>::max());
    std::vector<double> low(columns, std::numeric_limits<double>::infinity()), high(columns, -low[0]), step(columns);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const auto x = static_cast<double>(numbers[i]);
        low[i % columns] = std::min(low[i % columns], x), high[i % columns] = std::max(high[i % columns], x);
    }
    for (std::size_t c = 0; c < columns; ++c) {
        if (!(low[c] <= high[c])) low[c] = high[c] = 0; // no rows
        step[c] = (high[c] - low[c]) / most;
    }
    std::vector<T> stored(numbers.size());
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const std::size_t c = i % columns;
        if (step[c] > 0) stored[i] = static_cast<T>(std::lround((static_cast<double>(numbers[i]) - low[c]) / step[c]));
    }
    begin(name, type, numbers.size(), columns);
    (*last_)["low"] = low, (*last_)["step"] = step;
    append(stored);
}

void Package::add(const std::string& name, const std::vector<float>& numbers, std::size_t columns, Stored stored) {
    if (stored == Stored::sixteen) return add_steps<std::uint16_t>(name, numbers, columns, "u16");
    if (stored == Stored::eight) return add_steps<std::uint8_t>(name, numbers, columns, "u8");
    begin(name, "f32", numbers.size(), columns);
    append(numbers);
}

void Package::add_indices(const std::string& name, const std::vector<std::uint32_t>& numbers, std::size_t columns) {
    const std::uint32_t most = numbers.empty() ? 0 : *std::max_element(numbers.begin(), numbers.end());
    begin(name, most < 256 ? "u8" : most < 65536 ? "u16" : "u32", numbers.size(), columns);
    if (most < 256)
        append(std::vector<std::uint8_t>(numbers.begin(), numbers.end()));
    else if (most < 65536)
        append(std::vector<std::uint16_t>(numbers.begin(), numbers.end()));
    else
        append(numbers);
}

std::string Package::bytes() const {
    nlohmann::json whole = header;
    whole["arrays"] = arrays_;
    std::string text = whole.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
    text.resize((text.size() + 12 + 7) / 8 * 8 - 12, ' ');
    const auto length = static_cast<std::uint32_t>(text.size());
    std::string result;
    result.reserve(12 + text.size() + data_.size()); // data is large, and is copied once
    result.append("GSHVIEW1").append(reinterpret_cast<const char*>(&length), sizeof length);
    return result.append(text).append(data_);
}

} // namespace gsh::programs
