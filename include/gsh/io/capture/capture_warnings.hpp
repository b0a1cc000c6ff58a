// SPDX-License-Identifier: Apache-2.0
/// @file  Warnings about a capture whose cameras, poses and masks probably do not belong together.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture/capture_data.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>
#include <gsh/math/vec.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace gsh {

/// Projects the body's posed joints into the images and warns about cameras that do not see them or see them far too
/// small, masks that are full outside the body or do not cover it, and images without alpha.
[[nodiscard]] inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body);
/// The same for another person in the capture, whose motion covers the same frames.
[[nodiscard]] inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body,
                                                               const Motion& motion);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Joint positions in the world, and points along the bones to their parents; all lie inside the body.
inline std::vector<vec3<double>> bone_points(const BodyModel& body, const Motion& motion, std::size_t frame) {
    const auto joints = regress_joints(body, shaped_vertices(body, motion.betas, motion.expression_at(frame)));
    std::vector<mat3<double>> rotations;
    for (const auto& v : motion.pose_at(frame)) rotations.push_back(rotation_from_axis_angle(v));
    std::vector<Affine<double>> bones(joints.size());
    bone_transforms<double>(body.parents, rotations, joints, motion.transl[frame], bones);
    std::vector<vec3<double>> points;
    for (std::size_t j = 0; j < joints.size(); ++j) {
        const vec3<double> joint = bones[j](joints[j]);
        points.push_back(joint);
        if (body.parents[j] < 0) continue;
        const auto parent = static_cast<std::size_t>(body.parents[j]);
        const vec3<double> other = bones[parent](joints[parent]);
        for (const double s : {0.25, 0.5, 0.75}) points.push_back(other + (joint - other) * s);
    }
    return points;
}

/// Statistics of one image with respect to body, camera and mask.
struct MaskStatistics {
    double inside = 0;  ///< fraction of body points that project into the image
    double extent = 0;  ///< of the body points, pixels
    double on_body = 0; ///< mean alpha at the body points
    double border = 0;  ///< mean alpha along the image's border
    bool opaque = true; ///< no pixel is transparent
};

inline MaskStatistics mask_statistics(const Camera<double>& camera, const PixelImage& image,
                                      const std::vector<vec3<double>>& points) {
    MaskStatistics result;
    vec2<double> low(1e300), high(-1e300);
    double seen = 0;
    for (const auto& point : points) {
        const vec3<double> p = to_camera(camera, point);
        if (!(p.z > 1e-6)) continue;
        const vec2<double> pixel = to_pixel(camera, p);
        low = {std::min(low.x, pixel.x), std::min(low.y, pixel.y)};
        high = {std::max(high.x, pixel.x), std::max(high.y, pixel.y)};
        if (!(pixel.x >= 0 && pixel.y >= 0 && pixel.x < image.width && pixel.y < image.height)) continue;
        seen += 1;
        result.on_body += image.pixel(static_cast<int>(pixel.y), static_cast<int>(pixel.x))[3] / 255.0;
    }
    result.inside = seen / static_cast<double>(std::max<std::size_t>(1, points.size()));
    result.extent = std::max({0.0, high.x - low.x, high.y - low.y});
    if (seen > 0) result.on_body /= seen;
    double count = 0;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; x += y == 0 || y == image.height - 1 ? 1 : std::max(1, image.width - 1)) {
            result.border += image.pixel(y, x)[3] / 255.0;
            count += 1;
        }
    result.border /= std::max(1.0, count);
    for (std::size_t i = 3; i < image.data.size(); i += 4) result.opaque = result.opaque && image.data[i] == 255;
    return result;
}

} // namespace detail

inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body) {
    return capture_warnings(capture, body, capture.motion);
}
inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body, const Motion& motion) {
    std::vector<std::string> warnings;
    const std::size_t frames = capture.frame_count();
    if (frames == 0) return warnings;
    std::map<std::size_t, std::vector<vec3<double>>> points; // by frame, for the frames that are checked

    const auto percent = [](double share) { return std::to_string(static_cast<int>(100 * share + 0.5)) + "%"; };
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        std::vector<std::size_t> taken;
        for (std::size_t f = 0; f < frames; ++f)
            if (capture.is_taken({c, f})) taken.push_back(f);
        if (taken.empty()) continue;
        const std::array<std::size_t, 3> looked_at{taken.front(), taken[taken.size() / 2], taken.back()};
        detail::MaskStatistics mean;
        for (const std::size_t frame : looked_at) {
            auto& on_bones = points[frame];
            if (on_bones.empty()) on_bones = detail::bone_points(body, motion, frame);
            const auto one =
                detail::mask_statistics(capture.cameras[c].camera, capture.read_image({c, frame}), on_bones);
            const double weight = 1.0 / static_cast<double>(looked_at.size());
            mean.inside += weight * one.inside, mean.extent += weight * one.extent;
            mean.on_body += weight * one.on_body, mean.border += weight * one.border;
            mean.opaque = mean.opaque && one.opaque;
        }
        const std::string camera = "camera '" + detail::shortened(capture.cameras[c].name) + "'";
        if (mean.inside < 0.3)
            warnings.push_back(camera + " is far off the body, " + percent(mean.inside) +
                               " of which projects into its images; R and t must map world to camera (x right, y down, "
                               "z forward) in metres, "
                               "and the poses must belong to these images");
        else if (mean.extent < 0.02 * capture.cameras[c].camera.height)
            warnings.push_back(camera + " sees a body " + std::to_string(static_cast<int>(mean.extent + 0.5)) +
                               " pixels tall; t is probably not in metres");
        else if (mean.opaque && capture.background(c))
            continue; // with a background the whole photograph is opaque
        else if (mean.opaque)
            warnings.push_back(
                camera +
                " has images without a mask: no pixel is transparent; store the person's mask as alpha, or in masks/");
        else if (mean.on_body < 0.4 && mean.border > 0.6)
            warnings.push_back(camera + " has a mask that is probably inverted: alpha is " + percent(mean.on_body) +
                               " on the body and " + percent(mean.border) +
                               " at the image's border; alpha must be 1 on the person");
        else if (mean.on_body < 0.5)
            warnings.push_back(camera + " has masks that do not lie on the posed body (" + percent(mean.on_body) +
                               " of it covered); poses, cameras and images probably do not belong together");
    }
    return warnings;
}

} // namespace gsh
