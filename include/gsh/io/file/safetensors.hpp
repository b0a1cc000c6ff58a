// SPDX-License-Identifier: Apache-2.0
/// @file  Reads safetensors files: named arrays in one file, a common format for PyTorch networks.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/message.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npy.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <initializer_list>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace gsh {

/// A tensor's entry in the file's header.
struct TensorHeader {
    std::string dtype;                ///< as written in the file: "F32", "BF16", ...
    Shape shape;                      ///< in C order
    std::size_t begin = 0, bytes = 0; ///< position of its numbers, from the end of the file's header
};

/// Reads tensors by name.
///
/// The file consists of a length (8 bytes), a JSON header of that length, and the numbers. The constructor validates
/// the header. The JSON must be small, flat and without duplicate names. Each tensor's size in bytes must agree with
/// its shape and type, and the tensors must lie within the file without overlap. Numbers are read only on request.
///
/// Errors  IoError for a file that is missing, truncated, damaged or of another kind, for a name that does not exist
///         and for a dtype other than F16, BF16, F32 and F64; ShapeError for a shape that does not fit; ValueError for
///         NaN, infinities and numbers out of T's range. Messages begin with the file and name the tensor.
/// Source  huggingface/safetensors, "Format".
class SafetensorsReader {
public:
    struct Limits {
        std::size_t header_bytes = std::size_t(8) << 20; ///< networks of a thousand tensors need 0.1 MiB
        std::size_t tensor_bytes = std::size_t(1) << 30; ///< per tensor, as stored and as read
    };

    explicit SafetensorsReader(InputFile input) : SafetensorsReader(std::move(input), Limits()) {}
    SafetensorsReader(InputFile input, Limits limits);

    [[nodiscard]] const std::filesystem::path& path() const { return input_.path(); }
    [[nodiscard]] std::vector<std::string> keys() const; ///< sorted
    [[nodiscard]] bool has(std::string_view name) const { return tensors_.contains(name); }
    /// Type and shape, without reading the numbers.
    [[nodiscard]] const TensorHeader& header(std::string_view name) const;

    template <std::floating_point T>
    [[nodiscard]] NpyArray<T> read(std::string_view name) const;
    /// The same with a shape check; -1 stands for any length.
    template <std::floating_point T>
    [[nodiscard]] NpyArray<T> read(std::string_view name, std::initializer_list<std::int64_t> pattern) const {
        detail::check_shape(name_of(name), header(name).shape, {pattern.begin(), pattern.size()});
        return read<T>(name);
    }

    /// "FILE: name", the prefix of every message about a tensor.
    [[nodiscard]] std::string name_of(std::string_view name) const {
        return input_.name() + ": " + detail::shortened(name);
    }

private:
    InputFile input_;
    Limits limits_;
    std::size_t data_begin_ = 0; // offset in the file
    std::map<std::string, TensorHeader, std::less<>> tensors_;

    void check_places(std::size_t data_bytes) const;
};

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Converts a bfloat16, the upper half of a float.
inline float bfloat_to_float(std::uint16_t upper) {
    return std::bit_cast<float>(std::uint32_t(upper) << 16);
}

/// Bytes per number; 0 for an unknown type.
inline std::size_t safetensors_width(std::string_view dtype) {
    for (const auto& [name, width] : {std::pair{"F32", 4},
                                      {"F16", 2},
                                      {"BF16", 2},
                                      {"F64", 8},
                                      {"I64", 8},
                                      {"U64", 8},
                                      {"I32", 4},
                                      {"U32", 4},
                                      {"I16", 2},
                                      {"U16", 2},
                                      {"I8", 1},
                                      {"U8", 1},
                                      {"BOOL", 1},
                                      {"F8_E4M3", 1},
                                      {"F8_E5M2", 1}})
        if (dtype == name) return std::size_t(width);
    return 0;
}

/// Parses the file's header, whose levels are the header itself, its tensors, and their shapes.
inline nlohmann::json parse_safetensors_header(const std::string& text, const std::string& what) {
    OwnedJson header(
        parse_json<nlohmann::json>(text, what + " is not a safetensors file, or damaged: its header", {.depth = 3}));
    if (!header->is_object()) throw IoError(what + " is not a safetensors file: its header is no JSON object");
    return header.take();
}

inline TensorHeader read_tensor_header(const nlohmann::json& json, const std::string& what) {
    const auto lengths = [&](const char* field) {
        const auto found = json.find(field);
        if (found == json.end() || !found->is_array()) throw IoError(what + " has no list '" + field + "'");
        Shape values;
        for (const nlohmann::json& number : *found) {
            if (!number.is_number_unsigned())
                throw IoError(what + ": " + field + " holds " + shortened(number.dump()) +
                              ", expected whole numbers from 0");
            values.push_back(number.get<std::size_t>());
        }
        return values;
    };
    if (!json.is_object()) throw IoError(what + " is no JSON object with dtype, shape and data_offsets");
    TensorHeader tensor;
    const auto dtype = json.find("dtype");
    if (dtype == json.end() || !dtype->is_string()) throw IoError(what + " has no text 'dtype'");
    tensor.dtype = dtype->get<std::string>();
    tensor.shape = lengths("shape");
    const Shape offsets = lengths("data_offsets");
    if (offsets.size() != 2 || offsets[0] > offsets[1])
        throw IoError(what + ": data_offsets are " + shape_text(offsets) + ", expected a begin and an end behind it");
    tensor.begin = offsets[0], tensor.bytes = offsets[1] - offsets[0];

    const std::size_t width = safetensors_width(tensor.dtype);
    std::size_t bytes = 0;
    if (tensor.shape.size() > 32) throw IoError(what + " has more than 32 axes");
    if (width != 0 && (!checked_bytes(tensor.shape, width, bytes) || bytes != tensor.bytes))
        throw IoError(what + " is damaged: shape " + shape_text(tensor.shape) + " of " + shortened(tensor.dtype) +
                      " does not fit its " + std::to_string(tensor.bytes) + " bytes");
    return tensor;
}

} // namespace detail

inline SafetensorsReader::SafetensorsReader(InputFile input, Limits limits)
    : input_(std::move(input)), limits_(limits) {
    const std::string what = input_.name();
    InputStream file(input_);
    const std::size_t size = file.size();
    const detail::ByteSource source = [&](void* data, std::size_t count) { return file.read(data, count); };
    std::uint64_t length = 0;
    if (size < sizeof(length))
        throw IoError(what + " is not a safetensors file: it has " + std::to_string(size) + " bytes");
    detail::read_exactly(source, &length, sizeof(length), what);
    if (length > size - sizeof(length))
        throw IoError(what + " " +
                      not_the_kind(input_, "a safetensors file", "safetensors",
                                   "is truncated or not a safetensors file: its header claims " +
                                       std::to_string(length) + " bytes, the file has " + std::to_string(size)));
    if (length > limits_.header_bytes)
        throw IoError(what + " has a header of " + std::to_string(length) + " bytes, more than the limit of " +
                      std::to_string(limits_.header_bytes) + "; the file is damaged or made to exhaust memory");
    std::string text(length, '\0');
    detail::read_exactly(source, text.data(), length, what);
    data_begin_ = sizeof(length) + length;

    const detail::OwnedJson header(detail::parse_safetensors_header(text, what));
    for (const auto& [name, json] : (*header).items())
        if (name != "__metadata__") tensors_[name] = detail::read_tensor_header(json, name_of(name));
    check_places(size - data_begin_);
}

inline void SafetensorsReader::check_places(std::size_t data_bytes) const {
    std::map<std::size_t, const std::pair<const std::string, TensorHeader>*> by_begin;
    for (const auto& entry : tensors_) {
        const TensorHeader& tensor = entry.second;
        if (tensor.begin > data_bytes || tensor.bytes > data_bytes - tensor.begin)
            throw IoError(name_of(entry.first) + " is truncated: its numbers end at byte " +
                          std::to_string(tensor.begin + tensor.bytes) + ", the file holds " +
                          std::to_string(data_bytes));
        if (tensor.bytes == 0) continue;
        const auto [other, fresh] = by_begin.emplace(tensor.begin, &entry);
        if (!fresh)
            throw IoError(name_of(entry.first) + " overlaps " + detail::shortened(other->second->first) +
                          "; the file is damaged");
    }
    const std::pair<const std::string, TensorHeader>* before = nullptr;
    for (const auto& [begin, entry] : by_begin) {
        if (before && before->second.begin + before->second.bytes > begin)
            throw IoError(name_of(entry->first) + " overlaps " + detail::shortened(before->first) +
                          "; the file is damaged");
        before = entry;
    }
}

inline std::vector<std::string> SafetensorsReader::keys() const {
    std::vector<std::string> names;
    for (const auto& [name, tensor] : tensors_) names.push_back(name);
    return names;
}

inline const TensorHeader& SafetensorsReader::header(std::string_view name) const {
    const auto found = tensors_.find(name);
    if (found != tensors_.end()) return found->second;
    throw IoError(name_of(name) + " is missing; the file holds: " + detail::listed(keys(), "no tensors"));
}

template <std::floating_point T>
NpyArray<T> SafetensorsReader::read(std::string_view name) const {
    const TensorHeader& tensor = header(name);
    const std::string what = name_of(name);
    NpyHeader numbers;
    numbers.kind = 'f', numbers.width = detail::safetensors_width(tensor.dtype);
    numbers.shape = tensor.shape, numbers.dtype = tensor.dtype;
    const bool half = tensor.dtype == "F16", brain = tensor.dtype == "BF16";
    if (!half && !brain && tensor.dtype != "F32" && tensor.dtype != "F64")
        throw IoError(what + " has dtype " + detail::shortened(tensor.dtype) + ", expected F16, BF16, F32 or F64");
    std::size_t bytes = 0;
    if (!detail::checked_bytes(tensor.shape, sizeof(T), bytes) || std::max(bytes, tensor.bytes) > limits_.tensor_bytes)
        throw IoError(what + " has shape " + detail::shape_text(tensor.shape) + ", more than the limit of " +
                      std::to_string(limits_.tensor_bytes) + " bytes in memory");

    InputStream file(input_);
    if (!file.seek(data_begin_ + tensor.begin))
        throw IoError(what + " cannot be read: " + std::generic_category().message(errno));
    const detail::ByteSource source = [&](void* data, std::size_t count) { return file.read(data, count); };
    if (brain) { // converted to float first, then treated as any other type
        std::vector<std::uint16_t> upper(detail::element_count(tensor.shape));
        detail::read_exactly(source, upper.data(), tensor.bytes, what);
        std::vector<float> wide(upper.size());
        for (std::size_t i = 0; i < upper.size(); ++i) wide[i] = detail::bfloat_to_float(upper[i]);
        std::size_t read = 0;
        const detail::ByteSource memory = [&](void* data, std::size_t count) {
            std::memcpy(data, reinterpret_cast<const char*>(wide.data()) + read, count);
            return read += count, count;
        };
        numbers.width = sizeof(float);
        return {tensor.shape, detail::read_npy_numbers<T>(memory, numbers, what, Numbers::same_kind)};
    }
    return {tensor.shape, detail::read_npy_numbers<T>(source, numbers, what, Numbers::same_kind)};
}

} // namespace gsh
