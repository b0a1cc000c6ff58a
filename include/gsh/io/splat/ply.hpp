// SPDX-License-Identifier: Apache-2.0
/// @file  Reads and writes Gaussians as PLY files in the layout of the reference code of 3D Gaussian splatting.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/gaussian/gaussians.hpp>
#include <gsh/io/file/atomic_file.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads x y z, f_dc_0..2, f_rest_*, opacity (logit), scale_0..2 (log), rot_0..3 (w, x, y, z) by name, in any order and
/// of any number type; other properties are ignored. Binary little-endian or ASCII.
///
/// f_rest holds 0, 9, 24, 45 or 72 numbers (degrees 0 to 4), channel by channel: all of red, then green, then blue.
///
/// Errors  IoError for a file that is missing, truncated, not PLY, or lacks a property; ShapeError for another number
///         of f_rest; ValueError for NaN, infinities, numbers beyond float and a quaternion of length 0.
/// Source  Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023, the files of their code.
[[nodiscard]] inline GaussianCloud<float> read_gaussian_ply(const std::filesystem::path& path);

/// Writes x y z nx ny nz f_dc f_rest opacity scale rot as floats, atomically. SH bands up to `pad_to_degree` that the
/// cloud lacks are written as zero, because many viewers support only degree 3. Normals are zero.
inline void write_gaussian_ply(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                               int pad_to_degree = 3);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// One number of each vertex: its type and its position in a row.
struct PlyProperty {
    std::string name;
    char kind = 'f';        // as in NumPy: f, i, u
    std::size_t width = 4;  // bytes
    std::size_t offset = 0; // bytes from the row's start; in ASCII files the column
};

struct PlyHeader {
    bool ascii = false;
    std::uint64_t vertex_count = 0;
    std::size_t row_size = 0; // bytes; in ASCII files columns
    std::size_t data_begin = 0;
    std::vector<PlyProperty> properties;
};

class PlyFile {
public:
    explicit PlyFile(const std::filesystem::path& path) : name_(path.string()), file_(std::fopen(path.c_str(), "rbe")) {
        std::error_code error;
        size_ = file_ ? std::filesystem::file_size(path, error) : 0;
        if (!file_ || error)
            throw IoError(name_ + ": cannot be opened: " +
                          (error ? error : std::error_code(errno, std::generic_category())).message());
        read_header();
    }

    [[nodiscard]] const PlyHeader& header() const { return header_; }
    [[nodiscard]] const std::string& name() const { return name_; }

    [[nodiscard]] const PlyProperty* find(std::string_view property) const {
        for (const auto& candidate : header_.properties)
            if (candidate.name == property) return &candidate;
        return nullptr;
    }

    /// Calls visit(vertex, values) for each vertex, with the values in the order of `wanted`.
    template <class Visit>
    void read_rows(const std::vector<PlyProperty>& wanted, const Visit& visit) {
        std::vector<float> values(wanted.size());
        std::vector<double> columns(header_.ascii ? header_.row_size : 0);
        constexpr std::size_t block = 1 << 12; // rows
        std::vector<char> rows(header_.ascii ? 0
                                             : std::min<std::size_t>(block, header_.vertex_count) * header_.row_size);
        for (std::size_t begin = 0; begin < header_.vertex_count; begin += block) {
            const std::size_t count = std::min<std::size_t>(block, header_.vertex_count - begin);
            if (!header_.ascii && std::fread(rows.data(), header_.row_size, count, file_.get()) != count)
                fail("is truncated");
            for (std::size_t i = 0; i < count; ++i) {
                if (header_.ascii) read_columns(begin + i, columns);
                for (std::size_t k = 0; k < wanted.size(); ++k) {
                    const double value = header_.ascii ? columns[wanted[k].offset]
                                                       : number_at(&rows[i * header_.row_size], wanted[k]);
                    values[k] = static_cast<float>(value);
                    if (!std::isfinite(values[k]))
                        throw ValueError(name_ + ": " + wanted[k].name + " of vertex " + std::to_string(begin + i) +
                                         " is " + std::to_string(value) + ", expected a finite number");
                }
                visit(begin + i, values);
            }
        }
    }

private:
    struct Close {
        void operator()(std::FILE* file) const { std::fclose(file); }
    };
    std::string name_;
    std::unique_ptr<std::FILE, Close> file_;
    std::uintmax_t size_ = 0;
    PlyHeader header_;

    [[noreturn]] void fail(const std::string& reason) const { throw IoError(name_ + ": " + reason); }

    /// The words of the next line; empty at the end of the file.
    std::vector<std::string> words() {
        std::string line;
        int c = 0;
        while ((c = std::fgetc(file_.get())) != EOF && c != '\n') {
            line.push_back(static_cast<char>(c));
            if (line.size() > 4096) fail("is not a PLY file: a header line is longer than 4096 characters");
        }
        std::vector<std::string> result;
        for (std::size_t begin = 0; (begin = line.find_first_not_of(" \t\r", begin)) != std::string::npos;) {
            const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
            result.push_back(line.substr(begin, end - begin));
            begin = end;
        }
        if (c == EOF && result.empty()) fail("is truncated: the header has no end_header");
        return result;
    }

    void read_header() {
        char magic[4] = {};
        if (std::fread(magic, 1, 3, file_.get()) != 3 || std::string_view(magic) != "ply") fail("is not a PLY file");
        std::string element;
        bool has_vertices = false, has_format = false;
        (void)words();
        while (true) {
            const std::vector<std::string> line = words();
            if (line.empty() || line[0] == "comment" || line[0] == "obj_info") continue;
            if (line[0] == "end_header") break;
            if (line[0] == "format" && line.size() >= 2) {
                if (line[1] != "binary_little_endian" && line[1] != "ascii")
                    fail("has format " + line[1] + ", expected binary_little_endian or ascii");
                header_.ascii = line[1] == "ascii";
                has_format = true;
            } else if (line[0] == "element" && line.size() == 3) {
                element = line[1];
                std::uint64_t count = 0;
                const auto [end, code] = std::from_chars(line[2].data(), line[2].data() + line[2].size(), count);
                if (code != std::errc() || end != line[2].data() + line[2].size())
                    fail("element " + element + " has the count " + line[2] + ", expected a number");
                if (element == "vertex") header_.vertex_count = count, has_vertices = true;
                else if (!has_vertices && count > 0)
                    fail("holds " + element + " elements before the vertices, expected vertices first");
            } else if (line[0] == "property") {
                if (element == "vertex") add_property(line);
            } else {
                fail("is not a PLY file: unknown header line '" + line[0] + "'");
            }
        }
        if (!has_format) fail("has no format line");
        if (!has_vertices) fail("has no vertex element");
        header_.data_begin = static_cast<std::size_t>(std::ftell(file_.get()));
        check_count();
    }

    void add_property(const std::vector<std::string>& line) {
        struct Type {
            std::string_view name;
            char kind;
            std::size_t width;
        };
        static constexpr std::array<Type, 16> types{{{"float", 'f', 4},
                                                     {"float32", 'f', 4},
                                                     {"double", 'f', 8},
                                                     {"float64", 'f', 8},
                                                     {"uchar", 'u', 1},
                                                     {"uint8", 'u', 1},
                                                     {"char", 'i', 1},
                                                     {"int8", 'i', 1},
                                                     {"ushort", 'u', 2},
                                                     {"uint16", 'u', 2},
                                                     {"short", 'i', 2},
                                                     {"int16", 'i', 2},
                                                     {"uint", 'u', 4},
                                                     {"uint32", 'u', 4},
                                                     {"int", 'i', 4},
                                                     {"int32", 'i', 4}}};
        const auto type = line.size() == 3 ? std::find_if(types.begin(), types.end(),
                                                          [&](const Type& t) { return t.name == line[1]; })
                                           : types.end();
        if (type == types.end())
            fail("property " + line.back() + " has type " + (line.size() > 1 ? line[1] : "none") +
                 ", expected a plain number type");
        if (find(line[2])) fail("property " + line[2] + " stands there twice");
        if (header_.properties.size() >= 4096) fail("has more than 4096 properties");
        header_.properties.push_back({line[2], type->kind, type->width, header_.row_size});
        header_.row_size += header_.ascii ? 1 : type->width;
    }

    /// Checks before any allocation that the file is large enough for the vertices in its header.
    void check_count() const {
        const std::uintmax_t present = size_ - std::min<std::uintmax_t>(size_, header_.data_begin);
        const std::size_t least = header_.ascii ? 2 * header_.row_size : header_.row_size; // a digit and a blank each
        // The last blank of an ASCII file may be missing.
        if (header_.vertex_count > 0 && (least == 0 || header_.vertex_count > (present + header_.ascii) / least))
            fail("is truncated or its count absurd: " + std::to_string(header_.vertex_count) +
                 " vertices of at least " + std::to_string(least) + " bytes, but " + std::to_string(present) +
                 " bytes follow the header");
    }

    static double number_at(const char* row, const PlyProperty& property) {
        const auto as = [&]<class Number>(Number number) {
            std::memcpy(&number, row + property.offset, sizeof number);
            return static_cast<double>(number);
        };
        if (property.kind == 'f') return property.width == 4 ? as(float()) : as(double());
        if (property.kind == 'u')
            return property.width == 1   ? as(std::uint8_t())
                   : property.width == 2 ? as(std::uint16_t())
                                         : as(std::uint32_t());
        return property.width == 1 ? as(std::int8_t()) : property.width == 2 ? as(std::int16_t()) : as(std::int32_t());
    }

    void read_columns(std::size_t vertex, std::vector<double>& columns) {
        for (double& column : columns)
            if (std::fscanf(file_.get(), "%lf", &column) != 1)
                fail("is truncated or damaged: no number where vertex " + std::to_string(vertex) + " should go on");
    }
};

/// Numbers of f_rest for a degree.
constexpr std::size_t sh_rest_count(int degree) { return 3 * static_cast<std::size_t>(degree * (degree + 2)); }

} // namespace detail

inline GaussianCloud<float> read_gaussian_ply(const std::filesystem::path& path) {
    static_assert(std::endian::native == std::endian::little);
    detail::PlyFile file(path);
    std::size_t rest = 0;
    for (const auto& property : file.header().properties) rest += property.name.starts_with("f_rest_");
    int degree = 0;
    while (degree <= 4 && detail::sh_rest_count(degree) != rest) ++degree;
    if (degree > 4)
        throw ShapeError(file.name() + ": has " + std::to_string(rest) +
                         " f_rest properties, expected 0, 9, 24, 45 or 72");

    std::vector<detail::PlyProperty> wanted;
    std::string missing;
    const auto want = [&](const std::string& name) {
        if (const auto* property = file.find(name)) wanted.push_back(*property);
        else missing += (missing.empty() ? "" : ", ") + name;
    };
    for (const char* name : {"x", "y", "z", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
                             "rot_3", "f_dc_0", "f_dc_1", "f_dc_2"})
        want(name);
    for (std::size_t i = 0; i < rest; ++i) want("f_rest_" + std::to_string(i));
    if (!missing.empty())
        throw IoError(file.name() + ": properties of a Gaussian are missing: " + missing +
                      "; is it a plain point cloud or a compressed file?");

    const auto basis = static_cast<std::size_t>(sh_basis_count(degree));
    GaussianCloud<float> cloud(file.header().vertex_count, degree);
    file.read_rows(wanted, [&](std::size_t i, const std::vector<float>& v) {
        cloud.means[i] = {v[0], v[1], v[2]};
        cloud.opacity_logits[i] = v[3];
        cloud.log_scales[i] = {v[4], v[5], v[6]};
        cloud.quats[i] = {v[7], v[8], v[9], v[10]};
        check_value(dot(cloud.quats[i], cloud.quats[i]) > 0, file.name(),
                    "the quaternion rot_0..3 of vertex " + std::to_string(i) + " is 0, expected a rotation");
        vec3<float>* sh = &cloud.sh[i * basis];
        sh[0] = {v[11], v[12], v[13]};
        for (std::size_t k = 1; k < basis; ++k)
            for (std::size_t channel = 0; channel < 3; ++channel)
                sh[k][static_cast<int>(channel)] = v[14 + channel * (basis - 1) + k - 1];
    });
    return cloud;
}

inline void write_gaussian_ply(const std::filesystem::path& path, const GaussianCloud<float>& cloud,
                               int pad_to_degree) {
    check_gaussians("write_gaussian_ply", "cloud", cloud.view(), cloud.size());
    check_value(pad_to_degree >= 0 && pad_to_degree <= 4, "write_gaussian_ply", "pad_to_degree must be 0 to 4");
    const int degree = std::max(cloud.sh_degree, pad_to_degree);
    const auto basis = static_cast<std::size_t>(sh_basis_count(cloud.sh_degree));
    const auto written = static_cast<std::size_t>(sh_basis_count(degree));

    std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(cloud.size()) + "\n";
    const auto property = [&](const std::string& name) { header += "property float " + name + "\n"; };
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) property(name);
    for (std::size_t i = 0; i < detail::sh_rest_count(degree); ++i) property("f_rest_" + std::to_string(i));
    for (const char* name : {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"})
        property(name);

    AtomicFile file(path);
    file.write(header + "end_header\n");
    std::vector<float> row;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
        row.assign({cloud.means[i].x, cloud.means[i].y, cloud.means[i].z, 0, 0, 0});
        const vec3<float>* sh = &cloud.sh[i * basis];
        row.insert(row.end(), {sh[0].x, sh[0].y, sh[0].z});
        for (int channel = 0; channel < 3; ++channel)
            for (std::size_t k = 1; k < written; ++k) row.push_back(k < basis ? sh[k][channel] : 0.0f);
        const vec3<float>& s = cloud.log_scales[i];
        const quat<float>& q = cloud.quats[i];
        row.insert(row.end(), {cloud.opacity_logits[i], s.x, s.y, s.z, q.w, q.x, q.y, q.z});
        file.write(row.data(), row.size() * sizeof(float));
    }
    file.commit();
}

} // namespace gsh
