// SPDX-License-Identifier: Apache-2.0
/// @file  Captures: a folder of images with masks, cameras and poses.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/camera_file.hpp>
#include <gsh/io/image_file.hpp>
#include <gsh/io/motion_file.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// One image of a capture.
struct CaptureView {
    std::size_t camera = 0, frame = 0;
};

/// A person seen by calibrated cameras, all of it in memory.
///
/// Shapes  images [cameras * frames], RGBA with straight alpha (the mask), straightened; image (c, f) is at
///         c * frame_count() + f. motion holds one pose per frame.
struct Capture {
    std::string name;
    std::vector<NamedCamera> cameras;
    Motion motion;
    std::vector<PixelImage> images;
    std::vector<int> test_frames;  ///< left out of training, in every camera
    double fps = 0;                ///< 0 where nobody said
    std::optional<double> floor_y; ///< metres

    [[nodiscard]] std::size_t frame_count() const { return motion.frame_count(); }
    [[nodiscard]] const PixelImage& image(CaptureView view) const {
        return images[view.camera * frame_count() + view.frame];
    }
    [[nodiscard]] bool is_test(CaptureView view) const {
        return cameras[view.camera].role == NamedCamera::Role::test ||
               std::find(test_frames.begin(), test_frames.end(), static_cast<int>(view.frame)) != test_frames.end();
    }
    /// All views to train on, or (`test`) to judge by: cameras with the role, and frames that are kept for it.
    [[nodiscard]] std::vector<CaptureView> views(bool test) const {
        std::vector<CaptureView> result;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t f = 0; f < frame_count(); ++f)
                if (is_test({c, f}) == test) result.push_back({c, f});
        return result;
    }
};

struct CaptureOptions {
    std::string poses = "poses.npz"; ///< file in the capture's folder, or a path
    MotionFileOptions::Hands hands = MotionFileOptions::Hands::automatic;
};

/// Loads DIR/cameras.json, DIR/poses.npz and the images DIR/images/CAMERA/FRAME.png (or .jpg), in order of their
/// names. The mask is the images' alpha, or DIR/masks/CAMERA/FRAME.png, where white is the person. Images of cameras
/// with distortion are straightened. `body` says what the poses mean.
///
/// Errors    IoError, ShapeError, ValueError naming the file: images, poses and cameras that do not belong together,
///           a mask that is empty everywhere, no view to train on, and all that the single files can be guilty of.
/// Warnings  what is probably wrong, one sentence each with its likely cause; see capture_warnings.
template <CpuBackend B>
[[nodiscard]] Capture load_capture(B& backend, const std::filesystem::path& folder, const BodyModel& body,
                                   const CaptureOptions& options = {}, std::vector<std::string>* warnings = nullptr);

/// Writes the same layout: what a studio made by code hands to programs for real captures. Creates the folder.
inline void save_capture(const std::filesystem::path& folder, const Capture& capture);

/// Looks at the body's posed joints in the images: a camera that does not see them, or sees them absurdly small; masks
/// that are full where the body is not, or do not lie where it is; images without alpha.
[[nodiscard]] inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Image files of a folder in order of their names.
inline std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder) {
    std::error_code error;
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        std::string extension = entry.path().extension().string();
        for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") files.push_back(entry.path());
    }
    if (error) throw IoError(folder.string() + ": cannot be listed: " + error.message() + "; expected a folder of images");
    std::sort(files.begin(), files.end());
    return files;
}

/// The one that is missing in a numbered row of files, or nothing.
inline std::string missing_in_row(const std::vector<std::filesystem::path>& files) {
    long expected = -1;
    for (const auto& file : files) {
        const std::string stem = file.stem().string();
        if (stem.empty() || stem.size() > 9 || stem.find_first_not_of("0123456789") != std::string::npos) return {};
        const long number = std::stol(stem);
        if (expected >= 0 && number > expected) {
            const std::string digits = std::to_string(expected);
            const std::string zeros(stem.size() > digits.size() ? stem.size() - digits.size() : 0, '0');
            return zeros + digits + file.extension().string();
        }
        expected = number + 1;
    }
    return {};
}

/// Images of one camera, one per frame.
inline std::vector<std::filesystem::path> list_frames(const std::filesystem::path& folder, std::size_t frames,
                                                      const std::filesystem::path& poses) {
    const auto files = list_images(folder);
    if (const std::string missing = missing_in_row(files); !missing.empty())
        throw IoError((folder / missing).string() + ": is missing, the files around it are there");
    if (files.size() != frames)
        throw ShapeError(folder.string() + ": holds " + std::to_string(files.size()) + " images, expected " +
                         std::to_string(frames) + ", one per pose of " + poses.string());
    return files;
}

inline void check_image_size(const std::filesystem::path& path, const PixelImage& image, const NamedCamera& camera) {
    if (image.width != camera.camera.width || image.height != camera.camera.height)
        throw ShapeError(path.string() + ": is " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                         " pixels, expected " + std::to_string(camera.camera.width) + " x " +
                         std::to_string(camera.camera.height) + " as camera '" + camera.name + "' says");
}

/// Alpha from a mask's red channel, or from its alpha where it has one.
inline void apply_mask(const PixelImage& mask, PixelImage& image) {
    bool opaque = true;
    for (std::size_t i = 3; i < mask.data.size(); i += 4) opaque = opaque && mask.data[i] == 255;
    for (std::size_t i = 0; i < image.data.size(); i += 4) image.data[i + 3] = mask.data[i + (opaque ? 0 : 3)];
}

inline void check_mask(const std::filesystem::path& path, const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        if (image.data[i] != 0) return;
    throw ValueError(path.string() + ": its mask (alpha) is empty everywhere, expected the person to be somewhere");
}

inline PixelImage straighten(const PixelImage& image, const NamedCamera& camera) {
    PixelImage straight(4, image.height, image.width);
    cpu::Serial serial;
    resample_rgba8<double>(serial, Span<const std::uint8_t>(image.data), image.height, image.width,
                           UndistortMap<double>{camera.camera, camera.camera, *camera.distortion},
                           Span<std::uint8_t>(straight.data), straight.height, straight.width);
    return straight;
}

/// Joints in the world, and points along the bones to their parents: they lie inside the body.
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

/// What one image says about body, camera and mask.
struct MaskStatistics {
    double inside = 0;  ///< share of body points that fall into the image
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

template <CpuBackend B>
Capture load_capture(B& backend, const std::filesystem::path& folder, const BodyModel& body,
                     const CaptureOptions& options, std::vector<std::string>* warnings) {
    if (std::error_code ignored; !std::filesystem::is_directory(folder, ignored))
        throw IoError(folder.string() + ": is not a folder, expected one with cameras.json, poses.npz and images/");
    Capture capture;
    capture.name = std::filesystem::weakly_canonical(folder).filename().string();
    CameraList list = read_cameras(folder / "cameras.json");
    capture.cameras = std::move(list.cameras);
    capture.test_frames = std::move(list.test_frames);
    capture.fps = list.fps;
    capture.floor_y = list.floor_y;

    const std::filesystem::path poses = folder / options.poses; // an absolute path replaces the folder
    capture.motion = load_motion(poses, body, {options.hands, list.fps}, warnings);
    const std::size_t frames = capture.frame_count(), count = capture.cameras.size() * frames;
    for (const int frame : capture.test_frames)
        check_value(static_cast<std::size_t>(frame) < frames, (folder / "cameras.json").string(),
                    "test_frames holds " + std::to_string(frame) + ", expected frames below " + std::to_string(frames));
    check_value(!capture.views(false).empty(), (folder / "cameras.json").string(),
                "no view is left for training; give a camera the role train, and leave frames out of test_frames");

    std::vector<std::filesystem::path> images, masks;
    for (const NamedCamera& camera : capture.cameras) {
        const auto append = [&](const char* kind, std::vector<std::filesystem::path>& files) {
            const auto own = detail::list_frames(folder / kind / camera.name, frames, poses);
            files.insert(files.end(), own.begin(), own.end());
        };
        append("images", images);
        if (std::filesystem::is_directory(folder / "masks")) append("masks", masks);
    }

    // The first image in order that fails is the one that is reported, whichever thread finds it.
    capture.images.resize(count);
    std::vector<std::exception_ptr> failures(count);
    const auto load = [&](std::size_t i) {
        const NamedCamera& camera = capture.cameras[i / frames];
        PixelImage image = read_image(images[i]);
        detail::check_image_size(images[i], image, camera);
        if (!masks.empty()) {
            const PixelImage mask = read_image(masks[i]);
            detail::check_image_size(masks[i], mask, camera);
            detail::apply_mask(mask, image);
        }
        detail::check_mask(masks.empty() ? images[i] : masks[i], image);
        capture.images[i] = camera.distortion ? detail::straighten(image, camera) : std::move(image);
    };
    backend.for_chunks(count, 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) try {
                load(i);
            } catch (...) {
                failures[i] = std::current_exception();
            }
    });
    for (const auto& failure : failures)
        if (failure) std::rethrow_exception(failure);
    for (NamedCamera& camera : capture.cameras) camera.distortion.reset();

    if (warnings)
        for (const std::string& text : capture_warnings(capture, body)) warnings->push_back(folder.string() + ": " + text);
    return capture;
}

inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body) {
    std::vector<std::string> warnings;
    const std::size_t frames = capture.frame_count();
    if (frames == 0) return warnings;
    const std::array<std::size_t, 3> looked_at{0, frames / 2, frames - 1};
    std::vector<std::vector<vec3<double>>> points;
    for (const std::size_t frame : looked_at) points.push_back(detail::bone_points(body, capture.motion, frame));

    const auto percent = [](double share) { return std::to_string(static_cast<int>(100 * share + 0.5)) + "%"; };
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        detail::MaskStatistics mean;
        for (std::size_t k = 0; k < looked_at.size(); ++k) {
            const auto one = detail::mask_statistics(capture.cameras[c].camera, capture.image({c, looked_at[k]}), points[k]);
            const double weight = 1.0 / static_cast<double>(looked_at.size());
            mean.inside += weight * one.inside, mean.extent += weight * one.extent;
            mean.on_body += weight * one.on_body, mean.border += weight * one.border;
            mean.opaque = mean.opaque && one.opaque;
        }
        const std::string camera = "camera '" + capture.cameras[c].name + "'";
        if (mean.inside < 0.3)
            warnings.push_back(camera + " is far off the body, " + percent(mean.inside) +
                               " of which projects into its images; R and t must map world to camera (x right, y down, z forward) in metres, "
                               "and the poses must belong to these images");
        else if (mean.extent < 0.02 * capture.cameras[c].camera.height)
            warnings.push_back(camera + " sees a body " + std::to_string(static_cast<int>(mean.extent + 0.5)) +
                               " pixels tall; t is probably not in metres");
        else if (mean.opaque)
            warnings.push_back(camera + " has images without a mask: no pixel is transparent; store the person's mask as alpha, or in masks/");
        else if (mean.on_body < 0.4 && mean.border > 0.6)
            warnings.push_back(camera + " has a mask that is probably inverted: alpha is " + percent(mean.on_body) +
                               " on the body and " + percent(mean.border) + " at the image's border; alpha must be 1 on the person");
        else if (mean.on_body < 0.5)
            warnings.push_back(camera + " has masks that do not lie on the posed body (" + percent(mean.on_body) +
                               " of it covered); poses, cameras and images probably do not belong together");
    }
    return warnings;
}

inline void save_capture(const std::filesystem::path& folder, const Capture& capture) {
    const std::size_t frames = capture.frame_count();
    check_size("save_capture", "images", capture.images.size(), capture.cameras.size() * frames, "store one per camera and frame");
    std::error_code error;
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        const auto images = folder / "images" / capture.cameras[c].name;
        std::filesystem::create_directories(images, error);
        if (error) throw IoError(images.string() + ": cannot be created: " + error.message());
        for (std::size_t f = 0; f < frames; ++f) {
            const std::string digits = std::to_string(f);
            const std::string name = std::string(digits.size() < 4 ? 4 - digits.size() : 0, '0') + digits + ".png";
            detail::check_image_size(images / name, capture.image({c, f}), capture.cameras[c]);
            write_png(images / name, capture.image({c, f}));
        }
    }
    save_motion(folder / "poses.npz", capture.motion);
    write_cameras(folder / "cameras.json", {capture.cameras, capture.fps, capture.floor_y, capture.test_frames});
}

} // namespace gsh
