// SPDX-License-Identifier: Apache-2.0
/// @file  Writes GLB, the binary container of glTF 2.0: a JSON document and the numbers that its accessors describe.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/file_author.hpp>
#include <gsh/math/quat.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace gsh {

/// Collects the arrays of a glTF document and writes both as a GLB file. The caller fills `json`, which states gsh as
/// its author. Arrays append to its members accessors and bufferViews.
///
/// Source  Khronos, "glTF 2.0 Specification", sections 3.6 and 4.4.
class GlbWriter {
public:
    nlohmann::ordered_json json{{"asset", {{"version", "2.0"}, {"generator", file_author()}}}, {"scene", 0}};

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

    /// An accessor of `numbers`, which begin `byte_offset` bytes into the view.
    /// Errors  ValueError unless these are whole elements, at least one.
    template <class T>
    int add_accessor(int view, std::size_t byte_offset, Span<const T> numbers, const Array& array) {
        check_value(!numbers.empty() && numbers.size() % static_cast<std::size_t>(array.width) == 0,
                    "GlbWriter::add_accessor", "there must be whole elements");
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
        return add_accessor(add_view(numbers.data(), numbers.size() * sizeof(T), array.target), 0, numbers, array);
    }
    template <class T>
    int add(const std::vector<T>& numbers, const Array& array) {
        return add(Span<const T>(numbers), array);
    }

    /// The times of frames in seconds, for animations. `where` begins messages.
    /// Errors  ValueError unless they ascend and are finite as floats, which the file holds.
    int add_times(Span<const double> seconds, const std::string& where) {
        const std::vector<float> times(seconds.begin(), seconds.end());
        check_finite<float>(where, "times", times);
        for (std::size_t t = 1; t < times.size(); ++t)
            if (!(times[t] > times[t - 1]))
                throw ValueError(where + ": the times of frames " + std::to_string(t - 1) + " and " +
                                 std::to_string(t) + " do not ascend, as glTF demands of their floats");
        return add(times, {.bounds = true});
    }

    /// Adds a channel to the document's only animation. `path` is rotation, translation, scale or weights.
    void animate(std::size_t node, const char* path, int input, int output, const std::string& name = "motion") {
        auto& animation = json["animations"][0];
        if (animation.is_null())
            animation = {{"name", name},
                         {"channels", nlohmann::ordered_json::array()},
                         {"samplers", nlohmann::ordered_json::array()}};
        animation["channels"].push_back(
            {{"sampler", animation["samplers"].size()}, {"target", {{"node", node}, {"path", path}}}});
        animation["samplers"].push_back({{"input", input}, {"output", output}});
    }

    /// Writes the file, atomically.
    /// Errors  IoError for more than 4 GiB, which the container cannot hold.
    void write(const std::filesystem::path& path) {
        bytes_.resize((bytes_.size() + 3) / 4 * 4);
        if (!bytes_.empty()) json["buffers"] = {{{"byteLength", bytes_.size()}}};
        // Names may come from files in other encodings: bytes that are not UTF-8 become U+FFFD.
        std::string text = json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
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

/// Rotations of consecutive keys as x y z w, each with the sign that is nearer to the one before, so that readers turn
/// the short way whether they compare signs or not.
[[nodiscard]] inline std::vector<float> rotation_keys(Span<const mat3<double>> rotations) {
    std::vector<float> keys;
    quat<double> last;
    for (const mat3<double>& R : rotations) {
        quat<double> q = quat_from_rotation(R);
        if (dot(q, last) < 0) q = {-q.w, -q.x, -q.y, -q.z};
        last = q;
        keys.insert(keys.end(), {float(q.x), float(q.y), float(q.z), float(q.w)});
    }
    return keys;
}

} // namespace gsh
