// SPDX-License-Identifier: Apache-2.0
/// @file  Reads the accessors of a glTF file as numbers, checked against the buffers before memory is taken.
#pragma once

#include <gsh/io/file/gltf_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace gsh::detail {

/// Several accessors may share the same bytes, so all that are read together are bounded.
class GltfNumbers {
public:
    /// The file must outlive this object. All calls of `read` together return at most `most` numbers.
    explicit GltfNumbers(const GltfFile& file, std::size_t most = std::size_t(1) << 27)
        : file_(file), most_(most), left_(most) {}

    /// The numbers of an accessor, `components` for each element; normalised integers as fractions. `what` begins
    /// messages.
    /// Errors  IoError for an index out of range, another type, sparse numbers, bytes beyond the buffer, NaN.
    template <class T = double>
    [[nodiscard]] std::vector<T> read(int accessor, int components, const std::string& what);

private:
    const GltfFile& file_;
    std::size_t most_, left_;
};

// -------------------------------------------------------------------------------------------------------------

template <class T>
std::vector<T> GltfNumbers::read(int accessor, int components, const std::string& what) {
    const tinygltf::Model& model = file_.model();
    file_.check_index(accessor, model.accessors.size(), what + ": accessor");
    const tinygltf::Accessor& a = model.accessors[static_cast<std::size_t>(accessor)];
    const std::string where = what + ": accessor " + std::to_string(accessor);
    if (a.sparse.isSparse) file_.fail(where + " is sparse, which is not read");
    if (a.type <= 0 || tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(a.type)) != components)
        file_.fail(where + " does not have " + std::to_string(components) + " numbers for each element");
    const int width = tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(a.componentType));
    const bool real = a.componentType == TINYGLTF_COMPONENT_TYPE_FLOAT;
    const bool known = real || a.componentType == TINYGLTF_COMPONENT_TYPE_BYTE ||
                       a.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE ||
                       a.componentType == TINYGLTF_COMPONENT_TYPE_SHORT ||
                       a.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
    if (!known || width <= 0) file_.fail(where + " is neither of floats nor of 8 or 16 bit integers");
    file_.check_index(a.bufferView, model.bufferViews.size(), where + ": bufferView");
    const tinygltf::BufferView& view = model.bufferViews[static_cast<std::size_t>(a.bufferView)];
    file_.check_index(view.buffer, model.buffers.size(), where + ": buffer");
    const auto& bytes = model.buffers[static_cast<std::size_t>(view.buffer)].data;
    const std::size_t element = static_cast<std::size_t>(width) * static_cast<std::size_t>(components);
    const std::size_t stride = view.byteStride ? view.byteStride : element;
    const auto has_room = [](std::size_t size, std::size_t from, std::size_t bytes_needed) {
        return from <= size && bytes_needed <= size - from;
    };
    if (a.count == 0) file_.fail(where + " has no elements");
    if (!has_room(bytes.size(), view.byteOffset, view.byteLength) || stride < element ||
        !has_room(view.byteLength, a.byteOffset, element) ||
        (a.count - 1) > (view.byteLength - a.byteOffset - element) / stride)
        file_.fail(where + " states " + std::to_string(a.count) + " elements, which reach beyond its buffer of " +
                   std::to_string(bytes.size()) + " bytes");
    const std::size_t count = a.count * static_cast<std::size_t>(components);
    if (count > left_) file_.fail(where + " brings the numbers that are used to more than " + std::to_string(most_));
    left_ -= count;
    std::vector<T> result;
    result.reserve(count);
    for (std::size_t i = 0; i < a.count; ++i)
        for (std::size_t k = 0; k < static_cast<std::size_t>(components); ++k) {
            const unsigned char* at =
                bytes.data() + view.byteOffset + a.byteOffset + i * stride + k * static_cast<std::size_t>(width);
            const auto value_of = [&](auto value, double whole) { // `whole` is the integer that stands for 1
                std::memcpy(&value, at, sizeof value);
                const auto number = static_cast<double>(value);
                return real || !a.normalized ? number : std::max(number / whole, -1.0);
            };
            const double number = real                                              ? value_of(float(), 1)
                                  : a.componentType == TINYGLTF_COMPONENT_TYPE_BYTE ? value_of(std::int8_t(), 127)
                                  : a.componentType == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE
                                      ? value_of(std::uint8_t(), 255)
                                  : a.componentType == TINYGLTF_COMPONENT_TYPE_SHORT ? value_of(std::int16_t(), 32767)
                                                                                     : value_of(std::uint16_t(), 65535);
            if (!std::isfinite(number)) file_.fail(where + " holds NaN or infinity at element " + std::to_string(i));
            result.push_back(static_cast<T>(number));
        }
    return result;
}

} // namespace gsh::detail
