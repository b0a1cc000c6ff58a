// SPDX-License-Identifier: Apache-2.0
/// @file  Reads fits of SMPLify-X, and of HAHA in its layout, exported from pickles to one .npz.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/motion/amass_file.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>
#include <gsh/io/motion/up_warning.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh {

/// A motion in the frame of the camera that it was fitted to, and the file's data about that camera.
struct SmplifyxFits {
    Motion motion;                                        ///< in the camera's frame: R = 1, t = 0
    std::vector<int> frame_ids;                           ///< [T] image of each row; empty: in order
    std::optional<std::array<double, 2>> focal_length;    ///< pixels
    std::optional<std::array<double, 2>> principal_point; ///< pixels; if not set, the centre of the image
    std::optional<std::array<double, 4>> ndc;             ///< HAHA's camera_matrix: [0, 0], [1, 1], [0, 2], [1, 2]

    [[nodiscard]] bool has_camera() const { return ndc || focal_length; }
    /// The camera of the fits for images of this size; requires has_camera().
    [[nodiscard]] Camera<double> camera(int width, int height) const {
        Camera<double> camera;
        camera.width = width, camera.height = height;
        const double w = width, h = height;
        if (ndc) {
            camera.fx = (*ndc)[0] * w / 2, camera.fy = (*ndc)[1] * h / 2;
            camera.cx = (1 + (*ndc)[2]) * w / 2, camera.cy = (1 + (*ndc)[3]) * h / 2;
        } else {
            const auto focal = focal_length.value_or(std::array<double, 2>{0, 0});
            const auto point = principal_point.value_or(std::array<double, 2>{w / 2, h / 2});
            camera.fx = focal[0], camera.fy = focal[1], camera.cx = point[0], camera.cy = point[1];
        }
        check_camera("SmplifyxFits", "camera", camera);
        return camera;
    }
};

/// Reads the arrays of the pickles results/ID/000.pkl, stacked in the order of the images: global_orient [T, 3],
/// body_pose [T, 63], betas, and optionally jaw_pose, leye_pose, reye_pose, left_hand_pose and right_hand_pose (45, or
/// principal components), expression, transl. The camera's pose is camera_rotation [T, 3, 3] with
/// camera_translation [T, 3], or camera_transform [T, 4, 4]. Its intrinsics are focal_length (SMPLify-X's default is
/// 5000) and camera_center (the principal point), or camera_matrix [T, 4, 4]. frame_ids is [T]. Axes of length 1 are
/// ignored.
///
/// The camera's pose is applied to the motion, so that one camera at the origin sees all frames. Shapes that vary over
/// the frames are averaged. Hand poses are relative to the mean hand unless flat_hand or options specify otherwise.
///
/// Errors  those of load_motion; also for a body_pose of 32 numbers (VPoser's latent code instead of a pose) and for
///         intrinsics that vary.
[[nodiscard]] inline SmplifyxFits load_smplifyx_fits(const InputFile& input, const BodyModel& model,
                                                     const MotionFileOptions& options = {},
                                                     std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The `count` numbers that a member [*, count], [count] or, for pairs, [*] or () repeats identically in all frames.
inline std::vector<double> constant_member(const NpzReader& file, const char* key, std::size_t count) {
    const auto array = file.read<double>(key, Numbers::any);
    const std::size_t width = array.size() > 0 && array.size() % count == 0 ? count : 0;
    if (width == 0)
        throw ShapeError(file.name_of(key) + " has shape " + shape_text(array.shape) + ", expected " +
                         std::to_string(count) + " numbers, or rows of them");
    for (std::size_t i = count; i < array.size(); ++i)
        check_value(std::abs(array[i] - array[i % count]) <= 1e-4 * (1 + std::abs(array[i])), file.name_of(key),
                    "changes from frame to frame, expected one camera; a zoom cannot be read");
    return {array.data.begin(), array.data.begin() + static_cast<std::ptrdiff_t>(count)};
}

} // namespace detail

inline SmplifyxFits load_smplifyx_fits(const InputFile& input, const BodyModel& model, const MotionFileOptions& options,
                                       std::vector<std::string>* warnings) {
    const NpzReader file(input);
    MotionTable table(input.path());
    detail::TableOfNpz members(file, table);
    if (!members.take("global_orient", "global_orient", 3))
        throw IoError(file.name_of("global_orient") + " is missing");
    const std::size_t T = members.frames();
    if (!members.take("body_pose", "body_pose")) throw IoError(file.name_of("body_pose") + " is missing");
    if (const std::size_t width = table.header("body_pose").shape[1]; width == 32)
        throw ShapeError(file.name_of("body_pose") +
                         " has 32 numbers a frame, which is VPoser's code, expected 63; decode it when exporting");
    for (const char* key : {"jaw_pose", "leye_pose", "reye_pose"}) members.take(key, key, 3);
    for (const char* key : {"left_hand_pose", "right_hand_pose", "expression"}) members.take(key, key);
    if (!members.take("transl", "transl", 3)) table.add("transl", "transl", std::vector<double>(3 * T, 0.0), {T, 3});
    if (file.has_array("betas")) {
        auto betas = file.read<double>("betas");
        if (betas.size() > 0 && betas.size() % T == 0 && betas.shape.size() > 1 && betas.dim(0) == T) {
            const std::size_t S = betas.size() / T;
            std::vector<double> mean(S, 0.0);
            for (std::size_t i = 0; i < betas.size(); ++i) mean[i % S] += betas[i] / static_cast<double>(T);
            betas = {{S}, std::move(mean)};
        }
        table.add("betas", "betas", std::move(betas));
    } else {
        detail::add_mean_shape(table, warnings);
    }
    for (const char* key : {"flat_hand", "flat_hand_mean"})
        if (file.has_array(key))
            table.add("flat_hand", key, std::vector<double>{static_cast<double>(file.read_number<int>(key))}, {});

    copy_stated_time(file, table);

    SmplifyxFits fits;
    MotionFileOptions as_stored = options;
    as_stored.world = MotionFileOptions::World::as_stored;
    fits.motion = detail::MotionReader<MotionTable>(std::move(table), model, as_stored, warnings).read();

    // Apply the camera's pose to the motion.
    std::vector<double> rotation, translation;
    std::size_t stride = 3;
    const auto read_rows = [&](const char* key, std::size_t width) {
        auto array = file.read<double>(key);
        if (array.size() != T * width)
            throw ShapeError(file.name_of(key) + " has shape " + detail::shape_text(array.shape) + ", expected (" +
                             std::to_string(T) + ", " + std::to_string(width) + ")");
        return array.data;
    };
    if (file.has_array("camera_transform")) {
        stride = 4;
        rotation = read_rows("camera_transform", 16);
    } else {
        if (file.has_array("camera_rotation")) rotation = read_rows("camera_rotation", 9);
        if (file.has_array("camera_translation")) translation = read_rows("camera_translation", 3);
    }
    for (std::size_t t = 0; t < T && !(rotation.empty() && translation.empty()); ++t) {
        Affine<double> camera_from_world;
        for (int row = 0; row < 3; ++row) {
            for (int column = 0; column < 3 && !rotation.empty(); ++column)
                camera_from_world.linear[column][row] =
                    rotation[t * stride * stride + static_cast<std::size_t>(row) * stride +
                             static_cast<std::size_t>(column)];
            if (stride == 4)
                camera_from_world.translation[row] = rotation[t * 16 + static_cast<std::size_t>(row) * 4 + 3];
            else if (!translation.empty())
                camera_from_world.translation[row] = translation[t * 3 + static_cast<std::size_t>(row)];
        }
        try {
            move_frame(model, fits.motion, t, camera_from_world);
        } catch (const ValueError& error) {
            throw ValueError(file.name_of(stride == 4 ? "camera_transform" : "camera_rotation") + "[" +
                             std::to_string(t) + "]: " + error.what());
        }
    }
    detail::turn_upright(model, fits.motion, options, input.name(), warnings);
    validate(fits.motion, model, input.name());

    if (file.has_array("camera_matrix")) {
        const std::vector<double> m = detail::constant_member(file, "camera_matrix", 16);
        check_value(m[0] > 0 && m[5] > 0, file.name_of("camera_matrix"),
                    "must hold positive focal lengths at [0, 0] and [1, 1]");
        fits.ndc = {m[0], m[5], m[2], m[6]};
    } else if (file.has_array("focal_length")) {
        const bool pairs = file.header("focal_length").shape.size() == 2 && file.header("focal_length").shape[1] == 2;
        const std::vector<double> f = detail::constant_member(file, "focal_length", pairs ? 2 : 1);
        check_value(f[0] > 0 && f.back() > 0, file.name_of("focal_length"), "must be pixels above 0");
        fits.focal_length = {f[0], f.back()};
        if (file.has_array("camera_center")) {
            const std::vector<double> c = detail::constant_member(file, "camera_center", 2);
            fits.principal_point = {c[0], c[1]};
        }
    }
    if (file.has_array("frame_ids")) {
        fits.frame_ids = file.read<int>("frame_ids").data;
        check_size(input.name(), "frame_ids", fits.frame_ids.size(), T, "one per row");
    }
    return fits;
}

} // namespace gsh
