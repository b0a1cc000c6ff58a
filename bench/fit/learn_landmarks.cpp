// SPDX-License-Identifier: Apache-2.0
/// @file  learn_landmarks: prints the rows of body/landmark_table.hpp, learned from captures with known poses.
///
/// learn_landmarks BODY.npz CAPTURE KEYPOINTS.json [BODY.npz CAPTURE KEYPOINTS.json …]. Each capture shows one person;
/// the keypoints are those that a detector found in its images. Rows that no keypoint shows are printed as they are.
#include <gsh/body/landmarks.hpp>
#include <gsh/fit/landmark_places.hpp>
#include <gsh/io/body/body_file.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/capture/keypoints_file.hpp>
#include <gsh/io/motion/motion_file.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

using namespace gsh;

int main(int argc, char** argv) {
    if (argc < 4 || argc % 3 != 1) {
        std::fprintf(stderr, "expected BODY.npz CAPTURE KEYPOINTS.json, once or several times\n");
        return 2;
    }
    try {
        LandmarkSightings sightings;
        for (int i = 1; i < argc; i += 3) {
            const BodyModel body = load_body_model(argv[i]);
            const std::filesystem::path capture = argv[i + 1];
            const CameraList list = read_cameras(capture / "cameras.json");
            const Motion motion = load_motion(capture / "poses.npz", body);
            std::vector<Camera<double>> cameras;
            for (const NamedCamera& camera : list.cameras) cameras.push_back(camera.camera);
            sightings.add(body, motion, cameras, load_keypoints(argv[i + 2], list.cameras, motion.frame_count()));
        }
        for (std::size_t row = 0; row < landmark_places.size(); ++row) {
            const LandmarkPlace& place = landmark_places[row];
            const LandmarkSightings::Place found = sightings.place(row);
            double offset[3] = {place.offset_mm[0], place.offset_mm[1], place.offset_mm[2]}, spread = place.spread_mm;
            if (found.count >= 8) {
                for (int k = 0; k < 3; ++k) offset[k] = std::round(1e3 * found.offset[k]);
                if (!place.sided) offset[0] = 0;
                // Detections err alike in neighbouring frames, so a small spread must not count fully.
                spread = std::round(std::clamp(1e3 * found.spread, place.name.starts_with("face_") ? 6.0 : 8.0, 60.0));
            }
            std::printf("    {\"%s\", %d, %s, {%.0f, %.0f, %.0f}, %.0f}, // %zu\n", std::string(place.name).c_str(),
                        place.joint, place.sided ? "true" : "false", offset[0], offset[1], offset[2], spread,
                        found.count);
        }
    } catch (const std::exception& error) {
        std::fprintf(stderr, "learn_landmarks: %s\n", error.what());
        return 2;
    }
    return 0;
}
