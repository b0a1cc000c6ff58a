// SPDX-License-Identifier: Apache-2.0
/// @file  Archives and arrays as other programs write them, and invalid ones.
#pragma once

#include <doctest/doctest.h>

#include <zip.h>

#include <deque>
#include <filesystem>
#include <string>

namespace gsh::test {

/// An .npy file with the given header text.
inline std::string npy_bytes_of_header(std::string header, const std::string& data, int version = 1) {
    const std::size_t length_bytes = version == 1 ? 2 : 4;
    header.append(63 - (8 + length_bytes + header.size()) % 64, ' ').push_back('\n');
    std::string bytes("\x93NUMPY", 6);
    bytes.push_back(static_cast<char>(version));
    bytes.push_back(0);
    for (std::size_t i = 0; i < length_bytes; ++i) bytes.push_back(static_cast<char>(header.size() >> 8 * i & 255));
    return bytes + header + data;
}

inline std::string npy_bytes(const std::string& dtype, const std::string& shape, const std::string& data,
                             bool fortran = false, int version = 1) {
    return npy_bytes_of_header("{'descr': '" + dtype + "', 'fortran_order': " + (fortran ? "True" : "False") +
                                   ", 'shape': " + shape + ", }",
                               data, version);
}

/// A zip archive made by libzip, independently of gsh's writer. The destructor writes it.
class ZipFile {
public:
    explicit ZipFile(const std::filesystem::path& path) {
        int error = 0;
        archive_ = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &error);
        REQUIRE(archive_ != nullptr);
    }
    ~ZipFile() { CHECK(zip_close(archive_) == 0); }
    ZipFile(const ZipFile&) = delete;
    ZipFile& operator=(const ZipFile&) = delete;

    void add(const std::string& name, const std::string& content, bool deflate) {
        const std::string& kept = contents_.emplace_back(content); // libzip reads it when the archive is closed
        zip_source_t* source = zip_source_buffer(archive_, kept.data(), kept.size(), 0);
        const zip_int64_t index = zip_file_add(archive_, name.c_str(), source, ZIP_FL_ENC_UTF_8);
        REQUIRE(index >= 0);
        zip_set_file_compression(archive_, static_cast<zip_uint64_t>(index), deflate ? ZIP_CM_DEFLATE : ZIP_CM_STORE,
                                 0);
        zip_file_set_dostime(archive_, static_cast<zip_uint64_t>(index), 0, 0x21, 0); // the same bytes on every day
    }

private:
    zip_t* archive_ = nullptr;
    std::deque<std::string> contents_;
};

} // namespace gsh::test
