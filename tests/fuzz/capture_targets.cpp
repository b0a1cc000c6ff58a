// SPDX-License-Identifier: Apache-2.0
#include "fuzz/uses.hpp"

#include "io/sample_cameras.hpp"

#include <gsh/backend/serial.hpp>
#include <gsh/camera/pinhole.hpp>
#include <gsh/io/capture/any_capture.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/colmap.hpp>
#include <gsh/io/capture/colmap_image.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/easymocap_cameras.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/capture/people_capture.hpp>
#include <gsh/io/capture/prior_views_file.hpp>
#include <gsh/math/rotation.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

namespace gsh::fuzz {

namespace {

using fuzz::use; // beside those below

/// Projects a point that the camera sees, and checks what a renderer relies on. A size of 0 is not known yet.
void use(const Camera<double>& camera) {
    must(camera.width >= 0 && camera.height >= 0 && camera.fx > 0 && camera.fy > 0, "a camera is none");
    const vec3<double> ahead = camera.center() + transpose(camera.R) * vec3<double>(0, 0, 1);
    must(std::isfinite(ahead.x + ahead.y + ahead.z) && is_rotation(camera.R, 1e-2), "a camera looks nowhere");
}
void use(const CameraList& list) {
    for (const NamedCamera& camera : list.cameras) use(camera.camera);
}

const Registered cameras_target("cameras", "a.json", [](const InputFile& file) {
    const CameraList list = read_cameras(file);
    use(list);
    must_come_back("cameras.json", list, write_cameras,
                   [](const std::filesystem::path& path) { return read_cameras(path); });
});
const Registered camera_target("camera", "a.json", [](const InputFile& file) {
    const NamedCamera read = read_camera(file);
    use(read.camera);
    must_come_back("camera.json", read, write_camera,
                   [](const std::filesystem::path& path) { return read_camera(path); });
});

const Registered prior_views_target("prior-views", "a/", [](const InputFile& folder) {
    const std::filesystem::path path = folder.path() / "priors.json";
    const std::vector<std::string> people{"anna", "ben"};
    const auto priors = read_prior_views(path, test::sample_cameras(), 3, people);
    (void)prior_views_checksum(path);
    must(priors.size() == people.size(), "views of other people were read");
    for (const EstimatedPriors& person : priors)
        for (const auto& [views, channels] : {std::pair(&person.depths, 1), std::pair(&person.normals, 3)})
            for (const EstimatedView& view : *views) {
                must(!view.frame || *view.frame < 3, "a view has a frame that is not there");
                check_prior_view("fuzz", "view", view.view, channels);
            }
});

void check_keypoints(const std::vector<PhotoKeypoints>& photos, std::size_t camera_count, std::size_t frames) {
    for (const PhotoKeypoints& photo : photos) {
        must(photo.camera < camera_count && photo.frame < frames, "keypoints have no photograph");
        for (const Detection& person : photo.people)
            for (const Keypoint& point : person.points)
                must(std::isfinite(point.pixel.x + point.pixel.y) && point.confidence > 0 && point.confidence <= 1,
                     "a keypoint is not a point");
    }
}
const Registered keypoints_target("keypoints", "a/", [](const InputFile& folder) {
    const std::filesystem::path file = folder.path() / "keypoints.json";
    std::error_code ignored;
    const auto path = std::filesystem::exists(file, ignored) ? file : folder.path();
    check_keypoints(load_keypoints(path, test::sample_cameras(), 3), 2, 3);
    const std::vector<std::string> names{"a", "b", "c", "d", "e", "f"};
    check_keypoints(load_keypoints(path, test::sample_cameras(), 3, names), 2, 3);
});

const Registered detections_target("detections", "a/", [](const InputFile& folder) {
    const Detections found = load_detections(folder.path());
    for (const NamedCamera& seen : found.cameras) use(seen.camera);
    check_keypoints(found.keypoints, found.cameras.size(), found.times.size());
    for (std::size_t c = 0; c < found.cameras.size(); ++c)
        for (std::size_t f = 0; f < found.times.size(); ++f)
            if (found.has_mask(c, f))
                must(load_detected_mask(found, c, f).width == found.cameras[c].camera.width, "a mask has another size");
});

const Registered colmap_target("colmap", "a/", [](const InputFile& folder) {
    const ColmapScene scene = read_colmap(folder.path());
    must(scene.points.size() == scene.colors.size(), "a point has no colour");
    for (const vec3<double>& point : scene.points)
        must(std::isfinite(point.x + point.y + point.z), "a point is not finite");
    for (const ColmapImage& image : scene.images) use(image.camera);
    if (scene.images.empty()) return;
    const StraightImage photo = read_colmap_image(scene.images[0], folder.path() / "images");
    use(photo.camera);
    must(photo.image.width == photo.camera.width && photo.image.channels == 4, "a photograph is not its camera's");
});

const Registered easymocap_cameras_target("easymocap-cameras", "a/",
                                   [](const InputFile& folder) { use(read_easymocap_cameras(folder.path())); });

/// Every photograph fits its camera; the person can be posed in every frame.
void use(const Capture& capture, const BodyModel& body) {
    must(capture.images.size() == capture.cameras.size() * capture.frame_count(), "a photograph has no place");
    must(!capture.views(false).empty(), "a capture shows nothing to train on");
    for (std::size_t c = 0; c < capture.cameras.size(); ++c) {
        use(capture.cameras[c].camera);
        for (std::size_t f = 0; f < capture.frame_count(); ++f) {
            if (!capture.is_taken({c, f})) continue;
            const PixelImage& image = capture.image({c, f});
            must(image.width == capture.cameras[c].camera.width && image.height == capture.cameras[c].camera.height &&
                     image.channels == 4,
                 "a photograph is not its camera's");
        }
    }
    use(capture.motion, body);
}

/// Loads a whole capture. Our own layout is written and read again.
void read_capture(const std::filesystem::path& folder, const std::vector<std::filesystem::path>& poses) {
    cpu::Serial backend;
    std::vector<std::string> warnings;
    const PeopleCapture people = load_people_capture(backend, folder, {&small_smpl(), 1}, poses, {}, &warnings);
    const Capture& capture = people.any.capture;
    use(capture, small_smpl());
    for (const CapturePerson& person : people.people) use(person.motion, small_smpl());
    check_warnings(warnings);
    if (people.any.layout != CaptureLayout::gsh) return;
    const std::filesystem::path copy = scratch() / "copy";
    std::error_code ignored;
    std::filesystem::remove_all(copy, ignored);
    save_capture(copy, capture);
    const Capture again = load_capture(backend, copy, small_smpl());
    must(again.images.size() == capture.images.size() && again.motion.pose == capture.motion.pose,
         "a capture that is written and read again differs");
    for (std::size_t i = 0; i < capture.images.size(); ++i)
        must(again.images[i].data == capture.images[i].data, "a photograph that is written and read again differs");
}

const Registered capture_target("capture", "a/", [](const InputFile& folder) { read_capture(folder.path(), {"poses.npz"}); });
const Registered people_target("people-capture", "a/",
                        [](const InputFile& folder) { read_capture(folder.path(), {"anna.npz", "ben.npz"}); });
const Registered snapshot_capture_target("snapshot-capture", "a/",
                                  [](const InputFile& folder) { read_capture(folder.path(), {}); });
const Registered easymocap_capture_target("easymocap-capture", "a/",
                                   [](const InputFile& folder) { read_capture(folder.path(), {}); });

const Registered gala_capture_target("gala-capture", "a/", [](const InputFile& folder) {
    cpu::Serial backend;
    std::vector<std::string> warnings;
    const AnyCapture any = load_any_capture(backend, folder.path() / "scene", nullptr, {}, &warnings);
    must(any.rig.has_value(), "a scene has no body of its own");
    use(any.capture, any.rig->body);
    for (const Motion& motion : any.people) use(motion, any.rig->body);
    check_warnings(warnings);
});

} // namespace

} // namespace gsh::fuzz
