// SPDX-License-Identifier: Apache-2.0
#include "fuzz/containers.hpp"

#include <gsh/core/error.hpp>
#include <gsh/io/file/gzip.hpp>
#include <gsh/io/file/zstd.hpp>

#include <zip.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace gsh::fuzz {

namespace {

constexpr std::size_t most_inflated = std::size_t(1) << 20; // of one part; seeds are small
constexpr std::size_t most_parts = 256;
constexpr std::string_view png_signature("\x89PNG\r\n\x1a\n", 8);

template <class Number>
Number number_at(std::string_view bytes, std::size_t at) {
    Number value{};
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
}

template <class Number>
void append(std::string& bytes, Number value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::uint32_t big_endian(std::uint32_t value) {
    return __builtin_bswap32(value);
}

std::uint32_t checksum(std::string_view bytes) {
    return static_cast<std::uint32_t>(
        crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

/// What a zlib or gzip stream holds; no value for a damaged one, or one that inflates to too much.
std::optional<std::string> inflated(std::string_view bytes, int window_bits) {
    z_stream stream{};
    if (inflateInit2(&stream, window_bits) != Z_OK) return std::nullopt;
    std::string out(most_inflated, '\0');
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    stream.next_out = reinterpret_cast<Bytef*>(out.data());
    stream.avail_out = static_cast<uInt>(out.size());
    const int code = inflate(&stream, Z_FINISH);
    out.resize(out.size() - stream.avail_out);
    inflateEnd(&stream);
    if (code != Z_STREAM_END) return std::nullopt;
    return out;
}

std::optional<std::string> decompressed(std::string_view frame) {
    const unsigned long long size = ZSTD_getFrameContentSize(frame.data(), frame.size());
    if (size > most_inflated) return std::nullopt; // also for an unknown size, or an error
    try {
        return zstd_decompressed(frame, static_cast<std::size_t>(size), "frame");
    } catch (const Error&) {
        return std::nullopt;
    }
}

std::optional<Container> zip_parts(std::string_view bytes) {
    zip_error_t error;
    zip_error_init(&error);
    zip_source_t* const source = zip_source_buffer_create(bytes.data(), bytes.size(), 0, &error);
    const std::unique_ptr<zip_t, void (*)(zip_t*)> archive(
        source ? zip_open_from_source(source, ZIP_RDONLY, &error) : nullptr, zip_discard);
    zip_error_fini(&error);
    if (!archive) {
        zip_source_free(source);
        return std::nullopt;
    }
    Container container{Container::Kind::zip, {}};
    const zip_int64_t count = std::min<zip_int64_t>(zip_get_num_entries(archive.get(), 0), most_parts);
    for (zip_int64_t i = 0; i < count; ++i) {
        const auto index = static_cast<zip_uint64_t>(i);
        zip_stat_t stat;
        if (zip_stat_index(archive.get(), index, 0, &stat) != 0 || stat.size > most_inflated) continue;
        const std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> member(zip_fopen_index(archive.get(), index, 0),
                                                                       zip_fclose);
        if (!member) continue;
        std::string content(stat.size, '\0');
        const zip_int64_t read = zip_fread(member.get(), content.data(), content.size());
        content.resize(static_cast<std::size_t>(std::max<zip_int64_t>(read, 0)));
        container.parts.push_back({stat.name ? stat.name : "", std::move(content)});
    }
    if (container.parts.empty()) return std::nullopt;
    return container;
}

std::string zip_of(const Container& container) {
    std::string bytes, directory;
    for (const Container::Part& part : container.parts) {
        const auto begin = static_cast<std::uint32_t>(bytes.size());
        const auto size = static_cast<std::uint32_t>(part.bytes.size());
        const auto name_size = static_cast<std::uint16_t>(part.name.size());
        std::string common; // of the header before the member, and of its entry in the directory
        append<std::uint16_t>(common, 20), append<std::uint32_t>(common, 0), append<std::uint32_t>(common, 0x00210000);
        append(common, checksum(part.bytes)), append(common, size), append(common, size), append(common, name_size);
        append<std::uint16_t>(common, 0);
        bytes += "PK\x03\x04" + common + part.name + part.bytes;
        directory += "PK\x01\x02";
        append<std::uint16_t>(directory, 20);
        directory += common;
        append<std::uint16_t>(directory, 0), append<std::uint16_t>(directory, 0), append<std::uint16_t>(directory, 0);
        append<std::uint32_t>(directory, 0), append(directory, begin);
        directory += part.name;
    }
    const auto begin = static_cast<std::uint32_t>(bytes.size());
    const auto count = static_cast<std::uint16_t>(container.parts.size());
    bytes += directory + std::string("PK\x05\x06\0\0\0\0", 8);
    append(bytes, count), append(bytes, count), append(bytes, static_cast<std::uint32_t>(directory.size()));
    append(bytes, begin), append<std::uint16_t>(bytes, 0);
    return bytes;
}

std::optional<Container> png_parts(std::string_view bytes) {
    Container container{Container::Kind::png, {}};
    std::string compressed;
    std::size_t image = 0; // place of the image data among the parts
    for (std::size_t at = 8; at + 12 <= bytes.size() && container.parts.size() < most_parts;) {
        const std::size_t size = big_endian(number_at<std::uint32_t>(bytes, at));
        if (size > bytes.size() - at - 12) break;
        const std::string name(bytes.substr(at + 4, 4)), content(bytes.substr(at + 8, size));
        at += 12 + size;
        if (name != "IDAT") {
            container.parts.push_back({name, content});
        } else {
            if (compressed.empty()) image = container.parts.size(), container.parts.push_back({name, ""});
            compressed += content;
        }
    }
    if (container.parts.empty()) return std::nullopt;
    if (!compressed.empty()) {
        auto pixels = inflated(compressed, 15);
        if (!pixels) return std::nullopt;
        container.parts[image].bytes = std::move(*pixels);
    }
    return container;
}

std::string png_of(const Container& container) {
    std::string bytes(png_signature);
    for (const Container::Part& part : container.parts) {
        const std::string content = part.name == "IDAT" ? detail::compressed_by_zlib(part.bytes, 1, 15) : part.bytes;
        append(bytes, big_endian(static_cast<std::uint32_t>(content.size())));
        bytes += part.name + content;
        append(bytes, big_endian(checksum(part.name + content)));
    }
    return bytes;
}

/// SPZ of version 4: 32 bytes of header with the table's place at byte 16, extensions, the table, the frames.
std::optional<Container> spz4_parts(std::string_view bytes) {
    if (bytes.size() < 32) return std::nullopt;
    const std::size_t table = number_at<std::uint32_t>(bytes, 16), count = number_at<std::uint8_t>(bytes, 15);
    if (table < 32 || table > bytes.size() || (bytes.size() - table) / 16 < count) return std::nullopt;
    Container container{Container::Kind::spz4, {{"header", std::string(bytes.substr(0, table))}}};
    std::size_t begin = table + 16 * count;
    for (std::size_t k = 0; k < count; ++k) {
        const auto size = number_at<std::uint64_t>(bytes, table + 16 * k);
        if (size > bytes.size() - begin) return std::nullopt;
        auto stream = decompressed(bytes.substr(begin, size));
        if (!stream) return std::nullopt;
        container.parts.push_back({"stream", std::move(*stream)});
        begin += size;
    }
    return container;
}

std::string spz4_of(const Container& container) {
    std::string bytes = container.parts[0].bytes, frames;
    bytes.resize(std::max<std::size_t>(bytes.size(), 32));
    const auto table = static_cast<std::uint32_t>(bytes.size());
    std::memcpy(bytes.data() + 16, &table, 4);
    bytes[15] = static_cast<char>(container.parts.size() - 1);
    for (std::size_t k = 1; k < container.parts.size(); ++k) {
        const std::string frame = zstd_compressed(container.parts[k].bytes, 1);
        append<std::uint64_t>(bytes, frame.size()), append<std::uint64_t>(bytes, container.parts[k].bytes.size());
        frames += frame;
    }
    return bytes + frames;
}

std::optional<Container> glb_parts(std::string_view bytes) {
    Container container{Container::Kind::glb, {}};
    for (std::size_t at = 12; at + 8 <= bytes.size() && container.parts.size() < most_parts;) {
        const std::size_t size = number_at<std::uint32_t>(bytes, at);
        if (size > bytes.size() - at - 8) return std::nullopt;
        container.parts.push_back({std::string(bytes.substr(at + 4, 4)), std::string(bytes.substr(at + 8, size))});
        at += 8 + size;
    }
    if (container.parts.empty()) return std::nullopt;
    return container;
}

std::string glb_of(const Container& container) {
    std::string chunks;
    for (const Container::Part& part : container.parts) {
        const std::size_t padding = (4 - part.bytes.size() % 4) % 4;
        append(chunks, static_cast<std::uint32_t>(part.bytes.size() + padding));
        chunks += part.name + part.bytes + std::string(padding, part.name == "JSON" ? ' ' : '\0');
    }
    std::string bytes = "glTF";
    append<std::uint32_t>(bytes, 2), append(bytes, static_cast<std::uint32_t>(12 + chunks.size()));
    return bytes + chunks;
}

} // namespace

std::optional<Container> take_apart(std::string_view bytes) {
    const auto one = [](Container::Kind kind, std::optional<std::string> content) -> std::optional<Container> {
        if (!content) return std::nullopt;
        return Container{kind, {{"", std::move(*content)}}};
    };
    if (bytes.starts_with("PK\x03\x04")) return zip_parts(bytes);
    if (bytes.starts_with(png_signature)) return png_parts(bytes);
    if (bytes.starts_with("\x1f\x8b")) return one(Container::Kind::gzip, inflated(bytes, 15 + 16));
    if (bytes.starts_with("\x28\xb5\x2f\xfd")) return one(Container::Kind::zstd, decompressed(bytes));
    if (bytes.starts_with("NGSP")) return spz4_parts(bytes);
    if (bytes.starts_with("glTF")) return glb_parts(bytes);
    return std::nullopt;
}

std::string put_together(const Container& container) {
    switch (container.kind) {
    case Container::Kind::zip:
        return zip_of(container);
    case Container::Kind::png:
        return png_of(container);
    case Container::Kind::gzip:
        return gzip(container.parts.at(0).bytes, 1);
    case Container::Kind::zstd:
        return zstd_compressed(container.parts.at(0).bytes, 1);
    case Container::Kind::spz4:
        return spz4_of(container);
    case Container::Kind::glb:
        return glb_of(container);
    }
    return {};
}

} // namespace gsh::fuzz
