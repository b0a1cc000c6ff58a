// SPDX-License-Identifier: Apache-2.0
/// @file  Captures: a folder with images, masks, cameras and poses of a person.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/backend/serial.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/motion_span.hpp>
#include <gsh/body/skeleton.hpp>
#include <gsh/core/error.hpp>
#include <gsh/image/resample.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace gsh {

/// One image of a capture.
struct CaptureView {
    std::size_t camera = 0, frame = 0;
};

/// A person filmed by calibrated cameras, held in memory.
///
/// Shapes  images [cameras * frames], RGBA with straight alpha (the mask), undistorted; image (c, f) has index
///         c * frame_count() + f and is empty if it was not taken. motion holds one pose per frame. backgrounds
///         [cameras], opaque RGBA in the cameras' sizes, or empty.
struct Capture {
    std::string name;
    std::vector<NamedCamera> cameras;
    Motion motion;
    std::vector<PixelImage> images;
    /// Each camera's view without the person. Photographs and renderings are composited over it. If empty, they are
    /// composited over a plain colour of the user's choice.
    std::vector<PixelImage> backgrounds;
    std::vector<int> test_frames;  ///< excluded from training, in every camera
    double fps = 0;                ///< 0 if unknown
    std::optional<double> floor_y; ///< metres
    /// A span of the motion that is excluded from training in every camera, too, and judged apart; see hold_out_motion.
    /// Files do not store it.
    std::vector<std::size_t> held_out_frames = {};

    [[nodiscard]] std::size_t frame_count() const { return motion.frame_count(); }
    [[nodiscard]] const PixelImage& image(CaptureView view) const {
        return images[view.camera * frame_count() + view.frame];
    }
    /// Whether the image was taken. Before images are loaded, all count as taken.
    [[nodiscard]] bool is_taken(CaptureView view) const { return images.empty() || !image(view).data.empty(); }
    /// The camera's background; null if there is none.
    [[nodiscard]] const PixelImage* background(std::size_t camera) const {
        return backgrounds.empty() ? nullptr : &backgrounds[camera];
    }
    [[nodiscard]] bool is_held_out(std::size_t frame) const {
        return std::find(held_out_frames.begin(), held_out_frames.end(), frame) != held_out_frames.end();
    }
    /// Whether a view is for evaluation: those of test cameras, and test frames of every camera. Held-out frames are
    /// judged by the test cameras. Without test cameras, they are judged by all.
    [[nodiscard]] bool is_test(CaptureView view) const {
        return cameras[view.camera].role == NamedCamera::Role::test || is_test_frame(view.frame) ||
               (is_held_out(view.frame) && !has_test_camera());
    }
    /// Whether a view is for training. In held-out frames, views of training cameras may be for neither.
    [[nodiscard]] bool is_training(CaptureView view) const {
        return cameras[view.camera].role != NamedCamera::Role::test && !is_test_frame(view.frame) &&
               !is_held_out(view.frame);
    }
    /// All views for training, or for evaluation if `test`.
    [[nodiscard]] std::vector<CaptureView> views(bool test) const {
        std::vector<CaptureView> result;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            for (std::size_t f = 0; f < frame_count(); ++f)
                if (is_taken({c, f}) && (test ? is_test({c, f}) : is_training({c, f}))) result.push_back({c, f});
        return result;
    }

private:
    [[nodiscard]] bool is_test_frame(std::size_t frame) const {
        return std::find(test_frames.begin(), test_frames.end(), static_cast<int>(frame)) != test_frames.end();
    }
    [[nodiscard]] bool has_test_camera() const {
        return std::any_of(cameras.begin(), cameras.end(),
                           [](const NamedCamera& camera) { return camera.role == NamedCamera::Role::test; });
    }
};

/// Leaves a span of the capture's motion out of training, in every camera. It replaces an earlier one.
///
/// Errors  those of span_frames; ValueError if no view is left for training.
inline void hold_out_motion(Capture& capture, const MotionSpan& span) {
    capture.held_out_frames = span_frames(span, capture.motion.timestamps);
    check_value(!capture.views(false).empty(), span.name,
                "leaves no view for training in " + capture.name +
                    "; expected a span outside of which training cameras have frames that are not test frames");
}

/// Every step-th frame from first to last, both inclusive.
struct FrameRange {
    int first = 0, last = 0, step = 1;

    [[nodiscard]] bool contains(int frame) const {
        return frame >= first && frame <= last && (frame - first) % step == 0;
    }
};

struct CaptureOptions {
    std::string poses = "poses.npz"; ///< file or folder, relative to the capture or absolute; see load_any_motion
    MotionFileOptions::Hands hands = MotionFileOptions::Hands::automatic;
    bool empty_masks = false; ///< accept images whose mask is empty
    std::optional<MotionSpan> hold_out = {}; ///< left out of training in every camera; see hold_out_motion

    // Only for foreign layouts (io/capture/any_capture.hpp); our own layout stores these in its files.
    std::optional<FrameRange> train_frames = {}, test_frames = {}; ///< instead of the data set's own split
    std::vector<std::string> test_cameras = {};                    ///< names; empty: the data set's own
    int downscale = 0;                                             ///< whole factor; 0: as the data set's other readers
    int person = 0;                                                ///< selects the motion if poses hold several people
    std::filesystem::path model = {}; ///< folder of the data set's own rig; empty: its default place
};

/// Loads DIR/cameras.json, DIR/poses.npz (or other poses) and the images DIR/images/CAMERA/FRAME.png (or .jpg), in the
/// order of their names. The mask is the images' alpha, or DIR/masks/CAMERA/FRAME.png with a white person.
/// DIR/backgrounds/CAMERA.png (or .jpg), for all cameras or none, shows the scene without the person. Images of cameras
/// with distortion are undistorted. `body` is the body model of the poses.
///
/// Errors    IoError, ShapeError, ValueError naming the file: images, poses and cameras that do not match, a mask that
///           is empty everywhere, no view to train on, and all errors of the readers of the single files.
/// Warnings  probable mistakes, one sentence each with the likely cause; see capture_warnings.
template <HostExecutor E>
[[nodiscard]] Capture load_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
                                   const CaptureOptions& options = {}, std::vector<std::string>* warnings = nullptr);

/// Writes the same layout and creates the folder.
inline void save_capture(const std::filesystem::path& folder, const Capture& capture);

/// Projects the body's posed joints into the images and warns about cameras that do not see them or see them far too
/// small, masks that are full outside the body or do not cover it, and images without alpha.
[[nodiscard]] inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body);
/// The same for another person in the capture, whose motion covers the same frames.
[[nodiscard]] inline std::vector<std::string> capture_warnings(const Capture& capture, const BodyModel& body,
                                                               const Motion& motion);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// Image files of a folder in the order of their names.
inline std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder) {
    std::error_code error;
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        std::string extension = entry.path().extension().string();
        for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
        if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") files.push_back(entry.path());
    }
    if (error)
        throw IoError(folder.string() + ": cannot be listed: " + error.message() + "; expected a folder of images");
    std::sort(files.begin(), files.end());
    return files;
}

/// The missing file in a numbered sequence; empty if there is none.
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
        throw IoError((folder / missing).string() + ": is missing from the numbered files");
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

/// Sets alpha from a mask's alpha channel if it has transparency, else from its red channel.
inline void apply_mask(const PixelImage& mask, PixelImage& image) {
    bool opaque = true;
    for (std::size_t i = 3; i < mask.data.size(); i += 4) opaque = opaque && mask.data[i] == 255;
    for (std::size_t i = 0; i < image.data.size(); i += 4) image.data[i + 3] = mask.data[i + (opaque ? 0 : 3)];
}

inline void check_mask(const std::filesystem::path& path, const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        if (image.data[i] != 0) return;
    throw ValueError(path.string() + ": its mask (alpha) is empty everywhere, expected the person in it");
}

/// The image at 1/factor of its size: each pixel is the mean of a square. Colours and alpha are averaged separately, as
/// other readers of these data sets reduce photograph and mask before combining them.
inline PixelImage shrink(const PixelImage& image, int factor) {
    if (factor == 1) return image;
    PixelImage small(image.channels, image.height / factor, image.width / factor);
    const int area = factor * factor;
    for (int y = 0; y < small.height; ++y)
        for (int x = 0; x < small.width; ++x)
            for (int c = 0; c < image.channels; ++c) {
                int sum = area / 2;
                for (int k = 0; k < area; ++k) sum += image.pixel(y * factor + k / factor, x * factor + k % factor)[c];
                small.pixel(y, x)[c] = static_cast<std::uint8_t>(sum / area);
            }
    return small;
}

/// The camera of reduced images.
///
/// Errors  ValueError for a factor that does not divide the size.
inline Camera<double> shrink(const Camera<double>& camera, int factor, const std::string& where) {
    check_value(factor >= 1 && camera.width % factor == 0 && camera.height % factor == 0, where,
                "images of " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    " pixels cannot be shrunk by " + std::to_string(factor) + "; take a factor that divides both");
    Camera<double> small = camera;
    small.fx /= factor, small.fy /= factor, small.cx /= factor, small.cy /= factor;
    small.width /= factor, small.height /= factor;
    return small;
}

inline void check_range(const FrameRange& range, const std::string& where) {
    constexpr int most = 100'000'000; // so that counting up to it cannot overflow
    check_value(range.first >= 0 && range.step >= 1 && range.step <= most && range.last >= range.first &&
                    range.last <= most,
                where,
                "the frames " + std::to_string(range.first) + " to " + std::to_string(range.last) + " by " +
                    std::to_string(range.step) + " are none; expected first <= last and a step of at least 1");
}

/// Runs load(i) for all i. If several fail, the first in order is reported, independently of the threads.
template <HostExecutor E, class Load>
void load_all(E& executor, std::size_t count, const Load& load) {
    std::vector<std::exception_ptr> failures(count);
    executor.for_chunks(count, 1, [&](std::size_t, std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) try {
                load(i);
            } catch (...) {
                failures[i] = std::current_exception();
            }
    });
    for (const auto& failure : failures)
        if (failure) std::rethrow_exception(failure);
}

/// FOLDER/NAME.png, .jpg or .jpeg, the first that exists; the .png if none does, for the error message.
inline std::filesystem::path image_path(const std::filesystem::path& folder, const std::string& name) {
    std::error_code ignored;
    for (const char* extension : {".png", ".jpg", ".jpeg"})
        if (auto path = folder / (name + extension); std::filesystem::exists(path, ignored)) return path;
    return folder / (name + ".png");
}

/// Throws ValueError if a background has a transparent pixel.
inline void check_opaque(const std::filesystem::path& path, const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        check_value(image.data[i] == 255, path.string(), "is transparent somewhere, expected an opaque background");
}

inline PixelImage straighten(const PixelImage& image, const NamedCamera& camera) {
    PixelImage straight(4, image.height, image.width);
    cpu::Serial serial;
    resample_rgba8<double>(serial, Span<const std::uint8_t>(image.data), image.height, image.width,
                           UndistortMap<double>{camera.camera, camera.camera, *camera.distortion},
                           Span<std::uint8_t>(straight.data), straight.height, straight.width);
    return straight;
}

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

template <HostExecutor E>
Capture load_capture(E& executor, const std::filesystem::path& folder, const BodyModel& body,
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
    MotionFileOptions motion_options{options.hands, list.fps};
    motion_options.person = options.person;
    capture.motion = load_any_motion(poses, body, motion_options, warnings);
    const std::size_t frames = capture.frame_count(), count = capture.cameras.size() * frames;
    std::vector<std::filesystem::path> images, masks;
    for (const NamedCamera& camera : capture.cameras) {
        const auto append = [&](const char* kind, std::vector<std::filesystem::path>& files) {
            const auto own = detail::list_frames(folder / kind / camera.name, frames, poses);
            files.insert(files.end(), own.begin(), own.end());
        };
        append("images", images);
        if (std::filesystem::is_directory(folder / "masks")) append("masks", masks);
    }

    for (const int frame : capture.test_frames)
        check_value(static_cast<std::size_t>(frame) < frames, (folder / "cameras.json").string(),
                    "test_frames holds " + std::to_string(frame) + ", expected frames below " + std::to_string(frames));
    check_value(!capture.views(false).empty(), (folder / "cameras.json").string(),
                "no view is left for training; give a camera the role train, and leave frames out of test_frames");

    capture.images.resize(count);
    detail::load_all(executor, count, [&](std::size_t i) {
        const NamedCamera& camera = capture.cameras[i / frames];
        PixelImage image = read_image(images[i]);
        detail::check_image_size(images[i], image, camera);
        if (!masks.empty()) {
            const PixelImage mask = read_image(masks[i]);
            detail::check_image_size(masks[i], mask, camera);
            detail::apply_mask(mask, image);
        }
        if (!options.empty_masks) detail::check_mask(masks.empty() ? images[i] : masks[i], image);
        capture.images[i] = camera.distortion ? detail::straighten(image, camera) : std::move(image);
    });
    if (std::filesystem::is_directory(folder / "backgrounds"))
        for (const NamedCamera& camera : capture.cameras) {
            const auto path = detail::image_path(folder / "backgrounds", camera.name);
            PixelImage image = read_image(path);
            detail::check_image_size(path, image, camera);
            detail::check_opaque(path, image);
            if (camera.distortion) {
                image = detail::straighten(image, camera);
                for (std::size_t i = 3; i < image.data.size(); i += 4)
                    image.data[i] = 255; // pixels outside the photograph become black
            }
            capture.backgrounds.push_back(std::move(image));
        }
    for (NamedCamera& camera : capture.cameras) camera.distortion.reset();
    if (options.hold_out) hold_out_motion(capture, *options.hold_out);

    if (warnings)
        for (const std::string& text : capture_warnings(capture, body))
            warnings->push_back(folder.string() + ": " + text);
    return capture;
}

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
            const auto one = detail::mask_statistics(capture.cameras[c].camera, capture.image({c, frame}), on_bones);
            const double weight = 1.0 / static_cast<double>(looked_at.size());
            mean.inside += weight * one.inside, mean.extent += weight * one.extent;
            mean.on_body += weight * one.on_body, mean.border += weight * one.border;
            mean.opaque = mean.opaque && one.opaque;
        }
        const std::string camera = "camera '" + capture.cameras[c].name + "'";
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

inline void save_capture(const std::filesystem::path& folder, const Capture& capture) {
    const std::size_t frames = capture.frame_count();
    check_size("save_capture", "images", capture.images.size(), capture.cameras.size() * frames,
               "store one per camera and frame");
    for (std::size_t i = 0; i < capture.images.size(); ++i)
        check_value(!capture.images[i].data.empty(), "save_capture",
                    "camera '" + capture.cameras[i / frames].name + "' did not take frame " +
                        std::to_string(i % frames) +
                        ", but the layout has a place for every image; leave out such cameras or frames");
    std::error_code error;
    if (!capture.backgrounds.empty()) {
        check_size("save_capture", "backgrounds", capture.backgrounds.size(), capture.cameras.size(),
                   "store one per camera");
        std::filesystem::create_directories(folder / "backgrounds", error);
        if (error) throw IoError((folder / "backgrounds").string() + ": cannot be created: " + error.message());
        for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
            const auto path = folder / "backgrounds" / (capture.cameras[c].name + ".png");
            detail::check_image_size(path, capture.backgrounds[c], capture.cameras[c]);
            write_png(path, capture.backgrounds[c]);
        }
    }
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
