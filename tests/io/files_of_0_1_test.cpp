// SPDX-License-Identifier: Apache-2.0
/// @file  Files that gsh 0.1.0 wrote, which every later version opens (docs/versions.md), with all their numbers.
///
/// The files of tests/data/0.1 were written once, by the first test case, with GSH_WRITE_FILES=tests/data/0.1. They are
/// never written again. What they hold is said here in formulas of numbers that are exact in binary.
#include <gsh/cpu.hpp>
#include <gsh/io/body/region_file.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/detections.hpp>
#include <gsh/io/capture/prior_views_file.hpp>
#include <gsh/io/file/archive.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/image/image_file.hpp>
#include <gsh/io/model/avatar_file.hpp>
#include <gsh/io/model/configuration_file.hpp>
#include <gsh/io/motion/any_motion.hpp>
#include <gsh/io/motion/joint_map_file.hpp>
#include <gsh/io/splat/ply.hpp>
#include <gsh/render/rasterizer.hpp>

#include "io/temporary.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

using namespace gsh;

namespace {

const std::filesystem::path files_of_0_1 = std::filesystem::path(GSH_SOURCE_DIR) / "tests/data/0.1";

/// Numbers in [-1, 1) that are multiples of 1 / 32, different for each `what`.
double kept_number(std::size_t i, std::size_t what) {
    return static_cast<double>((i * 37 + what * 11) % 64) / 32 - 1;
}
vec3<double> kept_vector(std::size_t i, std::size_t what) {
    return {kept_number(3 * i, what), kept_number(3 * i + 1, what), kept_number(3 * i + 2, what)};
}
template <class T>
std::vector<T> kept_numbers(std::size_t count, std::size_t what) {
    std::vector<T> numbers;
    for (std::size_t i = 0; i < count; ++i) numbers.push_back(static_cast<T>(kept_number(i, what)));
    return numbers;
}
std::vector<vec3<double>> kept_vectors(std::size_t count, std::size_t what, double scale = 1) {
    std::vector<vec3<double>> vectors;
    for (std::size_t i = 0; i < count; ++i) vectors.push_back(scale * kept_vector(i, what));
    return vectors;
}

/// A column of `joints` joints, half a metre apart, with everything that a body file may hold: a square one of 3 joints
/// with pose directions, or a line of a vertex for each joint with hands.
BodyModel kept_body(std::size_t joints) {
    BodyModel body;
    const double corners[4][2] = {{0.25, 0.25}, {-0.25, 0.25}, {-0.25, -0.25}, {0.25, -0.25}};
    const std::size_t sides = joints == 3 ? 4 : 1;
    for (std::size_t j = 0; j < joints; ++j)
        for (std::size_t s = 0; s < sides; ++s) {
            body.v_template.emplace_back(corners[s][0], 0.5 * static_cast<double>(j), corners[s][1]);
            body.vt.emplace_back(corners[s][0], corners[s][1]);
        }
    const std::size_t V = body.vertex_count();
    const auto at = [&](std::size_t ring, std::size_t side) { return static_cast<int>(sides * ring + side % sides); };
    for (std::size_t j = 0; j + 2 < joints || (sides > 1 && j + 1 < joints); ++j)
        if (sides == 1) {
            body.faces.push_back({at(j, 0), at(j + 1, 0), at(j + 2, 0)});
        } else {
            for (std::size_t s = 0; s < sides; ++s) {
                body.faces.push_back({at(j, s), at(j + 1, s + 1), at(j, s + 1)});
                body.faces.push_back({at(j, s), at(j + 1, s), at(j + 1, s + 1)});
            }
        }
    body.ft = body.faces;
    body.weights.assign(V * joints, 0.0);
    for (std::size_t v = 0; v < V; ++v) {
        body.weights[v * joints + v / sides] += 0.75;
        body.weights[v * joints + (v / sides + 1) % joints] += 0.25;
    }
    for (std::size_t j = 0; j < joints; ++j) {
        body.parents.push_back(static_cast<int>(j) - 1);
        const int first = at(j, 0), other = (first + 2) % static_cast<int>(V);
        body.J_regressor.push_back({{std::min(first, other), 0.5}, {std::max(first, other), 0.5}});
        body.joint_names.push_back("joint " + std::to_string(j));
    }
    body.shape_count = 2, body.expression_count = 1;
    body.shapedirs = kept_vectors(2 * V, 1, 0.0625), body.exprdirs = kept_vectors(V, 2, 0.0625);
    body.face_vertices = {0, 1}, body.left_hand_vertices = {2}, body.right_hand_vertices = {3};
    if (joints != 3) {
        body.hands_mean_left = kept_vectors(15, 3), body.hands_mean_right = kept_vectors(15, 4);
        body.hands_components_left = kept_numbers<double>(45, 5);
        body.hands_components_right = kept_numbers<double>(45, 6);
    } else {
        body.posedirs = kept_vectors(V * body.pose_feature_count(), 7, 0.0625);
    }
    return body;
}

Motion kept_motion(const BodyModel& body) {
    Motion motion;
    constexpr std::size_t frames = 2;
    motion.joint_count = body.joint_count(), motion.expression_count = 1;
    motion.betas = {0.5, -0.25};
    motion.pose = kept_vectors(frames * body.joint_count(), 8, 0.25);
    motion.expression = {0.5, -1};
    motion.transl = {{0, 0.25, 0}, {0.125, 0.25, -0.5}};
    motion.timestamps = {0, 0.25};
    return motion;
}

/// Gaussians on the column, lit: all that the configuration "light" stores. Without light, what "paper" stores.
AvatarData kept_avatar(bool lit) {
    AvatarData avatar;
    RigData& rig = avatar.rig;
    rig.body = kept_body(3);
    rig.betas = {0.5, -0.25};
    rig.joints = regress_joints(rig.body, shaped_vertices(rig.body, rig.betas));
    const std::size_t N = 12;
    rig.skin.influences = 2;
    avatar.gaussians = GaussianCloud<float>(N, 1);
    GaussianCloud<float>& g = avatar.gaussians;
    for (std::size_t i = 0; i < N; ++i) {
        rig.triangles.push_back(rig.body.faces[i]);
        rig.barycentric.push_back({0.25, 0.25, 0.5});
        const auto& [a, b, c] = rig.triangles[i];
        const auto corner = [&](int v) { return rig.body.v_template[static_cast<std::size_t>(v)]; };
        g.means[i] = vec3<float>(0.25 * corner(a) + 0.25 * corner(b) + 0.5 * corner(c));
        const auto joint = static_cast<std::uint16_t>(i % 3);
        for (const int next : {0, 1}) rig.skin.joints.push_back(static_cast<std::uint16_t>((joint + next) % 3));
        rig.skin.weights.insert(rig.skin.weights.end(), {0.75, 0.25});
        g.quats[i] = {1, static_cast<float>(kept_number(i, 9)), 0, 0.5f};
        g.log_scales[i] = vec3<float>(-2.5, -2, -3) + 0.25f * vec3<float>(kept_vector(i, 10));
        g.opacity_logits[i] = 1 + static_cast<float>(kept_number(i, 11));
        for (std::size_t k = 0; k < 4; ++k)
            g.sh[4 * i + k] = (k == 0 ? 1.0f : 0.25f) * vec3<float>(kept_vector(4 * i + k, 12));
    }
    avatar.filter = {.dilation = 0.25, .compensate_opacity = true};
    if (lit) {
        avatar.clamping = ColorClamp::both;
        avatar.deformation = Deformation::polar;
        avatar.light = LightData{.points = {{1, 3, 2}},
                                 .directions = {{0, 1, 0}},
                                 .log_intensities = {0.5, -0.25},
                                 .gloss = {-2, 1},
                                 .shadows = false};
        avatar.light_place = {
            .upright = mat3<double>({0, 1, 0}, {-1, 0, 0}, {0, 0, 1}), .low = {-1, 0, -1}, .high = {1, 2, 1}};
        for (std::size_t v = 0; v < rig.body.vertex_count(); ++v)
            avatar.normal_offsets.push_back(0.125f * vec3<float>(kept_vector(v, 13)));
        for (const float number : kept_numbers<float>(N, 14)) avatar.mean_irradiance.push_back(1 + number / 2);
    } else {
        avatar.clamping = ColorClamp::below;
        for (const float number : kept_numbers<float>(N, 15)) avatar.ao.push_back(0.75f + number / 8);
        OcclusionFieldData field{.neurons = kept_numbers<float>(N * 2, 16),
                                 .pose_weights = kept_numbers<float>(2 * 18, 17),
                                 .width = 2,
                                 .hidden_layers = 2,
                                 .bias = 0.5,
                                 .largest = 1.25};
        field.weights = kept_numbers<float>(field.network().parameter_count(), 18);
        avatar.occlusion_field = field;
    }
    return avatar;
}

CameraList kept_cameras() {
    CameraList list{.cameras = {}, .fps = 4, .floor_y = -0.5, .test_frames = {1}};
    NamedCamera front{.name = "front", .role = NamedCamera::Role::train, .camera = {}, .distortion = {}};
    front.camera = look_at<double>({0, 0.5, 4}, {0, 0.5, 0}, {0, 1, 0}, 0.5, 24, 32);
    NamedCamera side = front;
    side.name = "side", side.role = NamedCamera::Role::test;
    side.camera = look_at<double>({4, 0.5, 0}, {0, 0.5, 0}, {0, 1, 0}, 0.5, 24, 32);
    side.distortion = Distortion<double>{0.125, -0.0625, 0.001, 0.002, 0};
    list.cameras = {front, side};
    return list;
}

PixelImage kept_photograph(std::size_t number) {
    PixelImage image(4, 32, 24);
    for (std::size_t i = 0; i < image.data.size(); ++i)
        image.data[i] = static_cast<std::uint8_t>(i % 4 == 3 ? (i / 4 % 24 < 12 ? 255 : 0) : (i * 7 + number) % 256);
    return image;
}

/// A picture of frame 1, as gsh-animate draws it: 0 to 1, [3, 32, 24].
Image<float> picture_of(const AvatarData& data) {
    cpu::Serial backend;
    Avatar<cpu::Serial> avatar(backend, data);
    Avatar<cpu::Serial>::Cache posing;
    RigPose<cpu::Serial, float> pose;
    avatar.rig().upload_pose(kept_motion(data.rig.body), 1, pose);
    Splats<cpu::Serial, float> splats;
    splats.resize(avatar.size());
    const auto camera = look_at<float>({1, 1, 1.75f}, {0.25f, 0.75f, -0.5f}, {0, 1, 0}, 0.7f, 24, 32);
    avatar.pose(pose, camera.center(), splats.view(), posing);
    Image<float> picture(3, 32, 24);
    Rasterizer<cpu::Serial>::Cache drawing;
    Rasterizer<cpu::Serial>(backend, raster_params<float>(data.filter))
        .forward(camera, splats.view(), {.color = vec3<float>(0.5f)}, {.color = picture.view()}, drawing);
    return picture;
}

/// The largest difference of a picture from one of 8 bits in a file, in steps of 8 bits.
double difference(const Image<float>& picture, const std::filesystem::path& path) {
    const PixelImage kept = read_image(path);
    double largest = 0;
    REQUIRE((kept.height == 32 && kept.width == 24));
    for (int y = 0; y < kept.height; ++y)
        for (int x = 0; x < kept.width; ++x)
            for (int c = 0; c < 3; ++c)
                largest = std::max(largest,
                                   std::abs(255.0 * std::clamp(picture.at(c, y, x), 0.0f, 1.0f) - kept.pixel(y, x)[c]));
    return largest;
}

void check_body(const BodyModel& found, const BodyModel& expected) {
    CHECK(found.v_template == expected.v_template);
    CHECK(found.shapedirs == expected.shapedirs);
    CHECK(found.exprdirs == expected.exprdirs);
    CHECK(found.posedirs == expected.posedirs);
    CHECK(found.weights == expected.weights);
    CHECK(found.parents == expected.parents);
    CHECK(found.faces == expected.faces);
    CHECK(found.shape_count == 2);
    CHECK(found.expression_count == 1);
    CHECK(found.vt == expected.vt);
    CHECK(found.ft == expected.ft);
    CHECK(found.joint_names == expected.joint_names);
    CHECK(found.hands_mean_left == expected.hands_mean_left);
    CHECK(found.hands_mean_right == expected.hands_mean_right);
    CHECK(found.hands_components_left == expected.hands_components_left);
    CHECK(found.hands_components_right == expected.hands_components_right);
    CHECK(found.face_vertices == expected.face_vertices);
    CHECK(found.left_hand_vertices == expected.left_hand_vertices);
    CHECK(found.right_hand_vertices == expected.right_hand_vertices);
    for (std::size_t j = 0; j < expected.joint_count(); ++j) {
        CHECK(found.J_regressor[j].size() == 2);
        CHECK(found.J_regressor[j][1].vertex == expected.J_regressor[j][1].vertex);
        CHECK(found.J_regressor[j][1].weight == 0.5);
    }
}

void check_motion(const Motion& found, const Motion& expected) {
    CHECK(found.joint_count == expected.joint_count);
    CHECK(found.betas == expected.betas);
    CHECK(found.pose == expected.pose);
    CHECK(found.expression == expected.expression);
    CHECK(found.transl == expected.transl);
    CHECK(found.timestamps == expected.timestamps);
}

void check_avatar_of_0_1(const AvatarData& found, const AvatarData& expected) {
    check_body(found.rig.body, expected.rig.body);
    CHECK(found.rig.betas == expected.rig.betas);
    CHECK(found.rig.joints == expected.rig.joints);
    CHECK(found.rig.triangles == expected.rig.triangles);
    CHECK(found.rig.barycentric == expected.rig.barycentric);
    CHECK(found.rig.skin.joints == expected.rig.skin.joints);
    CHECK(found.rig.skin.weights == expected.rig.skin.weights);
    CHECK(found.gaussians.means == expected.gaussians.means);
    CHECK(std::ranges::equal(found.gaussians.quats, expected.gaussians.quats, [](const auto& a, const auto& b) {
        return a.w == b.w && a.x == b.x && a.y == b.y && a.z == b.z;
    }));
    CHECK(found.gaussians.log_scales == expected.gaussians.log_scales);
    CHECK(found.gaussians.opacity_logits == expected.gaussians.opacity_logits);
    CHECK(found.gaussians.sh == expected.gaussians.sh);
    CHECK(found.gaussians.sh_degree == 1);
    CHECK(found.clamping == expected.clamping);
    CHECK(found.deformation == expected.deformation);
    CHECK(found.filter.dilation == 0.25);
    CHECK(found.filter.compensate_opacity);
    CHECK(found.ao == expected.ao);
    CHECK(found.normal_offsets == expected.normal_offsets);
    CHECK(found.mean_irradiance == expected.mean_irradiance);
    REQUIRE(found.light.has_value() == expected.light.has_value());
    if (expected.light) {
        CHECK(found.light->points == expected.light->points);
        CHECK(found.light->directions == expected.light->directions);
        CHECK(found.light->log_intensities == expected.light->log_intensities);
        CHECK(found.light->gloss == expected.light->gloss);
        CHECK(!found.light->shadows);
        CHECK(found.light_place.low == expected.light_place.low);
        CHECK(found.light_place.high == expected.light_place.high);
        CHECK(found.light_place.upright == expected.light_place.upright);
    }
    REQUIRE(found.occlusion_field.has_value() == expected.occlusion_field.has_value());
    if (expected.occlusion_field) {
        CHECK(found.occlusion_field->neurons == expected.occlusion_field->neurons);
        CHECK(found.occlusion_field->pose_weights == expected.occlusion_field->pose_weights);
        CHECK(found.occlusion_field->weights == expected.occlusion_field->weights);
        CHECK(found.occlusion_field->hidden_layers == 2);
        CHECK(found.occlusion_field->bias == 0.5);
        CHECK(found.occlusion_field->largest == 1.25);
    }
}

void write_line(const std::filesystem::path& path, const std::string& text) {
    write_file(path, text + "\n");
}

void write_files_of_0_1(const std::filesystem::path& to) {
    for (const char* folder : {"priors", "detections/masks/front"}) std::filesystem::create_directories(to / folder);
    save_body_model(to / "body.npz", kept_body(24)); // a small file
    save_motion(to / "motion.npz", kept_motion(kept_body(55)));
    save_motion(to / "motion_whole.npz", kept_motion(kept_body(3)));
    save_avatar(to / "avatar.gsh", kept_avatar(true));
    save_avatar(to / "avatar_paper.gsh", kept_avatar(false));
    save_avatar(to / "avatar_compact.gsh", kept_avatar(true), ArrayStorage::compact);
    save_avatar(to / "avatar_paper_compact.gsh", kept_avatar(false), ArrayStorage::compact);
    for (const bool lit : {true, false})
        write_png(to / (lit ? "picture.png" : "picture_paper.png"), quantise(picture_of(kept_avatar(lit)).view()));
    write_gaussian_ply(to / "scene.ply", kept_avatar(true).gaussians,
                       {.up = UpAxis::minus_y, .filter = kept_avatar(true).filter});

    Capture capture;
    const CameraList cameras = kept_cameras();
    capture.cameras = cameras.cameras, capture.test_frames = cameras.test_frames;
    capture.fps = cameras.fps, capture.floor_y = cameras.floor_y;
    capture.motion = kept_motion(kept_body(55));
    for (std::size_t i = 0; i < 4; ++i) capture.images.push_back(kept_photograph(i));
    save_capture(to / "capture", capture);
    write_camera(to / "camera.json", cameras.cameras[1]);
    PixelImage normals(3, 32, 24), mask(1, 32, 24);
    for (std::size_t i = 0; i < normals.data.size(); ++i) normals.data[i] = i % 3 == 2 ? 255 : 128; // to the viewer
    for (std::size_t i = 0; i < mask.data.size(); ++i) mask.data[i] = i % 24 < 12 ? 255 : 0;
    write_png(to / "priors/normals.png", normals);
    write_png(to / "priors/mask.png", mask);
    write_npy<float>(to / "priors/depth.npy", std::vector<float>(32 * 24, 2.5f), {32, 24});
    write_line(to / "priors/priors.json", R"({"views": [
  {"normals": "normals.png", "encoding": "y_up", "facing": "viewer", "mask": "mask.png", "camera": "front",
   "frame": 1},
  {"depth": "depth.npy", "camera": {"width": 24, "height": 32, "scale": 8, "cx": 12, "cy": 16,
   "R": [[1, 0, 0], [0, -1, 0], [0, 0, -1]], "t": [0, 0.5, 4]}, "frame": "canonical", "person": 0}]})");

    write_line(to / "settings.json", R"({"configuration": "paper", "rate.sh": 0.001, "hash_sh": false})");
    write_line(to / "settings_static.json", R"({"configuration": "static", "sh_degree": 1})");
    write_line(to / "regions.json",
               R"({"face_vertices": [0, 5], "left_hand_vertices": [2], "right_hand_vertices": [3],
 "high": [0, 2, 3, 5]})");
    write_line(to / "joint_map.json", R"({"Bip_LeftArm_01": "left_shoulder", "Bip_Prop": null})");

    nlohmann::ordered_json pose = nlohmann::ordered_json::array(), world = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < 33; ++k) {
        pose.insert(pose.end(), {10 + 0.25 * double(k), 12 + 0.5 * double(k), 0.75});
        world.insert(world.end(), {0.125 * double(k), 0.25, -0.5});
    }
    const nlohmann::ordered_json keypoints{
        {"images", {{{"id", 0}, {"file_name", "front/0000.png"}}, {{"id", 1}, {"file_name", "front/0001.png"}}}},
        {"annotations", {{{"image_id", 1}, {"mediapipe_pose", pose}, {"mediapipe_world", world}}}}};
    write_line(to / "detections/keypoints.json", keypoints.dump());
    write_line(to / "detections/video.json",
               R"({"fps": 4, "cameras": [
 {"name": "front", "width": 24, "height": 32, "focal": 40, "times": [0, 0.25]}]})");
    for (const char* name : {"0000.png", "0001.png"}) write_png(to / "detections/masks/front" / name, mask);
}

} // namespace

TEST_CASE("files of this version are written where a variable asks for it") {
    if (const char* to = std::getenv("GSH_WRITE_FILES")) write_files_of_0_1(to);
    CHECK(std::filesystem::exists(files_of_0_1 / "avatar.gsh"));
}

TEST_CASE("a body and motions of 0.1 open") {
    check_body(load_body_model(files_of_0_1 / "body.npz"), kept_body(24));
    const BodyModel body = kept_body(55);
    std::vector<std::string> warnings;
    check_motion(load_any_motion(files_of_0_1 / "motion.npz", body, {}, &warnings), kept_motion(body));
    check_motion(load_any_motion(files_of_0_1 / "motion_whole.npz", kept_body(3)), kept_motion(kept_body(3)));
    for (const std::string& warning : warnings) CHECK_MESSAGE(warning.find("mean hand") != std::string::npos, warning);
}

TEST_CASE("avatars of 0.1 open, and look as they did") {
    for (const bool lit : {true, false}) {
        CAPTURE(lit);
        const std::string name = lit ? "avatar" : "avatar_paper", shown = lit ? "picture.png" : "picture_paper.png";
        const AvatarData exact = load_avatar(files_of_0_1 / (name + ".gsh")),
                         compact = load_avatar(files_of_0_1 / (name + "_compact.gsh"));
        check_avatar_of_0_1(exact, kept_avatar(lit));
        CHECK(difference(picture_of(exact), files_of_0_1 / shown) < 1);
        CHECK(difference(picture_of(compact), files_of_0_1 / shown) < 6);
        CHECK(compact.gaussians.size() == 12);
        for (std::size_t i = 0; i < 12; ++i) {
            CHECK(length(compact.gaussians.means[i] - exact.gaussians.means[i]) < 1e-4);
            CHECK(std::abs(compact.gaussians.opacity_logits[i] - exact.gaussians.opacity_logits[i]) < 0.04);
        }
        CHECK(compact.light.has_value() == lit);
        CHECK(compact.occlusion_field.has_value() == !lit);
    }
}

TEST_CASE("a capture, cameras and priors of 0.1 open") {
    cpu::Serial backend;
    const Capture capture = load_capture(backend, files_of_0_1 / "capture", kept_body(55));
    const CameraList cameras = kept_cameras();
    REQUIRE(capture.cameras.size() == 2);
    for (std::size_t c = 0; c < 2; ++c) {
        const Camera<double>&found = capture.cameras[c].camera, &expected = cameras.cameras[c].camera;
        CHECK(capture.cameras[c].name == cameras.cameras[c].name);
        CHECK(capture.cameras[c].role == cameras.cameras[c].role);
        CHECK((found.width == 24 && found.height == 32));
        CHECK((found.fx == expected.fx && found.fy == expected.fy));
        CHECK((found.cx == expected.cx && found.cy == expected.cy));
        CHECK(found.R == expected.R);
        CHECK(found.t == expected.t);
    }
    CHECK(capture.fps == 4);
    CHECK(capture.floor_y == -0.5);
    CHECK(capture.test_frames == std::vector<int>{1});
    check_motion(capture.motion, kept_motion(kept_body(55)));
    for (std::size_t f = 0; f < 2; ++f) CHECK(capture.image({0, f}).data == kept_photograph(f).data);
    const NamedCamera side = read_camera(files_of_0_1 / "camera.json");
    REQUIRE(side.distortion.has_value());
    CHECK(side.name == "side");
    CHECK((side.distortion->k1 == 0.125 && side.distortion->k2 == -0.0625 && side.distortion->p1 == 0.001 &&
           side.distortion->p2 == 0.002 && side.distortion->k3 == 0));

    const auto people = read_prior_views(files_of_0_1 / "priors/priors.json", capture.cameras, 2);
    REQUIRE((people.size() == 1 && people[0].normals.size() == 1 && people[0].depths.size() == 1));
    const EstimatedView &normals = people[0].normals[0], &depth = people[0].depths[0];
    CHECK(normals.frame == 1);
    CHECK(!depth.frame);
    CHECK(normals.view.map.values.at(2, 5, 5) == doctest::Approx(-1).epsilon(0.001)); // towards the camera
    CHECK(normals.view.map.mask.at(0, 5, 11) == 1);
    CHECK(normals.view.map.mask.at(0, 5, 12) == 0);
    CHECK(depth.view.map.values.at(0, 31, 23) == 2.5);
    CHECK(std::get<OrthographicCamera>(depth.view.camera).scale == 8);
}

TEST_CASE("settings, regions and joint maps of 0.1 open") {
    const Configuration settings = read_configuration(files_of_0_1 / "settings.json");
    CHECK(settings.avatar.appearance.sh_rate == 0.001);
    CHECK(!settings.avatar.hash_sh);
    CHECK(settings.avatar.hash_displacement);
    CHECK(is_static_configuration((files_of_0_1 / "settings_static.json").string()));
    CHECK(find_static_configuration((files_of_0_1 / "settings_static.json").string(), 100).sh_degree == 1);
    const RegionLists regions = read_regions(files_of_0_1 / "regions.json", 8);
    CHECK(regions.face == std::vector<int>{0, 5});
    CHECK(regions.left_hand == std::vector<int>{2});
    CHECK(regions.right_hand == std::vector<int>{3});
    CHECK(regions.high == std::vector<int>{0, 2, 3, 5});
    const JointMap map = read_joint_map(files_of_0_1 / "joint_map.json");
    CHECK(map.named.size() == 2);
    CHECK(map.named.at("Bip_LeftArm_01") == "left_shoulder");
    CHECK(map.named.at("Bip_Prop").empty());
}

TEST_CASE("detections of 0.1 open") {
    const Detections found = load_detections(files_of_0_1 / "detections");
    REQUIRE(found.cameras.size() == 1);
    CHECK(found.cameras[0].name == "front");
    CHECK(found.cameras[0].camera.fx == 40);
    CHECK(found.known_focal[0]);
    CHECK(found.times == std::vector<double>{0, 0.25});
    REQUIRE((found.keypoints.size() == 1 && found.keypoints[0].people.size() == 1));
    CHECK(found.keypoints[0].frame == 1);
    const Detection& person = found.keypoints[0].people[0];
    REQUIRE(person.metric.size() == 33);
    CHECK(person.metric[11].landmark == landmark_number("left_shoulder"));
    CHECK(person.metric[11].position == vec3<double>(1.375, 0.25, -0.5));
    const auto shoulder = std::find_if(person.points.begin(), person.points.end(), [](const Keypoint& point) {
        return point.landmark == landmark_number("left_shoulder");
    });
    REQUIRE(shoulder != person.points.end());
    CHECK(shoulder->pixel == vec2<double>(12.75, 17.5));
    CHECK(shoulder->confidence == 0.75);
    const PixelImage mask = load_detected_mask(found, 0, 1);
    CHECK((*mask.pixel(3, 11) == 255 && *mask.pixel(3, 12) == 0));
}

TEST_CASE("a scene of 0.1 opens") {
    const StillSplats scene = read_ply_splats(files_of_0_1 / "scene.ply");
    const GaussianCloud<float> expected = kept_avatar(true).gaussians;
    CHECK(scene.warnings.empty());
    CHECK(scene.notes.up == UpAxis::minus_y);
    REQUIRE(scene.notes.filter.has_value());
    CHECK(scene.notes.filter->dilation == 0.25);
    CHECK(scene.notes.filter->compensate_opacity);
    REQUIRE(scene.cloud.size() == 12);
    for (std::size_t i = 0; i < 12; ++i) {
        CHECK(length(scene.cloud.means[i] - expected.means[i]) < 1e-6f);
        CHECK(length(scene.cloud.log_scales[i] - expected.log_scales[i]) < 1e-6f);
        CHECK(std::abs(scene.cloud.opacity_logits[i] - expected.opacity_logits[i]) < 1e-6f);
        CHECK(length(scene.cloud.sh[16 * i] - expected.sh[4 * i]) < 1e-6f);
        CHECK(length(scene.cloud.sh[16 * i + 3] - expected.sh[4 * i + 3]) < 1e-5f);
    }
}

// What this version does with files of the next one.

TEST_CASE("files of a later version of their kind are refused by both versions") {
    const test::Temporary folder;
    const BodyModel body = kept_body(3);
    /// A file as of 0.1, which states a kind and a version.
    const auto restated = [&](const char* name, const std::string& format) {
        const std::filesystem::path from = files_of_0_1 / name, to = folder / from.filename().string();
        if (from.extension() == ".json") {
            nlohmann::ordered_json json = nlohmann::ordered_json::parse(read_file(from));
            json["gsh_format"] = format;
            write_file(to, json.dump());
        } else {
            NpzWriter file(to);
            file.add_text("gsh_format", format);
            const NpzReader old(from);
            for (const std::string& key : old.keys()) {
                const NpyHeader header = old.header(key);
                if (header.is_text()) continue;
                if (header.dtype.find_first_of("iu") != std::string::npos)
                    file.add(key, old.read<std::int64_t>(key).data, header.shape);
                else
                    file.add(key, old.read<double>(key).data, header.shape);
            }
            file.commit();
        }
        return to;
    };
    struct Kind {
        const char* file;
        const char* kind;
        int version; ///< that this program writes
        std::function<void(const std::filesystem::path&)> read;
        bool reads_restated = true;
    };
    const std::vector<Kind> kinds{
        {"avatar.gsh", "avatar", avatar_file_version, [](const auto& path) { (void)load_avatar(path); }, false},
        {"body.npz", "body", 1, [](const auto& path) { (void)load_body_model(path); }},
        {"motion_whole.npz", "motion", 1, [&](const auto& path) { (void)load_motion(path, body); }},
        {"motion_whole.npz", "motion", 1, [&](const auto& path) { (void)load_any_motion(path, body); }},
        {"capture/cameras.json", "cameras", 1, [](const auto& path) { (void)read_cameras(path); }},
        {"camera.json", "cameras", 1, [](const auto& path) { (void)read_camera(path); }},
        {"settings.json", "settings", 1, [](const auto& path) { (void)read_configuration(path); }},
        {"settings_static.json", "settings", 1,
         [](const auto& path) { (void)find_static_configuration(path.string(), 100); }},
        {"regions.json", "regions", 1, [](const auto& path) { (void)read_regions(path, 8); }},
        {"joint_map.json", "joint_map", 1, [](const auto& path) { (void)read_joint_map(path); }},
        {"priors/priors.json", "priors", 1,
         [](const auto& path) { (void)read_prior_views(path, kept_cameras().cameras, 2); }, false}, // no maps
        {"detections/keypoints.json", "keypoints", 1,
         [](const auto& path) { (void)load_keypoints(path, kept_cameras().cameras, 2); }},
        {"detections/video.json", "video", 1,
         [](const auto& path) { (void)load_detections(path.parent_path()); }}, // behind its keypoints
    };
    for (const Kind& kind : kinds) {
        CAPTURE(kind.file);
        const std::string now = std::string(kind.kind) + " " + std::to_string(kind.version),
                          next = std::string(kind.kind) + " " + std::to_string(kind.version + 1);
        const auto path = restated(kind.file, next);
        test::check_throws<IoError>([&] { kind.read(path); }, {path.string() + ": holds '" + next + "'",
                                                               "'" + now + "'", "later version of gsh"});
        (void)restated(kind.file, "something 1");
        test::check_throws<IoError>([&] { kind.read(path); },
                                    {path.string() + ": holds 'something 1', expected", "'" + now + "'", "that kind"});
        (void)restated(kind.file, now);
        if (kind.reads_restated) CHECK_NOTHROW(kind.read(path));
    }
}
