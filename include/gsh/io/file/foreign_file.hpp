// SPDX-License-Identifier: Apache-2.0
/// @file  Names files of other programs by their first bytes, with the way to convert them, for messages of readers.
#pragma once

#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/text_lines.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

namespace gsh {

/// A kind of file that a reader of another kind is given by mistake.
struct ForeignKind {
    std::string name;        ///< "a pickle of Python (protocol 4)"; empty for a kind that is not known
    std::string way_out;     ///< "unpack it with gunzip"; may be empty
    std::string family = {}; ///< of kinds that gsh reads: "npz", "npy", "gltf", "bvh", "ply", "png", "jpeg"

    explicit operator bool() const { return !name.empty(); }
};

/// Recognises a file by its first bytes. No file is read further, nothing in it is run.
[[nodiscard]] inline ForeignKind foreign_kind(const InputFile& input);

/// The end of a reader's message about a file that it cannot read: "is a pickle of Python (protocol 4), expected an
/// .npz archive; …" with the way out, or `otherwise` for a file of unknown kind, or of the reader's own `family`.
[[nodiscard]] inline std::string not_the_kind(const InputFile& input, std::string_view expected,
                                              std::string_view family, const std::string& otherwise);

/// What a folder holds in which a reader finds nothing, for messages: "; it holds 20 files .pkl, such as 000.pkl, a
/// pickle of Python (protocol 2); …". Of the most frequent ending, hidden files left out, two folders down.
[[nodiscard]] inline std::string folder_contents(const std::filesystem::path& folder);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The first bytes of a file, its last one, and its size.
struct FileEnds {
    std::string head;
    char last = 0;
    std::size_t size = 0;
    bool is_read = false;

    explicit FileEnds(const InputFile& input) {
        std::error_code ignored;
        if (!input.contents() && !std::filesystem::is_regular_file(input.path(), ignored)) return;
        try {
            InputStream file(input);
            size = file.size();
            char bytes[4096];
            head.assign(bytes, file.read(bytes, sizeof bytes));
            if (size == 0 || !file.seek(size - 1) || file.read(&last, 1) != 1) last = 0;
            is_read = true;
        } catch (const IoError&) {
        } // a file that cannot be opened has no kind
    }
};

inline constexpr const char* python_page =
    "docs/captures.md has programs that convert it (Files of Python programs; for a body: The body's file)";
inline constexpr const char* to_glb = "convert it to GLB, for instance with Blender";
inline constexpr const char* markers =
    "it holds markers, not the joints of a skeleton; solve a skeleton with the program that recorded it, as BVH";

/// Pickles of protocols 2 to 5 begin with their number; those of 0 and 1 with the opcodes of a dictionary, a list, a
/// tuple or an object. All end with a full stop.
inline ForeignKind pickle_kind(const FileEnds& file) {
    const std::string_view head = file.head;
    if (head.size() < 2) return {};
    const auto pickle = [](const std::string& protocol) {
        return ForeignKind{"a pickle of Python (protocol " + protocol + ")", python_page};
    };
    if (head[0] == '\x80' && head[1] >= 2 && head[1] <= 5) {
        if (head.substr(2).starts_with("\x8a\x0al\xfc\x9c\x46\xf9 j\xa8P\x19"))
            return {"a file of PyTorch before version 1.6 (a pickle)", python_page};
        return pickle(std::to_string(head[1]));
    }
    if (file.last != '.') return {};
    for (const std::string_view start : {"(dp", "(lp", "(d.", "(l.", "(ip", "ccopy_reg\n", "ccopyreg\n", "cnumpy",
                                         "ccollections\n", "((d", "((l", "(I", "(F", "(cnumpy"})
        if (head.starts_with(start)) return pickle("0");
    for (const std::string_view start : {"}q", "]q", "}(", "(}q", "(]q", "}.", "]."})
        if (head.starts_with(start)) return pickle("1");
    return {};
}

/// Zip archives by the names of their first members.
inline ForeignKind zip_kind(const FileEnds& file) {
    const std::string_view head = file.head;
    if (!head.starts_with("PK\x03\x04") && !head.starts_with("PK\x05\x06")) return {};
    const auto byte = [&](std::size_t i) { return static_cast<std::size_t>(static_cast<unsigned char>(head[i])); };
    std::string_view name;
    if (head.size() > 30) name = head.substr(30, byte(26) + 256 * byte(27));
    if (name.ends_with(".npy")) return {"an .npz archive of NumPy", "", "npz"};
    if (head.find("data.pkl") != std::string_view::npos || head.find("/version") != std::string_view::npos)
        return {"a file of PyTorch (.pt, .pth)", python_page};
    if (name.ends_with(".usd") || name.ends_with(".usda") || name.ends_with(".usdc"))
        return {"a USD package (.usdz)", to_glb};
    if (name.starts_with("[Content_Types]") || name.starts_with("_rels/"))
        return {"a document of an office program", ""};
    return {"a zip archive of other files", "unpack it"};
}

/// An array of NumPy, by its header.
inline ForeignKind npy_kind(const FileEnds& file) {
    const std::string_view head = file.head;
    if (!head.starts_with("\x93NUMPY")) return {};
    if (head.find("'descr': '|O'") != std::string_view::npos)
        return {"an .npy file with a pickled object, as np.save writes a dictionary", python_page};
    const std::size_t open = head.find('(', 8), close = head.find(')', 8);
    const std::string shape =
        open < close && close < 200 ? " of shape " + shortened(head.substr(open, close + 1 - open)) : "";
    return {"a single array of NumPy (.npy)" + shape, python_page, "npy"};
}

/// First bytes, the kind that they mean, and the way out.
struct Signature {
    std::string_view start, name, way_out, family = {};
};

inline ForeignKind kind_by_signature(std::string_view head) {
    using namespace std::string_view_literals;
    static constexpr std::string_view unpack = "unpack it", no_way = "";
    static constexpr std::string_view video =
        "extract its frames, for instance with ffmpeg -i VIDEO %04d.png (docs/captures.md, Step by step)";
    static constexpr std::string_view image =
        "convert it to PNG, for instance with ImageMagick: mogrify -format png FILES";
    static constexpr Signature signatures[] = {
        {"\x89HDF\r\n\x1a\n"sv, "an HDF5 file", python_page},
        {"MATLAB 5.0 MAT-file"sv, "a MATLAB file (.mat, version 5)", python_page},
        {"MATLAB 7.3 MAT-file"sv, "a MATLAB file (.mat, version 7.3, which is HDF5)", python_page},
        {"Kaydara FBX"sv, "an FBX file", to_glb},
        {"; FBX"sv, "an FBX file (as text)", to_glb},
        {"BLENDER"sv, "a file of Blender (.blend)", "export it from Blender as GLB"},
        {"PXR-USDC"sv, "a USD file", to_glb},
        {"#usda "sv, "a USD file (as text)", to_glb, "usda"},
        {"Ogawa"sv, "an Alembic file, which holds moving vertices but no skeleton", to_glb},
        {"glTF"sv, "a GLB file", no_way, "gltf"},
        {"HIERARCHY"sv, "a BVH motion", no_way, "bvh"},
        {"Vocaloid Motion Data"sv, "a motion of MikuMikuDance (.vmd)", "convert it to BVH or .vrma"},
        {"PathFileType"sv, "a file of markers (.trc)", markers},
        {"ply\n"sv, "a PLY file", no_way, "ply"},
        {"ply\r"sv, "a PLY file", no_way, "ply"},
        {"\x89PNG\r\n\x1a\n"sv, "a PNG image", no_way, "png"},
        {"\xff\xd8\xff"sv, "a JPEG image", no_way, "jpeg"},
        {"BM"sv, "a BMP image", image, "bmp"},
        {"GIF8"sv, "a GIF image", image},
        {"II*\0"sv, "a TIFF image (or a camera's raw image)", image},
        {"MM\0*"sv, "a TIFF image (or a camera's raw image)", image},
        {"\x76\x2f\x31\x01"sv, "an OpenEXR image", image},
        {"#?RADIANCE"sv, "a Radiance HDR image (.hdr)", image, "hdr"},
        {"\x00\x00\x00\x0cjP  "sv, "a JPEG 2000 image", image},
        {"\x00\x00\x00\x0cJXL "sv, "a JPEG XL image", image},
        {"\xff\x0a"sv, "a JPEG XL image", image},
        {"8BPS"sv, "a Photoshop image", image},
        {"P5"sv, "a PGM image", image},
        {"P6"sv, "a PPM image", image},
        {"\x1a\x45\xdf\xa3"sv, "a Matroska or WebM video", video},
        {"FLV\x01"sv, "a Flash video", video},
        {"NGSP"sv, "an SPZ file of Gaussians", no_way, "spz"},
        {"\x1f\x8b"sv, "compressed by gzip", "unpack it with gunzip", "gzip"},
        {"\x28\xb5\x2f\xfd"sv, "compressed by Zstandard, as files of Blender are from version 3 on",
         "unpack it with unzstd, or export it from Blender as GLB"},
        {"\x78\x9c"sv, "compressed by zlib, as joblib writes pickles", python_page},
        {"\x78\xda"sv, "compressed by zlib, as joblib writes pickles", python_page},
        {"\x04\x22\x4d\x18"sv, "compressed by LZ4, as joblib writes pickles", python_page},
        {"BZh"sv, "compressed by bzip2", "unpack it with bunzip2"},
        {"\xfd"
         "7zXZ\0"sv,
         "compressed by xz", "unpack it with unxz"},
        {"7z\xbc\xaf\x27\x1c"sv, "a 7z archive", unpack},
        {"Rar!\x1a\x07"sv, "a RAR archive", unpack},
        {"%PDF"sv, "a PDF document", no_way},
        {"version https://git-lfs"sv, "a pointer of Git LFS in place of the file", "fetch it with git lfs pull"},
        {"%YAML 1.1\n%TAG !u!"sv, "an asset of Unity", "export it from Unity as glTF"},
    };
    for (const Signature& s : signatures)
        if (head.starts_with(s.start)) return {std::string(s.name), std::string(s.way_out), std::string(s.family)};
    const auto at = [&](std::size_t place, std::string_view text) {
        return head.size() >= place + text.size() && head.substr(place, text.size()) == text;
    };
    if (at(0, "RIFF") && at(8, "WEBP")) return {"a WebP image", std::string(image), "webp"};
    if (at(0, "RIFF") && at(8, "AVI ")) return {"an AVI video", std::string(video)};
    if (at(4, "ftyp")) {
        for (const std::string_view brand : {"avif", "avis"})
            if (at(8, brand)) return {"an AVIF image", std::string(image)};
        for (const std::string_view brand : {"heic", "heix", "heim", "heis", "hevc", "hevx", "mif1", "msf1"})
            if (at(8, brand)) return {"a HEIC image", std::string(image)};
        return {at(8, "qt  ") ? "a QuickTime video (.mov)" : "an MP4 video", std::string(video)};
    }
    if (at(4, "moov") || at(4, "mdat") || at(4, "wide")) return {"a QuickTime video (.mov)", std::string(video)};
    if (at(257, "ustar")) return {"a tar archive", "unpack it"};
    if (at(1, "\x50") && head.size() >= 512 && head[0] >= 1 && head[0] <= 20)
        return {"a file of markers (.c3d)", markers};
    if (at(8, "{\"") && head.size() > 16 && at(4, std::string_view("\0\0\0\0", 4)))
        return {"a safetensors file", "", "safetensors"};
    return {};
}

/// Texts that are recognised after blanks at their beginning.
inline ForeignKind kind_of_text(std::string_view head) {
    if (head.starts_with("\xef\xbb\xbf")) head.remove_prefix(3);
    head.remove_prefix(std::min(head.find_first_not_of(" \t\r\n"), head.size()));
    std::string start(head.substr(0, 512));
    for (char& c : start) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    if (start.starts_with("<!doctype html") || start.starts_with("<html"))
        return {"a web page", "the download has failed, or stopped at a login; download the file itself"};
    if (start.starts_with("hierarchy")) return {"a BVH motion", "", "bvh"};
    if (start.starts_with("#") || start.starts_with(":")) { // Acclaim's files begin with comments
        if (start.find("\n:fully-specified") != std::string::npos || start.starts_with(":fully-specified"))
            return {"a motion of Acclaim (.amc)", "convert it with its .asf to BVH"};
        if (start.find("\n:version") != std::string::npos || start.starts_with(":version"))
            return {"a skeleton of Acclaim (.asf)", "convert it with its .amc to BVH"};
    }
    if (start.starts_with("<") && start.find("<collada") != std::string::npos) return {"a COLLADA file (.dae)", to_glb};
    if (start.starts_with("<?xml") || start.starts_with("<opencv_storage"))
        return {start.find("<opencv_storage") != std::string::npos ? "XML of OpenCV" : "an XML text",
                start.find("<opencv_storage") != std::string::npos ? "write it as .yml" : "", "xml"};
    return {};
}

} // namespace detail

inline ForeignKind foreign_kind(const InputFile& input) {
    const detail::FileEnds file(input);
    if (file.head.empty()) return file.is_read && file.size == 0 ? ForeignKind{"empty", ""} : ForeignKind();
    if (const ForeignKind kind = detail::zip_kind(file)) return kind;
    if (const ForeignKind kind = detail::npy_kind(file)) return kind;
    if (const ForeignKind kind = detail::kind_by_signature(file.head)) return kind;
    if (const ForeignKind kind = detail::pickle_kind(file)) return kind;
    return detail::kind_of_text(file.head);
}

inline std::string not_the_kind(const InputFile& input, std::string_view expected, std::string_view family,
                                const std::string& otherwise) {
    const ForeignKind kind = foreign_kind(input);
    if (!kind || (!kind.family.empty() && kind.family == family)) return otherwise;
    return "is " + kind.name + ", expected " + std::string(expected) +
           (kind.way_out.empty() ? "" : "; " + kind.way_out);
}

inline std::string folder_contents(const std::filesystem::path& folder) {
    std::map<std::string, std::pair<std::size_t, std::filesystem::path>> kinds; // by ending: their number, the first
    std::error_code error;
    std::size_t seen = 0;
    const std::filesystem::recursive_directory_iterator end;
    for (std::filesystem::recursive_directory_iterator entry(folder, error); !error && entry != end && seen < 10000;
         entry.increment(error)) {
        if (entry.depth() == 2) entry.disable_recursion_pending();
        std::error_code ignored;
        if (entry->path().filename().string().starts_with('.') || !entry->is_regular_file(ignored)) continue;
        auto& [count, first] = kinds[entry->path().extension().string()];
        ++seen;
        if (count++ == 0 || entry->path() < first) first = entry->path();
    }
    if (kinds.empty()) return "; it holds no files";
    const auto most = std::max_element(kinds.begin(), kinds.end(),
                                       [](const auto& a, const auto& b) { return a.second.first < b.second.first; });
    const auto& [count, first] = most->second;
    const ForeignKind kind = foreign_kind(first);
    return "; it holds " + std::to_string(count) + (count == 1 ? " file " : " files ") +
           detail::shortened(most->first) + ", such as " +
           detail::shortened(first.lexically_relative(folder).string()) + (kind ? ", " + kind.name : "") +
           (kind.way_out.empty() ? "" : "; " + kind.way_out);
}

} // namespace gsh
