// SPDX-License-Identifier: Apache-2.0
#include "evaluate/evaluation_pictures.hpp"

#include "reconstruct/load_input.hpp"

#include <gsh/body/posed_body.hpp>
#include <gsh/body/region_mask.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/image/pixel_box.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

namespace gsh::programs {

namespace {

/// The square around a region of a posed body in the image of a camera.
Crop crop_of(const std::vector<vec3<double>>& vertices, const std::vector<int>& region, const Camera<double>& camera) {
    constexpr double near = 1e-3, margin = 1.15;
    constexpr int least = 12, largest_zoom = 4; // pixels; times
    double low[2] = {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()},
           high[2] = {-low[0], -low[1]};
    for (const int v : region) {
        const vec3<double> p = to_camera(camera, vertices[static_cast<std::size_t>(v)]);
        if (!(p.z > near)) continue;
        const vec2<double> pixel = to_pixel(camera, p);
        for (int axis = 0; axis < 2; ++axis)
            low[axis] = std::min(low[axis], pixel[axis]), high[axis] = std::max(high[axis], pixel[axis]);
    }
    const int sizes[2] = {camera.width, camera.height}, most = std::min(camera.width, camera.height);
    if (!(low[0] <= high[0])) low[0] = high[0] = 0.5 * sizes[0], low[1] = high[1] = 0.5 * sizes[1]; // behind the camera
    const double wished = margin * std::max(high[0] - low[0], high[1] - low[1]);
    Crop crop;
    crop.side =
        std::min(most, std::max(least, static_cast<int>(std::ceil(std::min(wished, static_cast<double>(most))))));
    crop.zoom = std::clamp(camera.height / crop.side, 1, largest_zoom);
    int* corner[2] = {&crop.x, &crop.y};
    for (int axis = 0; axis < 2; ++axis) {
        const double middle = std::clamp(0.5 * (low[axis] + high[axis]), 0.0, static_cast<double>(sizes[axis]));
        *corner[axis] = std::clamp(static_cast<int>(std::lround(middle - 0.5 * crop.side)), 0, sizes[axis] - crop.side);
    }
    return crop;
}

/// Copies a square of an image, enlarged, or a whole image into a picture.
void paste(const PixelImage& from, const Crop& part, PixelImage& to, int x0, int y0) {
    for (int y = 0; y < part.side * part.zoom; ++y)
        for (int x = 0; x < part.side * part.zoom; ++x)
            std::copy_n(from.pixel(part.y + y / part.zoom, part.x + x / part.zoom), 3, to.pixel(y0 + y, x0 + x));
}

void paste(const PixelImage& from, PixelImage& to, int x0, int y0) {
    for (int y = 0; y < from.height; ++y)
        for (int x = 0; x < from.width; ++x) std::copy_n(from.pixel(y, x), 3, to.pixel(y0 + y, x0 + x));
}

constexpr int picture_gap = 4; // pixels between parts of a picture

} // namespace

std::vector<ShownView> shown_views(const ReconstructionInput& input, const std::vector<Photo>& photos,
                                   std::size_t most) {
    std::vector<BodyRegions> regions;
    for (std::size_t p = 0; p < input.people.size(); ++p) regions.push_back(input.body_regions_of(p));
    std::vector<ShownView> views;
    const std::size_t count = std::min(most, photos.size());
    for (std::size_t i = 0; i < count; ++i) {
        const Photo& photo = photos[i * photos.size() / count];
        ShownView view{photo.name, i * photos.size() / count, photo.camera.width, photo.camera.height, {}};
        for (std::size_t p = 0; p < regions.size(); ++p) {
            const PosedBody posed = input.posed(p, photo.frame);
            for (const auto* region : {&regions[p].face, &regions[p].left_hand, &regions[p].right_hand})
                if (!region->empty()) view.crops.push_back(crop_of(posed.vertices, *region, photo.camera));
        }
        views.push_back(std::move(view));
    }
    return views;
}

PixelImage row_picture(const ShownView& view, const Image<float>& image, const Image<float>* truth) {
    constexpr float gain = 5;
    constexpr int gap = picture_gap;
    int width = 2 * view.width + gap, height = view.height;
    for (const Crop& crop : view.crops) width += gap + crop.side * crop.zoom;
    PixelImage row(3, height, width);
    std::fill(row.data.begin(), row.data.end(), std::uint8_t(255));
    const PixelImage pixels = quantise(image.view());
    paste(pixels, row, 0, 0);
    if (truth) {
        Image<float> error(3, image.height, image.width);
        for (std::size_t i = 0; i < error.data.size(); ++i)
            error.data[i] = std::min(1.0f, gain * std::abs(image.data[i] - truth->data[i]));
        paste(quantise(std::as_const(error).view()), row, view.width + gap, 0);
    }
    int x = 2 * view.width + gap;
    for (const Crop& crop : view.crops) {
        paste(pixels, crop, row, x + gap, 0);
        x += gap + crop.side * crop.zoom;
    }
    return row;
}

Image<float> truth_image(const Photo& any_photo) {
    const HeldPhoto held(any_photo);
    const Photo& photo = *held;
    Image<float> image(3, photo.camera.height, photo.camera.width);
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x) {
            const std::size_t at = 4 * whole_picture(image.height, image.width).index(x, y);
            const std::uint8_t* pixel = photo.pixel(x, y);
            const float alpha = static_cast<float>(pixel[3]) / 255;
            for (std::size_t c = 0; c < 3; ++c) {
                const float behind = photo.plate.empty() ? 1.0f : static_cast<float>(photo.plate[at + c]) / 255;
                image.at(static_cast<int>(c), y, x) = alpha * static_cast<float>(pixel[c]) / 255 + (1 - alpha) * behind;
            }
        }
    return image;
}

PixelImage stacked(const std::vector<PixelImage>& rows) {
    constexpr int gap = picture_gap;
    const int height = rows.front().height, width = rows.front().width;
    std::vector<const PixelImage*> fitting;
    for (const PixelImage& row : rows)
        if (row.height == height && row.width == width) fitting.push_back(&row);
    PixelImage grid(3, static_cast<int>(fitting.size()) * (height + gap) - gap, width);
    std::fill(grid.data.begin(), grid.data.end(), std::uint8_t(255));
    for (std::size_t r = 0; r < fitting.size(); ++r) paste(*fitting[r], grid, 0, static_cast<int>(r) * (height + gap));
    return grid;
}

} // namespace gsh::programs
