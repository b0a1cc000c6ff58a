// SPDX-License-Identifier: Apache-2.0
/// @file  A capture in memory, and the options of its readers.
#pragma once

#include <gsh/body/motion.hpp>
#include <gsh/body/motion_span.hpp>
#include <gsh/core/error.hpp>
#include <gsh/core/span.hpp>
#include <gsh/image/chroma.hpp>
#include <gsh/image/pixel_box.hpp>
#include <gsh/image/trimap.hpp>
#include <gsh/io/capture/named_camera.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_options.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace gsh {

namespace detail {

/// Whether alpha exceeds 1/2 somewhere.
inline bool shows_person(const PixelImage& image) {
    for (std::size_t i = 3; i < image.data.size(); i += 4)
        if (image.data[i] > 127) return true;
    return false;
}

} // namespace detail

/// One image of a capture.
struct CaptureView {
    std::size_t camera = 0, frame = 0;
};

/// Images of a capture that are read from their files when they are needed, because all of them are too large for
/// memory.
class StoredImages {
public:
    /// What is known of an image.
    struct Facts {
        bool taken = false;
        bool shows_person = false; ///< alpha exceeds 1/2 somewhere
        bool half_chroma = false;  ///< has_half_chroma
        bool background_removed = false; ///< background_is_removed
        PixelBox mask = {};        ///< box_of_mask
    };

    /// The facts of an image that was taken.
    [[nodiscard]] static Facts facts_of(const PixelImage& image);

    StoredImages() = default;
    StoredImages(const StoredImages&) = delete;
    StoredImages& operator=(const StoredImages&) = delete;
    virtual ~StoredImages() = default;

    /// Reads an image as Capture::images would hold it. Several threads may call this at a time.
    /// Errors  those of the capture's reader, which name the file.
    [[nodiscard]] virtual PixelImage read(std::size_t image) const = 0;

    std::vector<Facts> facts; ///< of each image
    std::uint64_t memory = 0; ///< CaptureOptions::image_memory, for what is kept of images that were read
};

inline StoredImages::Facts StoredImages::facts_of(const PixelImage& image) {
    return {.taken = true,
            .shows_person = detail::shows_person(image),
            .half_chroma = has_half_chroma(image.data, image.height, image.width),
            .background_removed = gsh::background_is_removed(image.data),
            .mask = box_of_mask(image.data, image.height, image.width)};
}

/// A person filmed by calibrated cameras, held in memory.
///
/// Shapes  images [cameras * frames], RGBA with straight alpha (the mask), undistorted; image (c, f) has index
///         c * frame_count() + f and is empty if it was not taken. motion holds one pose per frame. backgrounds
///         [cameras], opaque RGBA in the cameras' sizes, or empty. With `stored`, images is empty.
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
    /// The names of the images' files without extension, [cameras * frames]; empty if they come from no files.
    std::vector<std::string> image_names = {};
    /// The pixels of each image where something is in front of the person, [cameras * frames]; empty if there are none.
    std::vector<std::vector<UnknownPixel>> hidden = {};
    /// The images, if CaptureOptions::image_memory is too little to hold them.
    std::shared_ptr<const StoredImages> stored = {};

    [[nodiscard]] std::size_t frame_count() const { return motion.frame_count(); }
    [[nodiscard]] std::size_t index(CaptureView view) const { return view.camera * frame_count() + view.frame; }
    /// An image that is held; stored ones are not.
    [[nodiscard]] const PixelImage& image(CaptureView view) const { return images[index(view)]; }
    [[nodiscard]] PixelImage& image(CaptureView view) { return images[index(view)]; }
    /// A copy of an image that is held, or the stored one.
    /// Errors  those of StoredImages::read.
    [[nodiscard]] PixelImage read_image(CaptureView view) const {
        return stored ? stored->read(index(view)) : image(view);
    }
    /// Whether the image was taken. Before images are loaded, all count as taken.
    [[nodiscard]] bool is_taken(CaptureView view) const {
        return stored ? stored->facts[index(view)].taken : images.empty() || !image(view).data.empty();
    }
    /// Whether alpha exceeds 1/2 somewhere in an image.
    [[nodiscard]] bool shows_person(CaptureView view) const {
        return stored ? stored->facts[index(view)].shows_person : detail::shows_person(image(view));
    }
    /// Whether the background was removed from an image (gsh::background_is_removed).
    [[nodiscard]] bool background_is_removed(CaptureView view) const {
        return stored ? stored->facts[index(view)].background_removed : gsh::background_is_removed(image(view).data);
    }
    /// The pixels of a view that are not compared, because something is in front of the person.
    [[nodiscard]] Span<const UnknownPixel> hidden_in(CaptureView view) const {
        if (hidden.empty()) return {};
        return hidden[index(view)];
    }
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
    double input_fps = 0;     ///< frames a second of the poses, whatever their files state; 0: as they state
    bool empty_masks = false; ///< keep images whose mask is empty; else they count as not taken
    std::optional<MotionSpan> hold_out = {}; ///< left out of training in every camera; see hold_out_motion
    /// Bytes that images may take, four a pixel. Those of larger captures are read when they are needed, in all layouts
    /// but GalaBasketball (Capture::stored). 0: no limit.
    std::uint64_t image_memory = 0;

    // Only for foreign layouts (io/capture/any_capture.hpp); our own layout stores these in its files.
    std::optional<FrameRange> train_frames = {}, test_frames = {}; ///< instead of the data set's own split
    std::vector<std::string> test_cameras = {};                    ///< names; empty: the data set's own
    int downscale = 0;                                             ///< whole factor; 0: as the data set's other readers
    int person = 0;                                                ///< selects the motion if poses hold several people
    std::filesystem::path model = {}; ///< folder of the data set's own rig; empty: its default place
};

namespace detail {

/// Throws ValueError for a range without frames.
inline void check_range(const FrameRange& range, const std::string& where) {
    constexpr int most = 100'000'000; // so that counting up to it cannot overflow
    check_value(range.first >= 0 && range.step >= 1 && range.step <= most && range.last >= range.first &&
                    range.last <= most,
                where,
                "the frames " + std::to_string(range.first) + " to " + std::to_string(range.last) + " by " +
                    std::to_string(range.step) + " are none; expected first <= last and a step of at least 1");
}

} // namespace detail
} // namespace gsh
