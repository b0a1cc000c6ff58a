// SPDX-License-Identifier: Apache-2.0
/// @file  Keypoints that a detector found in photographs.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/joint_names.hpp>
#include <gsh/math/vec.hpp>

#include <cstddef>
#include <string_view>
#include <vector>

namespace gsh {

/// A landmark as a detector sees it.
struct Keypoint {
    int landmark = -1;     ///< its number (landmarks.hpp)
    vec2<double> pixel{0}; ///< the first pixel's centre is (0.5, 0.5)
    double confidence = 0; ///< in [0, 1]
};

/// A landmark's place in metres as a detector guesses it from one photograph: axes of the camera, origin between the
/// hips.
struct MetricPoint {
    int landmark = -1;
    vec3<double> position{0};
};

/// A person whom a detector found.
struct Detection {
    std::vector<Keypoint> points;
    std::vector<MetricPoint> metric; ///< empty if the detector does not guess
};

/// What a detector found in one photograph: its people, in no order.
struct PhotoKeypoints {
    std::size_t camera = 0, frame = 0;
    std::vector<Detection> people;
};

/// The joint of each of smplx_joint_names in a body, or -1.
[[nodiscard]] inline std::vector<int> joints_by_name(const BodyModel& body) {
    const std::vector<std::string> names = joint_names_of(body);
    std::vector<int> joints;
    for (const std::string_view name : smplx_joint_names) {
        int found = -1;
        for (std::size_t j = 0; j < names.size(); ++j)
            if (names[j] == name) found = static_cast<int>(j);
        joints.push_back(found);
    }
    return joints;
}

} // namespace gsh
