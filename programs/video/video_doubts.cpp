// SPDX-License-Identifier: Apache-2.0
#include "video/video_doubts.hpp"

#include "common/figures.hpp"
#include "common/input_files.hpp"
#include "common/progress.hpp"

#include <gsh/body/body_model.hpp>
#include <gsh/body/landmarks.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/posed_body.hpp>
#include <gsh/check/lost_parts.hpp>
#include <gsh/check/silhouette.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/math/spread.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace gsh::programs {

namespace {

namespace fs = std::filesystem;

/// How many of both hands have keypoints that are believed.
std::size_t hands_of(const Detection& person) {
    std::size_t hands = 0;
    for (const bool mirrored : {false, true})
        hands += std::any_of(person.points.begin(), person.points.end(), [&](const Keypoint& point) {
            constexpr double believed = 0.3;
            const int landmark = mirrored ? mirrored_landmark(point.landmark) : point.landmark;
            return point.confidence >= believed &&
                   std::find(left_hand_landmarks.begin() + 1, left_hand_landmarks.end(), landmark) !=
                       left_hand_landmarks.end(); // the first is the wrist, which is one of the body, too
        });
    return hands;
}

VideoFacts facts_of(const fs::path& capture, const fs::path& body_file, std::optional<double> height,
                    const std::string& poses) {
    const Detections found = load_detections(capture);
    const std::vector<NamedCamera> cameras = read_cameras(capture / "cameras.json").cameras;
    const BodyModel body = body_of_file(body_file);
    const Motion motion = load_motion(capture / poses, body);
    const Json fit = json_of_file(capture / "fit.json");
    const std::size_t C = cameras.size(), T = motion.frame_count();

    VideoFacts facts;
    facts.cameras = C, facts.photographs = C * T, facts.turn_images = T;
    facts.calibrated = found.calibrated, facts.height = height;
    facts.turn_degrees = fit.at("turn_degrees"), facts.pose_held = fit.at("pose_held");
    for (const Json& camera : fit.at("cameras"))
        if (camera.at("median_mm").is_number())
            facts.keypoints_beside = std::max(facts.keypoints_beside, 1e-3 * camera.at("median_mm").get<double>());
    // A mask is blamed only where the body lies as near to the keypoints as it usually does.
    std::vector<double> frame_fit, known;
    for (const Json& mm : fit.at("frame_median_mm")) {
        frame_fit.push_back(mm.is_number() ? mm.get<double>() : std::numeric_limits<double>::infinity());
        if (mm.is_number()) known.push_back(frame_fit.back());
    }
    const double usual = known.empty() ? 0 : median(known);

    const std::vector<int> parts = body_parts(body);
    std::vector<double> heights;
    std::size_t with_person = 0, hands = 0;
    Progress shown("judging the video");
    for (const PhotoKeypoints& photo : found.keypoints) {
        if (photo.people.empty()) continue;
        ++with_person;
        hands += hands_of(photo.people[0]);
        const Camera<double>& camera = cameras[photo.camera].camera;
        const PosedBody posed = pose_body(body, motion.pose_at(photo.frame), motion.transl[photo.frame], motion.betas);
        double low = std::numeric_limits<double>::infinity(), high = -low, depth = 0, outside = 0;
        for (const vec3<double>& p : posed.vertices) {
            const vec3<double> seen = to_camera(camera, p);
            const vec2<double> pixel = to_pixel(camera, seen);
            low = std::min(low, pixel.y), high = std::max(high, pixel.y), depth += seen.z;
            outside += pixel.x < 0 || pixel.y < 0 || pixel.x > camera.width || pixel.y > camera.height;
        }
        const auto count = static_cast<double>(posed.vertices.size());
        heights.push_back(high - low);
        facts.cut += outside > 0.02 * count;
        if (found.has_mask(photo.camera, photo.frame) && frame_fit[photo.frame] < 1.5 * usual) {
            const PixelImage image = load_detected_mask(found, photo.camera, photo.frame);
            Silhouette mask{image.height, image.width, {}};
            for (const std::uint8_t value : image.data) mask.inside.push_back(value >= 128);
            constexpr double margin = 0.03; // metres: what a fit may err by
            const auto sights = parts_in_mask(body, parts, posed.vertices, camera, mask,
                                              static_cast<int>(std::lround(margin * camera.fx * count / depth)));
            for (std::size_t k = 0; k < sights.size(); ++k) facts.lost[k] += sights[k].is_lost();
        }
        shown.show(static_cast<double>(with_person) / static_cast<double>(found.keypoints.size()), "");
    }
    facts.without_person = facts.photographs - with_person;
    facts.person_pixels = heights.empty() ? 0 : median(heights);
    facts.hands_found = with_person > 0 ? static_cast<double>(hands) / static_cast<double>(2 * with_person) : 0;
    return facts;
}

} // namespace

std::vector<VideoDoubt> doubts_of_video(const fs::path& out, const fs::path& body, const std::vector<double>& heights,
                                        const std::vector<std::string>& poses) {
    std::vector<VideoDoubt> doubts;
    if (poses.size() == 1) {
        const auto height = heights.empty() ? std::nullopt : std::optional(heights[0]);
        doubts = video_verdict(facts_of(out / "capture", body, height, poses[0]));
    }
    const Json check = json_of_file(out / "check" / "check.json");
    constexpr double mistake = 1, hint = 0.1;
    for (const Json& finding : check.at("findings"))
        if (finding.at("fault") != "empty-masks") // where nobody was found, which video_verdict judges
            doubts.push_back({finding.at("fault"), mistake, finding.at("text")});
    for (const Json& advice : check.at("advice")) doubts.push_back({advice.at("doubt"), hint, advice.at("text")});
    std::stable_sort(doubts.begin(), doubts.end(),
                     [](const VideoDoubt& a, const VideoDoubt& b) { return a.weight > b.weight; });
    return doubts;
}

} // namespace gsh::programs
