// SPDX-License-Identifier: Apache-2.0
/// @file  Picture grids of gsh-evaluate: one row per configuration with render, error, and crops of face and hands.
#pragma once

#include <gsh/image/image.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/photo/photo.hpp>
#include <gsh/reconstruct/input.hpp>

#include <cstddef>
#include <string>
#include <vector>

namespace gsh::programs {

/// A square of an image that a row shows enlarged: each pixel becomes zoom x zoom pixels.
struct Crop {
    int x = 0, y = 0, side = 0, zoom = 1;
};

/// A test view that is shown in pictures, and the positions of faces and hands in it.
struct ShownView {
    std::string name;
    std::size_t photo = 0; ///< index of the test photograph
    int width = 0, height = 0;
    std::vector<Crop> crops; ///< of each person: those of face, left hand, right hand that the body has, hidden or not
};

/// Up to `most` of the test views, evenly spaced. Each has the crops of all people, one person after the other.
[[nodiscard]] std::vector<ShownView> shown_views(const ReconstructionInput& input, const std::vector<Photo>& photos,
                                                 std::size_t most);

/// A row: the image, five times its error (white if no truth is given), crops of face and hands.
[[nodiscard]] PixelImage row_picture(const ShownView& view, const Image<float>& image, const Image<float>* truth);

/// A photograph composited over its background: the camera's plate, or white.
[[nodiscard]] Image<float> truth_image(const Photo& photo);

/// Stacks rows from top to bottom. Rows whose size differs from the first one's are left out.
[[nodiscard]] PixelImage stacked(const std::vector<PixelImage>& rows);

} // namespace gsh::programs
