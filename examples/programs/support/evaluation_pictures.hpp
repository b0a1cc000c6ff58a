// SPDX-License-Identifier: Apache-2.0
/// @file  Picture grids of gsh-evaluate: a row per configuration with render, error, and crops of face and hands.
#pragma once

#include <gsh/image/image.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/pipeline/photo.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace gsh::examples {

struct Source;

/// A square of an image that a row shows enlarged, each pixel as zoom x zoom.
struct Crop {
    int x = 0, y = 0, side = 0, zoom = 1;
};

/// A test view that pictures are made of, and where its face and hands are.
struct ShownView {
    std::string name;
    std::size_t photo = 0; ///< among the test photographs
    int width = 0, height = 0;
    std::vector<Crop> crops; ///< of each person: face, left hand, right hand, as many as the body has; hidden ones, too
};

/// `most` of the test views, evenly over all of them. Crops are of everybody, one person after the other.
[[nodiscard]] std::vector<ShownView> shown_views(const Source& source, const std::vector<Photo>& photos,
                                                 std::size_t most);

/// A row: the image, five times its error (white where no truth is given), crops of face and hands.
[[nodiscard]] PixelImage row_picture(const ShownView& view, const Image<float>& image,
                                     const Image<float>* truth);

/// A photograph over what is behind it: white, or the camera's plate.
[[nodiscard]] Image<float> truth_image(const Photo& photo);

/// Rows below each other; those of another size than the first are left out.
[[nodiscard]] PixelImage stacked(const std::vector<PixelImage>& rows);

} // namespace gsh::examples
