// SPDX-License-Identifier: Apache-2.0
/// @file  GLB, the binary container of glTF 2.0: a JSON document and the numbers that its accessors describe.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Collects the arrays of a glTF document and writes both as a GLB file. The caller fills `json`; arrays append to its
/// members accessors and bufferViews.
///
/// Source  Khronos, "glTF 2.0 Specification", sections 3.6 and 4.4.
class GlbWriter {
public:
    nlohmann::ordered_json json;

    /// What an array is to its readers.
    struct Array {
        int width = 1;           ///< numbers an element: 1 SCALAR, 2 to 4 VEC, 16 MAT4
        bool normalized = false; ///< integers stand for 0 to 1, or -1 to 1
        bool bounds = false;     ///< min and max of each component are stored, as POSITION and times require
        int target = 0;          ///< 34962 for attributes of vertices, 34963 for indices, 0 for others
    };

    /// A view of bytes to which several accessors may refer. They begin at a multiple of four.
    int add_view(const void* data, std::size_t size, int target = 0) {
        bytes_.resize((bytes_.size() + 3) / 4 * 4);
        nlohmann::ordered_json view{{"buffer", 0}, {"byteOffset", bytes_.size()}, {"byteLength", size}};
        if (target) view["target"] = target;
        bytes_.append(static_cast<const char*>(data), size);
        json["bufferViews"].push_back(std::move(view));
        return static_cast<int>(json["bufferViews"].size()) - 1;
    }

    /// An accessor of a part of a view, which begins at `numbers` of the view that begins at `view_begin`.
    template <class T>
    int add_accessor(int view, std::size_t byte_offset, Span<const T> numbers, const Array& array) {
        static const char* const types[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
        nlohmann::ordered_json accessor{{"bufferView", view},
                                        {"componentType", component_type<T>()},
                                        {"count", numbers.size() / static_cast<std::size_t>(array.width)},
                                        {"type", array.width == 16 ? "MAT4" : types[array.width]}};
        if (byte_offset) accessor["byteOffset"] = byte_offset;
        if (array.normalized) accessor["normalized"] = true;
        for (std::size_t c = 0; array.bounds && c < static_cast<std::size_t>(array.width); ++c) {
            T low = numbers[c], high = numbers[c];
            for (std::size_t i = c; i < numbers.size(); i += static_cast<std::size_t>(array.width))
                low = std::min(low, numbers[i]), high = std::max(high, numbers[i]);
            accessor["min"].push_back(low), accessor["max"].push_back(high);
        }
        json["accessors"].push_back(std::move(accessor));
        return static_cast<int>(json["accessors"].size()) - 1;
    }

    /// An accessor with a view of its own; returns its index.
    template <class T>
    int add(Span<const T> numbers, const Array& array) {
        check_value(!numbers.empty() && numbers.size() % static_cast<std::size_t>(array.width) == 0, "GlbWriter::add",
                    "there must be whole elements");
        return add_accessor(add_view(numbers.data(), numbers.size() * sizeof(T), array.target), 0, numbers, array);
    }
    template <class T>
    int add(const std::vector<T>& numbers, const Array& array) {
        return add(Span<const T>(numbers), array);
    }

    /// Writes the file, atomically.
    /// Errors  IoError for more than 4 GiB, which the container cannot hold.
    void write(const std::filesystem::path& path) {
        bytes_.resize((bytes_.size() + 3) / 4 * 4);
        if (!bytes_.empty()) json["buffers"] = {{{"byteLength", bytes_.size()}}};
        std::string text = json.dump();
        text.resize((text.size() + 3) / 4 * 4, ' ');
        const std::size_t total = 12 + 8 + text.size() + (bytes_.empty() ? 0 : 8 + bytes_.size());
        if (total > std::numeric_limits<std::uint32_t>::max())
            throw IoError(path.string() + ": would hold " + std::to_string(total) + " bytes, a GLB file holds 4 GiB");
        const auto word = [](std::size_t number) { return static_cast<std::uint32_t>(number); };
        const std::uint32_t head[5] = {0x46546C67, 2, word(total), word(text.size()), 0x4E4F534A};
        AtomicFile file(path);
        file.write(head, sizeof head);
        file.write(text);
        if (!bytes_.empty()) {
            const std::uint32_t chunk[2] = {word(bytes_.size()), 0x004E4942};
            file.write(chunk, sizeof chunk);
            file.write(bytes_);
        }
        file.commit();
    }

private:
    std::string bytes_;

    template <class T>
    static constexpr int component_type() {
        if constexpr (std::is_same_v<T, std::int8_t>)
            return 5120;
        else if constexpr (std::is_same_v<T, std::uint8_t>)
            return 5121;
        else if constexpr (std::is_same_v<T, std::int16_t>)
            return 5122;
        else if constexpr (std::is_same_v<T, std::uint16_t>)
            return 5123;
        else if constexpr (std::is_same_v<T, std::uint32_t>)
            return 5125;
        else {
            static_assert(std::is_same_v<T, float>);
            return 5126;
        }
    }
};

/// A GLB file in memory, with checked access to its arrays. Only arrays in the binary chunk are read.
///
/// Errors  IoError, naming the file and the member, for what is truncated, out of range or of another type.
class GlbReader {
public:
    explicit GlbReader(const std::filesystem::path& path) : name_(path.string()), file_(gsh::read_file(path, limit)) {
        const auto word = [&](std::size_t at) {
            std::uint32_t value = 0;
            std::memcpy(&value, file_.data() + at, 4);
            return value;
        };
        if (file_.size() < 20 || word(0) != 0x46546C67) fail("is not a GLB file");
        if (word(4) != 2) fail("has glTF version " + std::to_string(word(4)) + ", expected 2");
        if (word(8) > file_.size() || word(8) < 20)
            fail("is truncated: it claims " + std::to_string(word(8)) + " bytes and has " +
                 std::to_string(file_.size()));
        const std::size_t total = word(8), text_size = word(12);
        if (word(16) != 0x4E4F534A || text_size > total - 20) fail("has no whole JSON chunk");
        if (text_size > json_limit) fail("has more than 256 MiB of JSON, the most that is read");
        std::size_t at = 20 + text_size;
        if (at + 8 <= total && word(at + 4) == 0x004E4942) {
            if (word(at) > total - at - 8) fail("is truncated in its binary chunk");
            bytes_ = std::string_view(file_).substr(at + 8, word(at));
        }
        json_ = nlohmann::json::parse(file_.begin() + 20, file_.begin() + 20 + static_cast<std::ptrdiff_t>(text_size),
                                      nullptr, false);
        if (!json_.is_object()) fail("holds damaged JSON");
    }

    [[nodiscard]] const std::string& name() const { return name_; }
    [[nodiscard]] const nlohmann::json& json() const { return json_; }

    /// The elements of a list of the document, for instance "nodes"; an empty list if there is none.
    [[nodiscard]] const nlohmann::json& list(const char* member) const {
        static const nlohmann::json none = nlohmann::json::array();
        const auto found = json_.find(member);
        if (found == json_.end()) return none;
        if (!found->is_array()) fail(std::string(member) + " is not a list");
        return *found;
    }
    /// Element `index` of a list. `index` is what another member of the document holds.
    [[nodiscard]] const nlohmann::json& at(const char* member, const nlohmann::json& index) const {
        const nlohmann::json& all = list(member);
        if (!index.is_number_integer() || index < 0 || index >= all.size())
            fail(std::string(member) + "[" + index.dump().substr(0, 20) + "] does not exist; there are " +
                 std::to_string(all.size()));
        const nlohmann::json& found = all[index.get<std::size_t>()];
        if (!found.is_object()) fail(std::string(member) + "[" + index.dump() + "] is not an object");
        return found;
    }

    /// The number of elements of an accessor.
    [[nodiscard]] std::size_t count(const nlohmann::json& accessor) const {
        return whole(at("accessors", accessor), "count", "accessors[" + accessor.dump() + "]");
    }

    /// The numbers of an accessor as floats; normalised integers become 0 to 1 or -1 to 1.
    [[nodiscard]] std::vector<float> floats(const nlohmann::json& accessor, std::size_t width) const;

    [[noreturn]] void fail(const std::string& reason) const { throw IoError(name_ + ": " + reason); }

private:
    static constexpr std::size_t limit = std::size_t(4) << 30, json_limit = std::size_t(1) << 28;

    std::string name_, file_;
    std::string_view bytes_;
    nlohmann::json json_;

    [[nodiscard]] std::size_t whole(const nlohmann::json& object, const char* member, const std::string& where,
                                    std::int64_t otherwise = -1) const {
        const auto found = object.find(member);
        if (found == object.end() && otherwise >= 0) return static_cast<std::size_t>(otherwise);
        if (found == object.end() || !found->is_number_integer() || *found < 0 || *found > 0xFFFFFFFFll)
            fail(where + "." + member + " is " +
                 (found == object.end() ? std::string("missing") : found->dump().substr(0, 20)) +
                 ", expected a whole number");
        return found->get<std::size_t>();
    }
};

// -------------------------------------------------------------------------------------------------------------

inline std::vector<float> GlbReader::floats(const nlohmann::json& index, std::size_t width) const {
    const nlohmann::json& accessor = at("accessors", index);
    const std::string where = "accessors[" + index.dump() + "]";
    static const std::pair<std::size_t, const char*> types[] = {
        {1, "SCALAR"}, {2, "VEC2"}, {3, "VEC3"}, {4, "VEC4"}, {16, "MAT4"}};
    for (const auto& [components, type] : types)
        if (components == width && accessor.value("type", nlohmann::json()) != type)
            fail(where + " has the type " + accessor.value("type", nlohmann::json()).dump().substr(0, 20) +
                 ", expected " + type);
    if (accessor.contains("sparse")) fail(where + " is sparse, which is not read");
    if (!accessor.contains("bufferView")) fail(where + " has no bufferView");
    const std::size_t kind = whole(accessor, "componentType", where), size = whole(accessor, "count", where);
    const std::size_t bytes_each = kind == 5126 || kind == 5125 ? 4 : kind == 5122 || kind == 5123 ? 2 : 1;
    if (kind < 5120 || kind > 5126 || kind == 5124)
        fail(where + " has the componentType " + std::to_string(kind) + ", expected 5120 to 5126");

    const nlohmann::json& view = at("bufferViews", accessor["bufferView"]);
    const std::string view_name = "bufferViews[" + accessor["bufferView"].dump() + "]";
    if (whole(view, "buffer", view_name) != 0 || at("buffers", 0).contains("uri"))
        fail(view_name + " is outside of the file; only the binary chunk is read");
    const std::size_t view_begin = whole(view, "byteOffset", view_name, 0),
                      view_size = whole(view, "byteLength", view_name), begin = whole(accessor, "byteOffset", where, 0),
                      tight = width * bytes_each,
                      stride = whole(view, "byteStride", view_name, static_cast<std::int64_t>(tight));
    if (view_begin > bytes_.size() || view_size > bytes_.size() - view_begin)
        fail(view_name + " ends beyond the binary chunk of " + std::to_string(bytes_.size()) + " bytes");
    if (stride < tight || stride > 252 + tight) fail(view_name + " has a byteStride of " + std::to_string(stride));
    // All numbers are below 2^32, so that the products fit.
    if (begin > view_size || (size > 0 && (size - 1) * stride + tight > view_size - begin))
        fail(where + " holds " + std::to_string(size) + " elements, but its view ends before them");

    const bool normalized = accessor.contains("normalized") && accessor["normalized"] == true;
    std::vector<float> numbers(size * width);
    for (std::size_t i = 0; i < numbers.size(); ++i) {
        const char* from = bytes_.data() + view_begin + begin + i / width * stride + i % width * bytes_each;
        const auto as = [&]<class Number>(Number number) {
            std::memcpy(&number, from, sizeof number);
            if constexpr (std::is_integral_v<Number>) {
                const auto largest = static_cast<float>(std::numeric_limits<Number>::max());
                if (normalized) return std::max(static_cast<float>(number) / largest, -1.0f);
            }
            return static_cast<float>(number);
        };
        switch (kind) {
        case 5120:
            numbers[i] = as(std::int8_t());
            break;
        case 5121:
            numbers[i] = as(std::uint8_t());
            break;
        case 5122:
            numbers[i] = as(std::int16_t());
            break;
        case 5123:
            numbers[i] = as(std::uint16_t());
            break;
        case 5125:
            numbers[i] = as(std::uint32_t());
            break;
        default:
            numbers[i] = as(float());
        }
        if (!std::isfinite(numbers[i]))
            throw ValueError(name_ + ": " + where + " holds " + std::to_string(numbers[i]) + " in element " +
                             std::to_string(i / width) + ", expected finite numbers");
    }
    return numbers;
}

} // namespace gsh
