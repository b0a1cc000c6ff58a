// SPDX-License-Identifier: Apache-2.0
#include "video/video_report.hpp"

#include "common/base64.hpp"
#include "common/figures.hpp"
#include "common/help.hpp"
#include "common/input_files.hpp"
#include "common/overlay.hpp"
#include "common/progress.hpp"
#include "common/report.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/capture_photos.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/file/atomic_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace gsh::programs {

namespace {

namespace fs = std::filesystem;

/// Where a picture shows the people, with a margin.
struct Crop {
    int left = 0, top = 0, width = 0, height = 0;
};

Crop crop_of(const Silhouette& body, int width, int height) {
    int left = width, right = 0, top = height, bottom = 0;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            if (body.row(y)[x])
                left = std::min(left, x), right = std::max(right, x), top = std::min(top, y),
                bottom = std::max(bottom, y);
    if (right < left) return {0, 0, width, height};
    const int margin = std::max(8, (bottom - top) / 8);
    left = std::max(0, left - margin), top = std::max(0, top - margin);
    return {left, top, std::min(width, right + margin + 1) - left, std::min(height, bottom + margin + 1) - top};
}

PixelImage cropped(const PixelImage& picture, const Crop& crop) {
    PixelImage result(picture.channels, crop.height, crop.width);
    for (int y = 0; y < crop.height; ++y)
        for (int x = 0; x < crop.width; ++x)
            std::copy_n(picture.pixel(crop.top + y, crop.left + x), picture.channels, result.pixel(y, x));
    return result;
}

std::string image_tag(const PixelImage& picture, const std::string& caption) {
    return "<figure style=\"display:inline-block;vertical-align:top;margin-right:1rem\"><img alt=\"" +
           detail::escape(caption) + "\" src=\"data:image/png;base64," + base64(encode_png(picture)) +
           "\"><figcaption>" + detail::escape(caption) + "</figcaption></figure>";
}

/// What the stages made, as the page shows it.
class StagePictures {
public:
    StagePictures(const fs::path& capture, const fs::path& body, const std::vector<std::string>& poses)
        : found_(load_detections(capture)), cameras_(read_cameras(capture / "cameras.json").cameras),
          body_(body_of_file(body)) {
        for (const std::string& name : poses) motions_.push_back(load_motion(capture / name, body_));
        images_ =
            gsh::detail::list_photos(capture, cameras_, false, frame_count(), "one per pose of " + poses[0]).images;
    }

    [[nodiscard]] std::size_t camera_count() const { return cameras_.size(); }
    [[nodiscard]] const std::string& camera_name(std::size_t c) const { return cameras_[c].name; }
    [[nodiscard]] std::size_t frame_count() const { return motions_[0].frame_count(); }

    /// Keypoints, the outline of the mask, that of the body, side by side; nothing for a photograph that is missing.
    [[nodiscard]] std::string row(std::size_t c, std::size_t t) const {
        const fs::path& file = images_[c * frame_count() + t];
        if (file.empty()) return {};
        PixelImage photo = read_image(file);
        PixelImage rgba(4, photo.height, photo.width);
        for (std::size_t i = 0; i < rgba.data.size() / 4; ++i) {
            for (std::size_t k = 0; k < 3; ++k)
                rgba.data[4 * i + k] =
                    photo.data[i * static_cast<std::size_t>(photo.channels) + (photo.channels >= 3 ? k : 0)];
            rgba.data[4 * i + 3] = 255;
        }
        const OverlayColors colors;
        const PixelImage canvas = overlay_canvas(rgba);
        const Camera<double>& camera = cameras_[c].camera;
        std::vector<Silhouette> bodies;
        for (const Motion& motion : motions_) {
            const PosedBody posed = pose_body(body_, motion.pose_at(t), motion.transl[t], motion.betas);
            bodies.push_back(mesh_silhouette(posed.vertices, body_.faces, camera));
        }
        Silhouette all = bodies[0];
        for (const Silhouette& body : bodies)
            for (std::size_t i = 0; i < all.inside.size(); ++i) all.inside[i] |= body.inside[i];
        const Crop crop = crop_of(all, canvas.width, canvas.height);

        PixelImage points = canvas;
        for (const PhotoKeypoints& of : found_.keypoints)
            if (of.camera == c && of.frame == t)
                for (const Detection& person : of.people)
                    for (const Keypoint& point : person.points) {
                        if (point.confidence < 0.3) continue;
                        const bool sided = mirrored_landmark(point.landmark) != point.landmark;
                        const Rgb& color = !sided                    ? colors.middle
                                           : point.landmark % 2 == 0 ? colors.left
                                                                     : colors.right;
                        draw_dot(points, static_cast<int>(std::floor(point.pixel.x)),
                                 static_cast<int>(std::floor(point.pixel.y)), std::max(1, crop.height / 200), color);
                    }
        PixelImage masked = canvas;
        if (found_.has_mask(c, t)) {
            const PixelImage mask = load_detected_mask(found_, c, t);
            Silhouette outline{mask.height, mask.width, {}};
            for (const std::uint8_t value : mask.data) outline.inside.push_back(value >= 128);
            draw_outline(masked, outline, colors.mask);
        }
        PixelImage fitted = canvas;
        for (const Silhouette& body : bodies) draw_outline(fitted, body, colors.body);
        return "<h3>Frame " + std::to_string(t) + "</h3>" + image_tag(cropped(points, crop), "keypoints") +
               image_tag(cropped(masked, crop), "mask") +
               image_tag(cropped(fitted, crop), bodies.size() == 1 ? "fitted body" : "fitted bodies");
    }

private:
    Detections found_;
    std::vector<NamedCamera> cameras_;
    BodyModel body_;
    std::vector<Motion> motions_;  // of each person
    std::vector<fs::path> images_; // [cameras * frames]
};

} // namespace

void write_video_report(const fs::path& out, const fs::path& body, const std::vector<VideoDoubt>& doubts,
                        const FittedCapture& fitted) {
    const StagePictures pictures(out / "capture", body, fitted.poses);
    Progress shown("writing the report");
    std::string html = detail::page_head("From the video to the avatar");
    html += "<p class=\"verdict\"><a href=\"avatar/report.html\">The avatar, and how good it is</a></p>"
            "<h2>The video</h2>";
    if (doubts.empty()) html += "<p>Nothing in it is in the way of a good avatar.</p>";
    if (!doubts.empty()) {
        html += "<p>What would make the avatar better, the most important first:</p><ol>";
        for (const VideoDoubt& doubt : doubts)
            html += "<li>" + detail::escape(doubt.text) + " (" + detail::escape(help_text({doubt.doubt})) + ")</li>";
        html += "</ol>";
    }
    if (!fitted.notes.empty()) {
        html += "<h2>What the fit did</h2><ul>";
        for (const std::string& note : fitted.notes) html += "<li>" + detail::escape(note) + "</li>";
        html += "</ul>";
    }
    html +=
        "<h2>The stages</h2><p>Points of the person's left side are red, of the right side green. The outline of the "
        "mask is yellow, that of the body cyan. All files are in <a href=\"capture/\">capture/</a>; overlays of more "
        "frames are in <a href=\"check/overlays/\">check/overlays/</a>.</p>";
    const std::size_t T = pictures.frame_count(), each = std::min<std::size_t>(4, T);
    for (std::size_t c = 0; c < pictures.camera_count(); ++c) {
        html += "<h3>Camera " + detail::escape(pictures.camera_name(c)) + "</h3>";
        for (std::size_t k = 0; k < each; ++k) {
            html += pictures.row(c, (2 * k + 1) * T / (2 * each));
            shown.show(static_cast<double>(c * each + k + 1) / static_cast<double>(pictures.camera_count() * each), "");
        }
    }
    html += "</body></html>\n";
    write_file(out / "report.html", html);
}

} // namespace gsh::programs
