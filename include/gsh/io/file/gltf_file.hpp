// SPDX-License-Identifier: Apache-2.0
/// @file  Opens glTF and GLB files with tinygltf, bounded in memory and confined to the file's folder.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/gltf_extensions.hpp>
#include <gsh/io/file/gltf_json.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/named_path.hpp>
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
#include <tuple>
#include <utility>
#include <vector>

namespace gsh::detail {

/// The model of a file. Materials, images and all that is not asked for are left out before tinygltf sees the file, so
/// it opens no image. A buffer's URI must lead to a file in the folder of the glTF file, or below; its size must be
/// what the JSON states before it is read.
///
/// Errors  IoError naming the file: a truncated or invalid container, JSON nested deeper than 256 levels, a required
///         extension that is not read, too many elements, a buffer that is short or outside of the folder.
class GltfFile {
public:
    explicit GltfFile(const InputFile& input, GltfParts parts = GltfParts::nodes);

    [[nodiscard]] const tinygltf::Model& model() const { return model_; }
    /// The objects `extensions` of the whole file and `extras` of its asset; {} if there are none.
    [[nodiscard]] const nlohmann::json& extensions() const { return extensions_; }
    [[nodiscard]] const nlohmann::json& asset_extras() const { return asset_extras_; }
    [[nodiscard]] const std::string& name() const { return name_; }

    /// Throws IoError unless 0 <= index < count: "FILE: WHAT is 7, expected an index below 3".
    void check_index(int index, std::size_t count, const std::string& what) const;
    /// Throws IoError: "FILE: WHAT".
    [[noreturn]] void fail(const std::string& what) const { throw IoError(name_ + ": " + what); }

private:
    std::string name_;
    std::filesystem::path folder_;
    tinygltf::Model model_;
    nlohmann::json extensions_ = nlohmann::json::object(), asset_extras_ = nlohmann::json::object();
    std::map<std::string, std::size_t> allowed_; ///< files that buffers may be read from, with their sizes

    static constexpr std::size_t json_limit = std::size_t(1) << 26, glb_limit = 0xFFFFFFFF;
    std::size_t buffer_limit_; ///< bytes of the file, and of all buffers together

    nlohmann::json reduced_json(std::string_view text, std::size_t chunk_bytes, GltfParts parts);
    void check_required(const nlohmann::json& names, GltfParts parts) const;
    void check_counts(const nlohmann::json& json) const;
    void check_buffers(nlohmann::json& json, std::size_t chunk_bytes);
    std::size_t external_size(const std::string& uri, const std::string& what);
    void parse(const std::string& bytes, bool binary);
};

// -------------------------------------------------------------------------------------------------------------

inline GltfFile::GltfFile(const InputFile& input, GltfParts parts)
    : name_(input.name()), buffer_limit_(parts == GltfParts::meshes ? glb_limit : std::size_t(1) << 30) {
    std::error_code error;
    folder_ =
        std::filesystem::weakly_canonical(input.path().has_parent_path() ? input.path().parent_path() : ".", error);
    std::string bytes = read_file(input, buffer_limit_);
    const bool binary = bytes.starts_with("glTF");
    if (!binary) {
        bytes = gltf_text(reduced_json(bytes, 0, parts));
        parse(bytes, binary);
        return;
    }
    const auto number = [&](std::size_t at) {
        std::uint32_t value = 0;
        std::memcpy(&value, bytes.data() + at, 4); // little-endian, as every machine that gsh runs on
        return static_cast<std::size_t>(value);
    };
    if (bytes.size() < 20) fail("ends within the header of a GLB file");
    if (number(4) != 2) fail("is GLB version " + std::to_string(number(4)) + ", expected 2");
    const std::size_t stated = number(8), json_size = number(12), next = 20 + json_size;
    if (stated > bytes.size())
        fail("states " + std::to_string(stated) + " bytes, but holds " + std::to_string(bytes.size()));
    if (std::memcmp(bytes.data() + 16, "JSON", 4) != 0) fail("does not begin with a chunk of JSON");
    if (json_size > bytes.size() - 20)
        fail("states " + std::to_string(json_size) + " bytes of JSON, but holds " + std::to_string(bytes.size() - 20));
    std::size_t chunk = 0; // bytes of binary data
    if (bytes.size() >= next + 8 && std::memcmp(bytes.data() + next + 4, "BIN\0", 4) == 0) {
        chunk = number(next);
        if (chunk > bytes.size() - next - 8)
            fail("states " + std::to_string(chunk) + " bytes of binary data, but holds " +
                 std::to_string(bytes.size() - next - 8));
    }
    std::string json = gltf_text(reduced_json(std::string_view(bytes).substr(20, json_size), chunk, parts));
    json.resize((json.size() + 3) / 4 * 4, ' ');
    // The container is put together anew, in place: it may be large.
    const std::size_t padded = (chunk + 3) / 4 * 4;
    bytes.resize(next + (chunk ? 8 + chunk : 0));
    if (chunk) bytes.append(padded - chunk, '\0');
    bytes.replace(20, json_size, json);
    if (bytes.size() > glb_limit) fail("holds 4 GiB, more than is read");
    const auto state = [&](std::size_t at, std::size_t value) {
        const auto word = static_cast<std::uint32_t>(value);
        std::memcpy(bytes.data() + at, &word, 4);
    };
    state(8, bytes.size()), state(12, json.size());
    if (chunk) state(20 + json.size(), padded);
    parse(bytes, binary);
}

inline void GltfFile::check_index(int index, std::size_t count, const std::string& what) const {
    if (index < 0 || static_cast<std::size_t>(index) >= count)
        fail(what + " is " + std::to_string(index) + ", expected an index below " + std::to_string(count));
}

/// What tinygltf needs, without the rest. Sets extensions_, asset_extras_ and allowed_.
inline nlohmann::json GltfFile::reduced_json(std::string_view text, std::size_t chunk_bytes, GltfParts parts) {
    if (text.size() > json_limit)
        fail("holds " + std::to_string(text.size()) + " bytes of JSON, more than the limit of " +
             std::to_string(json_limit) + "; store the numbers as GLB");
    if (const ForeignKind kind = foreign_kind(name_); kind && kind.family != "gltf")
        fail(not_the_kind(name_, "glTF", "gltf", ""));
    nlohmann::json all = parse_json<nlohmann::json>(text, name_ + ": is not glTF", {.depth = 256}), json;
    if (!all.is_object() || !all.contains("asset")) fail("is not glTF: the object 'asset' is missing");
    const auto& asset = all["asset"];
    if (!asset.is_object() || !asset.contains("version") || !asset["version"].is_string() ||
        !asset["version"].get<std::string>().starts_with("2"))
        fail("is not glTF 2");
    if (all.contains("extensionsRequired")) check_required(all["extensionsRequired"], parts);
    if (const auto& extensions = all["extensions"]; extensions.is_object()) extensions_ = extensions;
    for (const char* key :
         {"asset", "scene", "scenes", "nodes", "skins", "animations", "accessors", "bufferViews", "buffers", "meshes"})
        if (all.contains(key) && (key != std::string_view("meshes") || parts == GltfParts::meshes))
            json[key] = std::move(all[key]);
    if (const auto& extras = json["asset"]["extras"]; extras.is_object()) asset_extras_ = extras;
    strip_gltf(json);
    if (json.contains("animations") && json["animations"].is_array()) // targets of extensions are not nodes
        for (auto& animation : json["animations"])
            if (animation.is_object() && animation.contains("channels") && animation["channels"].is_array())
                std::erase_if(animation["channels"].get_ref<nlohmann::json::array_t&>(), [](const nlohmann::json& c) {
                    return c.is_object() && c.contains("target") && c["target"].is_object() &&
                           !c["target"].contains("node");
                });
    check_counts(json);
    if (json.contains("meshes")) strip_gltf_meshes(json["meshes"]);
    check_buffers(json, chunk_bytes);
    return json;
}

inline void GltfFile::check_required(const nlohmann::json& names, GltfParts parts) const {
    if (!names.is_array()) fail(std::string("extensionsRequired is ") + names.type_name() + ", expected an array");
    for (const auto& name : names) {
        if (!name.is_string())
            fail(std::string("an element of extensionsRequired is ") + name.type_name() + ", expected a name");
        if (const auto text = name.get<std::string>(); !reads_despite_gltf_extension(text, parts))
            fail("requires the glTF extension '" + shortened(text) +
                 "', which is not read; export the file without it");
    }
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
                                    {"buffers", 4096},
                                    {"meshes", 65536}})
        if (json.contains(key)) check(json[key], key, most);
    for (const auto& [list, keys, most] : {std::tuple<const char*, std::vector<const char*>, std::size_t>{
                                               "animations", {"channels", "samplers"}, 524288},
                                           {"meshes", {"primitives"}, 262144}}) {
        std::size_t total = 0;
        if (!json.contains(list)) continue;
        for (const auto& element : json[list])
            for (const char* key : keys) {
                const std::string what = std::string(list) + ": " + key;
                if (!element.contains(key)) fail("an element of " + std::string(list) + " has no " + key);
                check(element[key], what, 262144);
                if ((total += element[key].size()) > most)
                    fail(what + " have more than " + std::to_string(most) + " elements in total");
            }
    }
    // tinygltf leaves out what it cannot read of these, without an error.
    const auto all = [](const nlohmann::json& values, const auto& test) {
        return std::all_of(values.begin(), values.end(), test);
    };
    const nlohmann::json none = nlohmann::json::array();
    for (const auto& node : json.contains("nodes") ? json["nodes"] : none)
        for (const char* key : {"translation", "rotation", "scale", "matrix"})
            if (node.contains(key) &&
                (!node[key].is_array() || !all(node[key], [](const nlohmann::json& v) { return v.is_number(); })))
                fail(std::string("the ") + key + " of a node is not a list of numbers");
    for (const auto& mesh : json.contains("meshes") ? json["meshes"] : none)
        for (const auto& primitive : mesh["primitives"]) {
            if (!primitive.contains("attributes") || !primitive["attributes"].is_object() ||
                !all(primitive["attributes"], [](const nlohmann::json& v) { return v.is_number_integer(); }))
                fail("the attributes of a primitive are not an object of indices");
            for (const char* key : {"indices", "mode"})
                if (primitive.contains(key) && !primitive[key].is_number_unsigned())
                    fail(std::string("the ") + key + " of a primitive is " + primitive[key].type_name() +
                         ", expected a whole number");
        }
    for (const auto& accessor : json.contains("accessors") ? json["accessors"] : none) {
        if (accessor.contains("bufferView") && !accessor["bufferView"].is_number_integer())
            fail("the bufferView of an accessor is not a whole number");
        if (accessor.contains("sparse") && !accessor["sparse"].is_object())
            fail(std::string("the sparse of an accessor is ") + accessor["sparse"].type_name() +
                 ", expected an object");
    }
}

inline void GltfFile::check_buffers(nlohmann::json& json, std::size_t chunk_bytes) {
    if (!json.contains("buffers")) return;
    std::size_t total = 0, number = 0;
    for (auto& buffer : json["buffers"]) {
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
                buffer["uri"] = with_escaped_plus(uri); // tinygltf takes a plus for a blank
                place = "the file " + shortened(uri) + " holds";
                if (found > size) found = size + 1; // tinygltf wants the exact size
            }
        }
        if (found < size || (found > size && !place.starts_with("the GLB") && !place.starts_with("the data")))
            fail(what + " is short or of another size: its byteLength is " + std::to_string(size) + ", but " + place +
                 (found > size ? " more" : " " + std::to_string(found)));
        if ((total += size) > buffer_limit_)
            fail("states buffers of more than " + std::to_string(buffer_limit_) + " bytes in total");
        ++number;
    }
}

inline std::size_t GltfFile::external_size(const std::string& uri, const std::string& what) {
    const std::string relative = decoded_uri(uri);
    std::error_code error;
    const auto scheme = relative.find(':');
    const auto target = std::filesystem::weakly_canonical(folder_ / relative, error);
    const auto [end, rest] = std::mismatch(folder_.begin(), folder_.end(), target.begin(), target.end());
    if (error || !stays_inside(relative) || scheme != std::string::npos || end != folder_.end() || rest == target.end())
        fail(what + ": the uri '" + shortened(uri) + "' leads out of the file's folder");
    const auto size =
        std::filesystem::is_regular_file(target, error) ? std::filesystem::file_size(target, error) : std::uintmax_t(0);
    if (error || size == 0) fail(what + ": the file '" + shortened(relative) + "' cannot be read, or is empty");
    if (size > buffer_limit_) fail(what + ": the file '" + shortened(relative) + "' is larger than is read");
    allowed_.emplace((folder_ / relative).string(), static_cast<std::size_t>(size));
    return static_cast<std::size_t>(size);
}

/// `bytes` is a whole GLB file, or JSON.
inline void GltfFile::parse(const std::string& bytes, bool binary) {
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
            const std::string content = read_file(file, found->second);
            out->assign(content.begin(), content.end());
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
        const auto size = static_cast<unsigned>(bytes.size());
        good = binary ? loader.LoadBinaryFromMemory(&model_, &problem, &warning,
                                                    reinterpret_cast<const unsigned char*>(bytes.data()), size,
                                                    folder_.string())
                      : loader.LoadASCIIFromString(&model_, &problem, &warning, bytes.data(), size, folder_.string());
    } catch (const std::bad_alloc&) {
        throw;
    } catch (const std::exception& error) {
        problem = error.what();
    }
    if (good) return;
    std::string line; // tinygltf's messages are several lines
    for (const std::string_view word : words_in(problem)) (line += line.empty() ? "" : " ").append(word);
    fail("is not valid glTF: " + shortened(line, 200));
}

} // namespace gsh::detail
