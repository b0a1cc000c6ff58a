// SPDX-License-Identifier: Apache-2.0
/// @file  Pictures as bytes of JPEG files, quickly.
#pragma once

#include <gsh/backend/threads.hpp>
#include <gsh/image/image.hpp>
#include <gsh/io/image/image_file.hpp>

#include <string>

namespace gsh::programs {

/// As quantise (io/image/image_file.hpp), on all threads.
[[nodiscard]] PixelImage quantise_on(cpu::Threads& backend, const Image<float>& image);

/// The bytes of a JPEG file.
///
/// Shapes  three channels; quality 1 to 100, with full colour resolution from 90 on.
/// Errors  IoError if libjpeg-turbo refuses.
[[nodiscard]] std::string encode_jpeg(const PixelImage& image, int quality);

} // namespace gsh::programs
