// SPDX-License-Identifier: Apache-2.0
/// @file  Reads depth maps of other programs, .npy, as maps of prior views.
#pragma once

#include <gsh/core/error.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npy.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/prior/prior_view.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

namespace gsh {

/// Reads an array (height, width) of real numbers: camera z in metres, and a mask of the valid pixels. NaN and 0 are
/// invalid, and so are points behind the camera unless `behind_counts`, as it does for an orthographic camera.
///
/// Errors  those of read_npy; ValueError for a file without the extension .npy; ShapeError for another shape.
[[nodiscard]] inline PriorMap read_depth_map(const InputFile& input, bool behind_counts) {
    const std::string name = input.name();
    check_value(input.ending() == ".npy", name, "is no .npy file, as depths are: camera z in metres");
    const NpyHeader header = detail::npy_header_of(input);
    if (header.shape.size() != 2)
        throw ShapeError(name + " has shape " + detail::shape_text(header.shape) + ", expected (height, width)");
    detail::check_pixel_count(name, static_cast<std::int64_t>(header.shape[1]),
                              static_cast<std::int64_t>(header.shape[0]));
    const int height = static_cast<int>(header.shape[0]), width = static_cast<int>(header.shape[1]);
    PriorMap map{Image<double>(1, height, width), Image<std::uint8_t>(1, height, width)};
    const auto fill = [&]<class T>(T, Numbers numbers) {
        const auto array = read_npy<T>(input, numbers);
        for (std::size_t i = 0; i < array.size(); ++i) {
            const auto depth = static_cast<double>(array[i]);
            if (!std::isfinite(depth) || depth == 0 || (depth < 0 && !behind_counts)) continue;
            map.values.data[i] = depth;
            map.mask.data[i] = 1;
        }
    };
    if (header.is_real() && header.width == 8)
        fill(double(), Numbers::exact);
    else
        fill(float(), header.is_real() && header.width == 4 ? Numbers::exact : Numbers::same_kind);
    return map;
}

} // namespace gsh
