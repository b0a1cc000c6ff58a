// SPDX-License-Identifier: Apache-2.0
/// @file  Two small cameras in front of the origin, cam00 and cam01.
#pragma once

#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture/named_camera.hpp>

#include <vector>

namespace gsh::test {

inline std::vector<NamedCamera> sample_cameras(int width = 24, int height = 16) {
    std::vector<NamedCamera> list(2);
    for (std::size_t c = 0; c < 2; ++c) {
        list[c].name = c ? "cam01" : "cam00";
        list[c].camera = look_at<double>({c ? 3.0 : 0.0, 0, 3}, {0, 0, 0}, {0, 1, 0}, 0.7, width, height);
    }
    return list;
}

} // namespace gsh::test
