// SPDX-License-Identifier: Apache-2.0
/// @file  Reads normal maps of other programs, PNG or npy, and converts them to the frame of prior views.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/exif.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/vec.hpp>
#include <gsh/prior/prior_view.hpp>

#include <stb/stb_image.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// The axes of the three channels. An image file stores (component + 1) / 2 of a channel's full range.
enum class NormalEncoding {
    y_up,   ///< x right, y up, z towards the viewer: ICON, ECON, Sapiens, OpenGL; a facing surface is (128, 128, 255)
    y_down, ///< x right, y down, z towards the viewer: "DirectX" maps
    opencv, ///< x right, y down, z away from the viewer, as in our cameras
    x_left, ///< x left, y up, z away from the viewer: PyTorch3D's camera frame
};

/// The side of the body that a map shows.
enum class NormalFacing {
    viewer, ///< the side visible to the camera
    away,   ///< the far side in the front view's pixels and frame, as in ICON and ECON; use the front camera
};

struct NormalMapParams {
    NormalEncoding encoding = NormalEncoding::y_up;
    NormalFacing facing = NormalFacing::viewer;
    double shortest = 0.5, longest = 1.5; ///< lengths of a valid normal; this excludes grey, black and white
    double alpha = 0.5;                   ///< pixels with smaller alpha are invalid
};

/// Reads a normal map: unit normals in the camera's frame (x right, y down, z forward), and a mask of the valid pixels.
///
/// PNG: 8 or 16 bits, RGB or RGBA. npy: (height, width, 3), or 4 with alpha, or (3, height, width). Real numbers are
/// the components themselves, with NaN for invalid pixels; unsigned 8 or 16-bit integers are encoded as in a PNG.
///
/// Errors  IoError for a file that is missing, damaged or of another kind; ShapeError for another shape; ValueError if
///         no normal is valid, if real numbers look like colours in [0, 1], or if most normals face the wrong way.
[[nodiscard]] inline PriorMap read_normal_map(const InputFile& input, const NormalMapParams& params = {});

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Components in [-1, 1] in the file's axes, and alpha in [0, 1], pixel by pixel.
struct RawNormals {
    std::vector<double> values; // [height, width, 4]
    int height = 0, width = 0;

    RawNormals(const std::string& name, std::size_t rows, std::size_t columns) {
        constexpr std::size_t most = std::numeric_limits<int>::max();
        if (rows > most || columns > most) throw ShapeError(name + ": the map is too large");
        check_pixel_count(name, static_cast<std::int64_t>(columns), static_cast<std::int64_t>(rows));
        height = static_cast<int>(rows), width = static_cast<int>(columns);
        values.assign(4 * rows * columns, 1.0);
    }
    /// Sets channel c of every pixel to value(pixel, c) / full. If full > 1, colour channels are mapped to [-1, 1].
    template <class Value>
    void fill(std::size_t channels, double full, const Value& value) {
        for (std::size_t i = 0; i < values.size() / 4; ++i)
            for (std::size_t c = 0; c < channels; ++c) {
                const double v = value(i, c) / full;
                values[4 * i + c] = full > 1 && c < 3 ? 2 * v - 1 : v;
            }
    }
};

inline RawNormals read_normal_png(const InputFile& input) {
    const std::string name = input.name();
    std::string bytes = read_file(input);
    if (!bytes.starts_with(png_signature))
        throw IoError(name + ": is not a PNG image; JPEG damages normals, and EXR is not read (save as .npy)");
    if (exif_orientation(bytes) != 1)
        throw IoError(name + ": its Exif data state that it is to be turned, which would turn its normals, too; store "
                             "the map upright, without this tag");
    bytes = unpacked_png(bytes, name);
    const auto* data = reinterpret_cast<const stbi_uc*>(bytes.data());
    const int size = static_cast<int>(bytes.size());
    const auto refuse = [&] { return IoError(name + ": the image cannot be decoded: " + stbi_failure_reason()); };
    int width = 0, height = 0, channels = 0;
    if (!stbi_info_from_memory(data, size, &width, &height, &channels)) throw refuse();
    if (channels < 3)
        throw ShapeError(name + ": the image is grey, expected 3 channels of a normal (and perhaps alpha)");
    const auto release = [](void* pixels) { stbi_image_free(pixels); };
    RawNormals raw(name, static_cast<std::size_t>(height), static_cast<std::size_t>(width));
    const auto fill = [&](auto* loaded, double full) {
        const std::unique_ptr<void, decltype(release)> pixels(loaded, release);
        if (!loaded) throw refuse();
        raw.fill(4, full, [&](std::size_t i, std::size_t c) { return static_cast<double>(loaded[4 * i + c]); });
    };
    if (stbi_is_16_bit_from_memory(data, size))
        fill(stbi_load_16_from_memory(data, size, &width, &height, &channels, 4), 65535);
    else
        fill(stbi_load_from_memory(data, size, &width, &height, &channels, 4), 255);
    return raw;
}

inline RawNormals read_normal_npy(const InputFile& input) {
    const std::string name = input.name();
    const NpyHeader header = npy_header_of(input);
    const auto& shape = header.shape;
    const bool last = shape.size() == 3 && (shape[2] == 3 || shape[2] == 4), first = shape.size() == 3 && shape[0] == 3;
    if (!last && !first)
        throw ShapeError(name + " has shape " + shape_text(shape) +
                         ", expected (height, width, 3 or 4) or (3, height, width)");
    const std::size_t rows = last ? shape[0] : shape[1], columns = last ? shape[1] : shape[2],
                      channels = last ? shape[2] : 3, pixels = rows * columns;
    RawNormals raw(name, rows, columns);
    const auto fill = [&]<class T>(T, Numbers numbers, double full) {
        const auto array = read_npy<T>(input, numbers);
        raw.fill(channels, full, [&](std::size_t i, std::size_t c) {
            return static_cast<double>(last ? array[channels * i + c] : array[pixels * c + i]);
        });
    };
    if (header.is_real() && header.width == 4)
        fill(float(), Numbers::exact, 1);
    else if (header.is_real() && header.width == 8)
        fill(double(), Numbers::exact, 1);
    else if (header.is_real())
        fill(float(), Numbers::same_kind, 1);
    else if (header.kind == 'u' && header.width == 1)
        fill(std::uint8_t(), Numbers::same_kind, 255);
    else if (header.kind == 'u' && header.width == 2)
        fill(std::uint16_t(), Numbers::same_kind, 65535);
    else
        throw IoError(name + " has dtype " + header.dtype +
                      ", expected real numbers in [-1, 1] or colours (|u1 or <u2)");
    return raw;
}

} // namespace detail

inline PriorMap read_normal_map(const InputFile& input, const NormalMapParams& params) {
    const std::string name = input.name();
    const bool npy = input.ending() == ".npy";
    const detail::RawNormals raw = npy ? detail::read_normal_npy(input) : detail::read_normal_png(input);
    const NormalEncoding encoding = params.encoding;
    const bool up = encoding == NormalEncoding::y_up || encoding == NormalEncoding::x_left;
    const bool forward = encoding == NormalEncoding::opencv || encoding == NormalEncoding::x_left;
    const vec3<double> sign(encoding == NormalEncoding::x_left ? -1 : 1, up ? -1 : 1, forward ? 1 : -1);
    PriorMap map{Image<double>(3, raw.height, raw.width), Image<std::uint8_t>(1, raw.height, raw.width)};
    std::size_t count = 0, to_viewer = 0;
    double least = 1;
    for (std::size_t i = 0; i < map.mask.data.size(); ++i) {
        const double* pixel = &raw.values[4 * i];
        const vec3<double> n(pixel[0], pixel[1], pixel[2]);
        const double size = length(n);
        if (!(pixel[3] >= params.alpha && size >= params.shortest && size <= params.longest)) continue; // also for NaN
        for (int k = 0; k < 3; ++k) {
            map.values.view().row(k, 0)[i] = sign[k] * n[k] / size;
            least = std::fmin(least, n[k]);
        }
        map.mask.data[i] = 1;
        ++count, to_viewer += sign.z * n.z < 0;
    }
    check_value(count > 0, name,
                "no pixel holds a normal: none is opaque with a length of " + detail::number_text(params.shortest) +
                    " to " + detail::number_text(params.longest) + "; is this a normal map?");
    check_value(!npy || least < -1e-6 || count < 100, name,
                "no component is negative, so these are colours in [0, 1]; store 2 c - 1, or unsigned 8-bit integers");
    const std::size_t right_way = params.facing == NormalFacing::viewer ? to_viewer : count - to_viewer;
    check_value(2 * right_way >= count, name,
                std::to_string(count - right_way) + " of " + std::to_string(count) + " normals face " +
                    (params.facing == NormalFacing::viewer
                         ? "away from the viewer; choose another encoding, or facing: away for a back map"
                         : "the viewer, expected a map of the far side; choose facing: viewer"));
    return map;
}

} // namespace gsh
