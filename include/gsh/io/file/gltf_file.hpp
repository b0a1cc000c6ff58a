// SPDX-License-Identifier: Apache-2.0
/// @file  Opens glTF and GLB files with tinygltf, bounded in memory and confined to the file's folder.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <nlohmann/json.hpp>
#include <tiny_gltf.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <exception>
#include <filesystem>
#include <map>
#include <new>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh::detail {

/// Nodes, skins, animations and their numbers. Meshes, materials and images are left out before tinygltf sees the file,
/// so it opens no image. A buffer's URI must lead to a file in the folder of the glTF file, or below; its size must be
/// what the JSON states before it is read.
///
/// Errors  IoError naming the file: a truncated or invalid container, JSON nested deeper than 256 levels, a required
///         compression, too many elements, a buffer that is short or outside of the folder.
class GltfFile {
public:
    explicit GltfFile(const std::filesystem::path& path);

    [[nodiscard]] const tinygltf::Model& model() const { return model_; }
    /// The object `extensions` of the whole file, {} if there is none.
    [[nodiscard]] const nlohmann::json& extensions() const { return extensions_; }
    [[nodiscard]] const std::string& name() const { return name_; }

    /// Throws IoError unless 0 <= index < count: "FILE: WHAT is 7, expected an index below 3".
    void check_index(int index, std::size_t count, const std::string& what) const;
    /// Throws IoError: "FILE: WHAT".
    [[noreturn]] void fail(const std::string& what) const { throw IoError(name_ + ": " + what); }

private:
    std::string name_;
    std::filesystem::path folder_;
    tinygltf::Model model_;
    nlohmann::json extensions_;
    std::map<std::string, std::size_t> allowed_; ///< files that buffers may be read from, with their sizes

    static constexpr std::size_t json_limit = std::size_t(1) << 26, buffer_limit = std::size_t(1) << 30;

    void check_depth(std::string_view json) const;
    nlohmann::json reduced_json(std::string_view text, std::size_t chunk_bytes);
    void check_counts(const nlohmann::json& json) const;
    void check_buffers(nlohmann::json& json, std::size_t chunk_bytes);
    std::size_t external_size(const std::string& uri, const std::string& what);
    void parse(const std::string& json, std::string_view chunk, bool binary);
};

/// A URI's text with %20 and other escapes resolved.
[[nodiscard]] inline std::string decoded_uri(std::string_view uri) {
    const auto digit = [](char c) {
        return c >= '0' && c <= '9'   ? c - '0'
               : c >= 'a' && c <= 'f' ? c - 'a' + 10
               : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                      : -1;
    };
    std::string text;
    for (std::size_t i = 0; i < uri.size(); ++i)
        if (uri[i] == '%' && i + 2 < uri.size() && digit(uri[i + 1]) >= 0 && digit(uri[i + 2]) >= 0) {
            text.push_back(static_cast<char>(16 * digit(uri[i + 1]) + digit(uri[i + 2])));
            i += 2;
        } else {
            text.push_back(uri[i]);
        }
    return text;
}

// -------------------------------------------------------------------------------------------------------------

inline GltfFile::GltfFile(const std::filesystem::path& path) : name_(path.string()) {
    std::error_code error;
    folder_ = std::filesystem::weakly_canonical(path.has_parent_path() ? path.parent_path() : ".", error);
    const std::string bytes = read_file(path);
    std::string_view json = bytes, chunk;
    const bool binary = json.starts_with("glTF");
    if (binary) {
        const auto number = [&](std::size_t at) {
            std::uint32_t value = 0;
            std::memcpy(&value, bytes.data() + at, 4); // little-endian, as every machine that gsh runs on
            return static_cast<std::size_t>(value);
        };
        if (bytes.size() < 20) fail("ends within the header of a GLB file");
        if (number(4) != 2) fail("is GLB version " + std::to_string(number(4)) + ", expected 2");
        const std::size_t stated = number(8), json_size = number(12);
        if (stated > bytes.size())
            fail("states " + std::to_string(stated) + " bytes, but holds " + std::to_string(bytes.size()));
        if (std::memcmp(bytes.data() + 16, "JSON", 4) != 0) fail("does not begin with a chunk of JSON");
        if (json_size > bytes.size() - 20)
            fail("states " + std::to_string(json_size) + " bytes of JSON, but holds " +
                 std::to_string(bytes.size() - 20));
        json = std::string_view(bytes).substr(20, json_size);
        if (const std::size_t next = 20 + json_size; bytes.size() >= next + 8) {
            const std::size_t size = number(next);
            if (std::memcmp(bytes.data() + next + 4, "BIN\0", 4) == 0) {
                if (size > bytes.size() - next - 8)
                    fail("states " + std::to_string(size) + " bytes of binary data, but holds " +
                         std::to_string(bytes.size() - next - 8));
                chunk = std::string_view(bytes).substr(next + 8, size);
            }
        }
    }
    const nlohmann::json reduced = reduced_json(json, chunk.size());
    parse(reduced.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), chunk, binary);
}

inline void GltfFile::check_index(int index, std::size_t count, const std::string& what) const {
    if (index < 0 || static_cast<std::size_t>(index) >= count)
        fail(what + " is " + std::to_string(index) + ", expected an index below " + std::to_string(count));
}

inline void GltfFile::check_depth(std::string_view json) const {
    std::size_t depth = 0;
    bool text = false;
    for (std::size_t i = 0; i < json.size(); ++i) {
        const char c = json[i];
        if (text && c == '\\')
            ++i;
        else if (c == '"')
            text = !text;
        else if (!text && (c == '[' || c == '{')) {
            if (++depth > 256) fail("is JSON that is nested deeper than 256 levels");
        } else if (!text && (c == ']' || c == '}') && depth > 0)
            --depth;
    }
}

/// What tinygltf needs, without the rest. Sets extensions_ and allowed_.
inline nlohmann::json GltfFile::reduced_json(std::string_view text, std::size_t chunk_bytes) {
    if (text.size() > json_limit)
        fail("holds " + std::to_string(text.size()) + " bytes of JSON, more than the limit of " +
             std::to_string(json_limit) + "; store the numbers as GLB");
    check_depth(text);
    nlohmann::json all, json;
    try {
        all = nlohmann::json::parse(text);
    } catch (const nlohmann::json::exception& error) {
        fail(std::string("is not glTF, or truncated: ") + error.what());
    }
    if (!all.is_object() || !all.contains("asset")) fail("is not glTF: the object 'asset' is missing");
    const auto& asset = all["asset"];
    if (!asset.is_object() || !asset.contains("version") || !asset["version"].is_string() ||
        !asset["version"].get<std::string>().starts_with("2"))
        fail("is not glTF 2");
    if (all.contains("extensionsRequired") && all["extensionsRequired"].is_array())
        for (const auto& required : all["extensionsRequired"])
            if (required == "EXT_meshopt_compression" || required == "KHR_meshopt_compression")
                fail("requires " + required.get<std::string>() + ", which is not read; export it without compression");
    extensions_ =
        all.contains("extensions") && all["extensions"].is_object() ? all["extensions"] : nlohmann::json::object();
    for (const char* key :
         {"asset", "scene", "scenes", "nodes", "skins", "animations", "accessors", "bufferViews", "buffers"})
        if (all.contains(key)) json[key] = std::move(all[key]);
    const auto strip = [](const auto& self, nlohmann::json& value) -> void { // at most 256 levels
        if (value.is_object()) value.erase("extras"), value.erase("extensions");
        if (value.is_structured())
            for (auto& child : value) self(self, child);
    };
    strip(strip, json);
    if (json.contains("animations") && json["animations"].is_array()) // targets of extensions are not nodes
        for (auto& animation : json["animations"])
            if (animation.is_object() && animation.contains("channels") && animation["channels"].is_array())
                std::erase_if(animation["channels"].get_ref<nlohmann::json::array_t&>(), [](const nlohmann::json& c) {
                    return c.is_object() && c.contains("target") && c["target"].is_object() &&
                           !c["target"].contains("node");
                });
    check_counts(json);
    check_buffers(json, chunk_bytes);
    return json;
}

inline void GltfFile::check_counts(const nlohmann::json& json) const {
    const auto check = [&](const nlohmann::json& list, const std::string& what, std::size_t most) {
        if (!list.is_array()) fail(what + " is " + list.type_name() + ", expected an array");
        if (list.size() > most)
            fail(what + " has " + std::to_string(list.size()) + " elements, more than the limit of " +
                 std::to_string(most));
        for (const auto& element : list)
            if (!element.is_object())
                fail("an element of " + what + " is " + element.type_name() + ", expected an object");
    };
    for (const auto& [key, most] : {std::pair<const char*, std::size_t>{"scenes", 1000},
                                    {"nodes", 65536},
                                    {"skins", 4096},
                                    {"animations", 4096},
                                    {"accessors", 262144},
                                    {"bufferViews", 262144},
                                    {"buffers", 4096}})
        if (json.contains(key)) check(json[key], key, most);
    std::size_t channels = 0;
    if (json.contains("animations"))
        for (const auto& animation : json["animations"])
            for (const char* key : {"channels", "samplers"})
                if (animation.contains(key)) {
                    check(animation[key], std::string("animations: ") + key, 262144);
                    channels += animation[key].size();
                }
    if (channels > 524288) fail("has " + std::to_string(channels) + " channels of animations, more than are read");
}

inline void GltfFile::check_buffers(nlohmann::json& json, std::size_t chunk_bytes) {
    if (!json.contains("buffers")) return;
    std::size_t total = 0, number = 0;
    for (const auto& buffer : json["buffers"]) {
        const std::string what = "buffer " + std::to_string(number);
        if (!buffer.contains("byteLength") || !buffer["byteLength"].is_number_unsigned() || buffer["byteLength"] == 0)
            fail(what + " has no byteLength above 0");
        const auto size = buffer["byteLength"].get<std::size_t>();
        std::size_t found = chunk_bytes;
        std::string place = "the GLB's binary data hold";
        if (!buffer.contains("uri")) {
            if (number > 0 || chunk_bytes == 0) fail(what + " has no uri, and the file has no binary data for it");
        } else {
            if (!buffer["uri"].is_string()) fail(what + ": uri is not a text");
            const auto uri = buffer["uri"].get<std::string>();
            if (uri.starts_with("data:")) {
                found = uri.size(); // base64 takes four characters for three bytes; tinygltf checks the exact number
                place = "the data URI holds";
            } else {
                found = external_size(uri, what);
                place = "the file " + uri + " holds";
                if (found > size) found = size + 1; // tinygltf wants the exact size
            }
        }
        if (found < size || (found > size && !place.starts_with("the GLB") && !place.starts_with("the data")))
            fail(what + " is short or of another size: its byteLength is " + std::to_string(size) + ", but " + place +
                 (found > size ? " more" : " " + std::to_string(found)));
        if ((total += size) > buffer_limit)
            fail("states buffers of more than " + std::to_string(buffer_limit) + " bytes in total");
        ++number;
    }
}

inline std::size_t GltfFile::external_size(const std::string& uri, const std::string& what) {
    const std::string relative = decoded_uri(uri);
    std::error_code error;
    const auto scheme = relative.find(':');
    const auto target = std::filesystem::weakly_canonical(folder_ / relative, error);
    const auto [end, rest] = std::mismatch(folder_.begin(), folder_.end(), target.begin(), target.end());
    if (error || relative.empty() || relative.find('\0') != std::string::npos || scheme != std::string::npos ||
        relative.starts_with("/") || end != folder_.end() || rest == target.end())
        fail(what + ": the uri '" + shortened(uri) + "' leads out of the file's folder");
    const auto size =
        std::filesystem::is_regular_file(target, error) ? std::filesystem::file_size(target, error) : std::uintmax_t(0);
    if (error || size == 0) fail(what + ": the file '" + shortened(relative) + "' cannot be read, or is empty");
    if (size > buffer_limit) fail(what + ": the file '" + shortened(relative) + "' is larger than is read");
    allowed_.emplace((folder_ / relative).string(), static_cast<std::size_t>(size));
    return static_cast<std::size_t>(size);
}

inline void GltfFile::parse(const std::string& json, std::string_view chunk, bool binary) {
    tinygltf::TinyGLTF loader;
    tinygltf::FsCallbacks files{};
    files.user_data = &allowed_;
    files.FileExists = [](const std::string& file, void* allowed) {
        return static_cast<std::map<std::string, std::size_t>*>(allowed)->contains(file);
    };
    files.ExpandFilePath = [](const std::string& file, void*) { return file; };
    files.ReadWholeFile = [](std::vector<unsigned char>* out, std::string* problem, const std::string& file,
                             void* allowed) {
        const auto* list = static_cast<std::map<std::string, std::size_t>*>(allowed);
        const auto found = list->find(file);
        if (found == list->end()) return false;
        try {
            const std::string bytes = read_file(file, found->second);
            out->assign(bytes.begin(), bytes.end());
            return true;
        } catch (const Error& error) {
            *problem = error.what();
            return false;
        }
    };
    files.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&, void*) {
        return false;
    };
    loader.SetFsCallbacks(files);
    std::string problem, warning;
    bool good = false;
    try {
        if (binary) {
            std::string glb("glTF", 4), padded = json;
            padded.resize((json.size() + 3) / 4 * 4, ' ');
            const std::size_t body = (chunk.size() + 3) / 4 * 4;
            const auto append = [&](std::size_t number) {
                const auto value = static_cast<std::uint32_t>(number);
                glb.append(reinterpret_cast<const char*>(&value), 4);
            };
            append(2), append(20 + padded.size() + (body ? 8 + body : 0));
            append(padded.size()), glb.append("JSON").append(padded);
            if (body) append(body), glb.append("BIN\0", 4).append(chunk), glb.append(body - chunk.size(), '\0');
            good = loader.LoadBinaryFromMemory(&model_, &problem, &warning,
                                               reinterpret_cast<const unsigned char*>(glb.data()),
                                               static_cast<unsigned>(glb.size()), folder_.string());
        } else {
            good = loader.LoadASCIIFromString(&model_, &problem, &warning, json.data(),
                                              static_cast<unsigned>(json.size()), folder_.string());
        }
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {
        problem = error.what();
    }
    if (good) return;
    std::string line; // tinygltf's messages are several lines
    for (const std::string_view word : words_in(problem)) (line += line.empty() ? "" : " ").append(word);
    fail("is not valid glTF: " + line);
}

} // namespace gsh::detail
