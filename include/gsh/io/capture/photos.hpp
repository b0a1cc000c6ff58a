// SPDX-License-Identifier: Apache-2.0
/// @file  The photographs of a capture as training takes them.
#pragma once

#include <gsh/core/span.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/photo/photo.hpp>

#include <cstdint>
#include <cstdio>
#include <vector>

namespace gsh {

/// All photographs for training, or for evaluation if `test`, named CAMERA_FRAME; cameras are numbered as in the
/// capture. The pixels stay the capture's, which must outlive the result.
[[nodiscard]] inline std::vector<Photo> photos_of(const Capture& capture, bool test) {
    std::vector<Photo> photos;
    for (const CaptureView& view : capture.views(test)) {
        const NamedCamera& camera = capture.cameras[view.camera];
        char frame[16];
        std::snprintf(frame, sizeof frame, "%04zu", view.frame);
        const PixelImage* plate = capture.background(view.camera);
        photos.push_back({camera.name + "_" + frame, camera.camera, view.frame, capture.image(view).data, view.camera,
                          plate ? Span<const std::uint8_t>(plate->data) : Span<const std::uint8_t>(),
                          capture.hidden_in(view)});
    }
    return photos;
}

} // namespace gsh
