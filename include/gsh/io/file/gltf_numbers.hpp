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

    /// The numbers of an accessor, `components` for each element; normalised integers as fractions. Elements without
    /// bytes are zero, and sparse ones are replaced. `what` begins messages.
    /// Errors  IoError for an index out of range, another type, bytes beyond the buffer, NaN.
    template <class T = double>
    [[nodiscard]] std::vector<T> read(int accessor, int components, const std::string& what);

    /// The numbers of an accessor of indices, of which each must be below `count`.
    /// Errors  as for read; IoError for numbers that are not unsigned integers.
    [[nodiscard]] std::vector<std::uint32_t> read_indices(int accessor, std::size_t count, const std::string& what);

    /// Counts copies of numbers as if they were read.
    void count_copies(std::size_t count, const std::string& where) { (void)taken(count, true, where); }

private:
    const GltfFile& file_;
    std::size_t most_, left_, without_bytes_ = 0;

    /// Elements of a buffer, one every `stride` bytes.
    struct Elements {
        const unsigned char* first;
        std::size_t stride;
    };
    /// Numbers of one type, `width` bytes each.
    struct Type {
        int component;
        bool normalized;
        std::size_t width;

        [[nodiscard]] double at(const unsigned char* bytes) const;
    };
    [[nodiscard]] const tinygltf::Accessor& accessor_at(int index, int components, const std::string& where) const;
    [[nodiscard]] Type type_of(int component, bool normalized, bool indices, const std::string& where) const;
    [[nodiscard]] Elements elements(int view, std::size_t offset, std::size_t count, std::size_t size, bool packed,
                                    const std::string& where) const;
    [[nodiscard]] std::size_t taken(std::size_t count, bool has_bytes, const std::string& where);
    [[nodiscard]] std::vector<std::uint32_t> places(const tinygltf::Accessor& a, const std::string& where) const;
};

// -------------------------------------------------------------------------------------------------------------

inline double GltfNumbers::Type::at(const unsigned char* bytes) const {
    const auto value_of = [&](auto value, double whole) { // `whole` is the integer that stands for 1
        std::memcpy(&value, bytes, sizeof value);
        const auto number = static_cast<double>(value);
        return normalized ? std::max(number / whole, -1.0) : number;
    };
    switch (component) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
        return value_of(std::int8_t(), 127);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return value_of(std::uint8_t(), 255);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
        return value_of(std::int16_t(), 32767);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return value_of(std::uint16_t(), 65535);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return value_of(std::uint32_t(), 4294967295.0);
    default:
        float number = 0;
        std::memcpy(&number, bytes, sizeof number);
        return number;
    }
}

inline const tinygltf::Accessor& GltfNumbers::accessor_at(int index, int components, const std::string& where) const {
    const tinygltf::Accessor& a = file_.model().accessors[static_cast<std::size_t>(index)];
    if (a.type <= 0 || tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(a.type)) != components)
        file_.fail(where + " does not have " + std::to_string(components) + " numbers for each element");
    if (a.count == 0) file_.fail(where + " has no elements");
    return a;
}

inline GltfNumbers::Type GltfNumbers::type_of(int component, bool normalized, bool indices,
                                              const std::string& where) const {
    const bool is_unsigned =
        component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE || component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT;
    const bool known = indices ? is_unsigned || component == TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT
                               : is_unsigned || component == TINYGLTF_COMPONENT_TYPE_FLOAT ||
                                     component == TINYGLTF_COMPONENT_TYPE_BYTE ||
                                     component == TINYGLTF_COMPONENT_TYPE_SHORT;
    if (!known)
        file_.fail(where +
                   (indices ? " is not of unsigned integers" : " is neither of floats nor of 8 or 16 bit integers"));
    return {component, normalized,
            static_cast<std::size_t>(tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(component)))};
}

/// `count` elements of `size` bytes, from `offset` on in a view; `packed` ones have no stride.
inline GltfNumbers::Elements GltfNumbers::elements(int view, std::size_t offset, std::size_t count, std::size_t size,
                                                   bool packed, const std::string& where) const {
    const tinygltf::Model& model = file_.model();
    file_.check_index(view, model.bufferViews.size(), where + ": bufferView");
    const tinygltf::BufferView& v = model.bufferViews[static_cast<std::size_t>(view)];
    file_.check_index(v.buffer, model.buffers.size(), where + ": buffer");
    const auto& bytes = model.buffers[static_cast<std::size_t>(v.buffer)].data;
    const std::size_t stride = v.byteStride && !packed ? v.byteStride : size;
    const auto has_room = [](std::size_t all, std::size_t from, std::size_t needed) {
        return from <= all && needed <= all - from;
    };
    if (!has_room(bytes.size(), v.byteOffset, v.byteLength) || stride < size || !has_room(v.byteLength, offset, size) ||
        (count - 1) > (v.byteLength - offset - size) / stride)
        file_.fail(where + " states " + std::to_string(count) + " elements, which reach beyond its buffer of " +
                   std::to_string(bytes.size()) + " bytes");
    return {bytes.data() + v.byteOffset + offset, stride};
}

/// `count`, subtracted from what is left. The file's size does not bound numbers without bytes: there may be as many as
/// its largest buffer has bytes, or four million.
inline std::size_t GltfNumbers::taken(std::size_t count, bool has_bytes, const std::string& where) {
    std::size_t limit = std::size_t(1) << 22;
    for (const auto& buffer : file_.model().buffers) limit = std::max(limit, buffer.data.size());
    if (!has_bytes && (count > limit || (without_bytes_ += count) > limit))
        file_.fail(where + " brings the numbers without bytes to more than " + std::to_string(limit));
    if (count > left_) file_.fail(where + " brings the numbers that are used to more than " + std::to_string(most_));
    left_ -= count;
    return count;
}

/// The elements that a sparse accessor replaces.
inline std::vector<std::uint32_t> GltfNumbers::places(const tinygltf::Accessor& a, const std::string& where) const {
    const auto& indices = a.sparse.indices;
    if (a.sparse.count < 1 || static_cast<std::size_t>(a.sparse.count) > a.count)
        file_.fail(where + ": sparse.count is " + std::to_string(a.sparse.count) + ", expected 1 to " +
                   std::to_string(a.count));
    if (indices.byteOffset < 0 || a.sparse.values.byteOffset < 0)
        file_.fail(where + ": a byteOffset of sparse is negative");
    const auto count = static_cast<std::size_t>(a.sparse.count);
    const Type type = type_of(indices.componentType, false, true, where + ": sparse.indices");
    const Elements all = elements(indices.bufferView, static_cast<std::size_t>(indices.byteOffset), count, type.width,
                                  true, where + ": sparse.indices");
    std::vector<std::uint32_t> result(count);
    for (std::size_t k = 0; k < count; ++k) {
        result[k] = static_cast<std::uint32_t>(type.at(all.first + k * all.stride));
        if (result[k] >= a.count || (k > 0 && result[k] <= result[k - 1]))
            file_.fail(where + ": sparse.indices has " + std::to_string(result[k]) + " at place " + std::to_string(k) +
                       ", expected ascending indices below " + std::to_string(a.count));
    }
    return result;
}

template <class T>
std::vector<T> GltfNumbers::read(int accessor, int components, const std::string& what) {
    file_.check_index(accessor, file_.model().accessors.size(), what + ": accessor");
    const std::string where = what + ": accessor " + std::to_string(accessor);
    const tinygltf::Accessor& a = accessor_at(accessor, components, where);
    const Type type = type_of(a.componentType, a.normalized, false, where);
    const auto width = static_cast<std::size_t>(components);
    const bool has_bytes = a.bufferView != -1;
    if (!has_bytes && a.count > most_)
        file_.fail(where + " states " + std::to_string(a.count) + " elements, more than are read");
    Elements all{};
    if (has_bytes) all = elements(a.bufferView, a.byteOffset, a.count, type.width * width, false, where);
    std::vector<T> result(taken(a.count * width, has_bytes, where), T(0));
    const auto put = [&](std::size_t element, const unsigned char* bytes) {
        for (std::size_t c = 0; c < width; ++c) {
            const double number = type.at(bytes + c * type.width);
            if (!std::isfinite(number))
                file_.fail(where + " holds NaN or infinity at element " + std::to_string(element));
            result[element * width + c] = static_cast<T>(number);
        }
    };
    for (std::size_t i = 0; has_bytes && i < a.count; ++i) put(i, all.first + i * all.stride);
    if (a.sparse.isSparse) {
        const std::vector<std::uint32_t> replaced = places(a, where);
        const Elements values =
            elements(a.sparse.values.bufferView, static_cast<std::size_t>(a.sparse.values.byteOffset), replaced.size(),
                     type.width * width, true, where + ": sparse.values");
        for (std::size_t k = 0; k < replaced.size(); ++k) put(replaced[k], values.first + k * values.stride);
    }
    return result;
}

inline std::vector<std::uint32_t> GltfNumbers::read_indices(int accessor, std::size_t count, const std::string& what) {
    file_.check_index(accessor, file_.model().accessors.size(), what + ": accessor");
    const std::string where = what + ": accessor " + std::to_string(accessor);
    const tinygltf::Accessor& a = accessor_at(accessor, 1, where);
    const Type type = type_of(a.componentType, false, true, where);
    const Elements all = elements(a.bufferView, a.byteOffset, a.count, type.width, true, where);
    std::vector<std::uint32_t> result(taken(a.count, true, where));
    for (std::size_t i = 0; i < a.count; ++i) {
        result[i] = static_cast<std::uint32_t>(type.at(all.first + i * all.stride));
        if (result[i] >= count)
            file_.fail(where + " holds " + std::to_string(result[i]) + ", expected indices below " +
                       std::to_string(count));
    }
    return result;
}

} // namespace gsh::detail
