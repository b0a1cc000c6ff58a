// SPDX-License-Identifier: Apache-2.0
/// @file  Reads EasyMocap's results: bodies as JSON, a list of people per frame; calibration as OpenCV's YAML.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/camera_file.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/opencv_yaml.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>
#include <gsh/io/motion/smplx_json_file.hpp>
#include <gsh/math/affine.hpp>
#include <gsh/math/rotation.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace gsh {

/// Reads FOLDER/NUMBER.json, each a list of people (or {"annots": list}) with id, Rh [3], Th [3], poses, shapes [10],
/// and optionally expression, handl, handr. options.person is the id; it is not needed if there is only one person.
///
/// poses holds 72 numbers (SMPL), 69 (without the root), 78 (SMPL+H: 66, then 6 principal components per hand), 87
/// (SMPL-X: 66, two hands of 6, then jaw and eyes), 156 or 165 (all joints). Principal components are relative to the
/// mean hand; hands given by all joints are not.
///
/// Frame   EasyMocap rotates the posed body about the origin, x = Rh body + Th. The SMPL family rotates it about the
///         root's rest position J₀. Hence transl = Th + Rh J₀ - J₀, with J₀ of this body, shape and expression.
/// Units   timestamps are NUMBER / fps (30 by default).
/// Errors  IoError, ShapeError, ValueError naming file and field; also for a person who is missing in a frame.
[[nodiscard]] inline Motion load_easymocap_motion(const std::filesystem::path& folder, const BodyModel& model,
                                                  const MotionFileOptions& options = {},
                                                  std::vector<std::string>* warnings = nullptr);

/// Reads FOLDER/intri.yml (K_NAME, dist_NAME or D_NAME; H_NAME, W_NAME) and FOLDER/extri.yml (Rot_NAME or R_NAME,
/// T_NAME), for each of intri.yml's `names`. If a file does not give the image's size, width and height are 0 and must
/// be set from the images.
///
/// Units   EasyMocap's T has the unit of its calibration board, usually metres. The origin of its pixel coordinates is
///         the centre of the first pixel, ours is the image's corner. Half a pixel is therefore added to the principal
///         point.
/// Errors  IoError for a file that is missing or lacks an entry; ValueError for an invalid camera.
[[nodiscard]] inline CameraList read_easymocap_cameras(const std::filesystem::path& folder);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// A person of one frame.
struct EasyMocapPerson {
    std::vector<double> Rh, Th, poses, shapes, expression, handl, handr;
};

inline EasyMocapPerson read_easymocap_person(const std::filesystem::path& path, int person) {
    const Json json = read_json(path);
    const Json& list = json.is_array() ? json : JsonObject(json, path.string()).at("annots");
    if (!list.is_array() || list.empty()) throw IoError(path.string() + ": holds no list of people");
    std::string known;
    for (std::size_t i = 0; i < list.size(); ++i) {
        const JsonObject object(list[i], path.string() + ": [" + std::to_string(i) + "]");
        const int id = object.has("id")         ? object.integer("id")
                       : object.has("personID") ? object.integer("personID")
                                                : static_cast<int>(i);
        known += (i ? ", " : "") + std::to_string(id);
        if (id != person && list.size() > 1) continue;
        const auto optional = [&](const char* field) {
            return object.has(field) ? object.numbers(field) : std::vector<double>();
        };
        return {optional("Rh"),         object.numbers("Th", 3), object.numbers("poses"), object.numbers("shapes"),
                optional("expression"), optional("handl"),       optional("handr")};
    }
    throw IoError(path.string() + ": person " + std::to_string(person) + " is missing, there are " + known +
                  "; choose a person who is in every frame, or leave out the other frames");
}

} // namespace detail

inline Motion load_easymocap_motion(const std::filesystem::path& folder, const BodyModel& model,
                                    const MotionFileOptions& options, std::vector<std::string>* warnings) {
    const auto files = detail::list_numbered(folder, ".json");
    if (files.empty()) throw IoError(folder.string() + ": holds no files NUMBER.json, expected one per frame");
    const double fps = options.fps > 0 ? options.fps : 30;
    const std::size_t T = files.size();
    std::map<std::string, std::pair<std::vector<double>, std::size_t>> columns; // data, width
    std::vector<double> timestamps, Rh, Th, shapes;
    std::size_t width = 0, shape_count = 0;
    bool whole_hands = false;
    for (std::size_t t = 0; t < T; ++t) {
        const std::string where = files[t].path.string();
        const detail::EasyMocapPerson p = detail::read_easymocap_person(files[t].path, options.person);
        if (t == 0) width = p.poses.size(), shape_count = p.shapes.size();
        const auto expect = [&](const char* field, std::size_t found, std::size_t expected) {
            if (found != expected)
                throw ShapeError(where + ": " + field + " has " + std::to_string(found) + " numbers, expected " +
                                 std::to_string(expected) + " as in the first frame");
        };
        expect("poses", p.poses.size(), width);
        expect("shapes", p.shapes.size(), shape_count);
        const auto put = [&](const char* key, const std::vector<double>& from, std::size_t first, std::size_t count) {
            auto& column = columns[key];
            column.first.insert(column.first.end(), from.begin() + static_cast<std::ptrdiff_t>(first),
                                from.begin() + static_cast<std::ptrdiff_t>(first + count));
            column.second = count;
        };
        // Newer versions omit the root: 69, 63, …
        const bool rooted = width == 72 || width == 66 || width == 78 || width == 87 || width == 156 || width == 165;
        const std::size_t body = rooted ? 3 : 0;
        const std::vector<double> no_turn(3, 0.0);
        put("global_orient", rooted ? p.poses : no_turn, 0, 3);
        if (width == 72 || width == 69) {
            put("body_pose", p.poses, body, 69);
        } else if (width == 66 || width == 63 || width == 78 || width == 87 || width == 156 || width == 165) {
            put("body_pose", p.poses, body, 63);
            if (width == 78 || width == 87)
                put("left_hand_pose", p.poses, 66, 6), put("right_hand_pose", p.poses, 72, 6);
            if (width == 87)
                put("jaw_pose", p.poses, 78, 3), put("leye_pose", p.poses, 81, 3), put("reye_pose", p.poses, 84, 3);
            if (width == 165)
                put("jaw_pose", p.poses, 66, 3), put("leye_pose", p.poses, 69, 3), put("reye_pose", p.poses, 72, 3);
            if (width >= 156)
                put("left_hand_pose", p.poses, width - 90, 45), put("right_hand_pose", p.poses, width - 45, 45);
            whole_hands = width >= 156;
        } else {
            throw ShapeError(where + ": poses has " + std::to_string(width) +
                             " numbers, expected 72 or 69 (SMPL), 78 (SMPL+H), 87 (SMPL-X), 66, 63, 156 or 165");
        }
        for (const auto& [key, field, data] :
             {std::tuple("left_hand_pose", "handl", &p.handl), std::tuple("right_hand_pose", "handr", &p.handr),
              std::tuple("expression", "expression", &p.expression)}) {
            const bool before = t > 0 && columns.count(key) > 0;
            if (data->empty() && !before) continue;
            if (t > 0) expect(field, data->size(), before ? columns[key].second : 0);
            if (!data->empty()) put(key, *data, 0, data->size());
        }
        const std::vector<double>& turn = p.Rh.empty() ? no_turn : p.Rh;
        if (turn.size() != 3)
            throw ShapeError(where + ": Rh has " + std::to_string(turn.size()) + " numbers, expected 3");
        Rh.insert(Rh.end(), turn.begin(), turn.end());
        Th.insert(Th.end(), p.Th.begin(), p.Th.end());
        shapes.insert(shapes.end(), p.shapes.begin(), p.shapes.end());
        timestamps.push_back(static_cast<double>(files[t].number) / fps);
    }

    MotionTable table(folder);
    for (auto& [key, column] : columns) table.add(key, key, std::move(column.first), {T, column.second});
    table.add("transl", "Th", std::vector<double>(3 * T, 0.0), {T, 3});
    table.add("betas", "shapes", std::move(shapes), {T, shape_count});
    table.add("timestamps", "timestamps", std::move(timestamps), {T});
    table.add("flat_hand", "flat_hand", std::vector<double>{whole_hands ? 1.0 : 0.0}, {});
    MotionFileOptions as_stored = options;
    as_stored.world = MotionFileOptions::World::as_stored; // the change of world follows move_frame
    Motion motion = detail::MotionReader<MotionTable>(std::move(table), model, as_stored, warnings).read();
    for (std::size_t t = 0; t < T; ++t)
        move_frame(model, motion, t,
                   {rotation_from_axis_angle(vec3<double>(Rh[3 * t], Rh[3 * t + 1], Rh[3 * t + 2])),
                    vec3<double>(Th[3 * t], Th[3 * t + 1], Th[3 * t + 2])});
    if (options.world == MotionFileOptions::World::upright) stand_upright(model, motion);
    return motion;
}

inline CameraList read_easymocap_cameras(const std::filesystem::path& folder) {
    const OpenCvYaml intrinsics(folder / "intri.yml"), extrinsics(folder / "extri.yml");
    CameraList list;
    for (const std::string& name : intrinsics.texts("names")) {
        NamedCamera named;
        named.name = name;
        Camera<double>& camera = named.camera;
        std::vector<double> K = intrinsics.matrix("K_" + name, 9);
        K[2] += 0.5, K[5] += 0.5;
        if (intrinsics.has("W_" + name) && intrinsics.has("H_" + name)) {
            const double width = intrinsics.number("W_" + name), height = intrinsics.number("H_" + name);
            check_value(width >= 1 && height >= 1 && width <= 65535 && height <= 65535, intrinsics.name_of("W_" + name),
                        "and H_ are " + std::to_string(width) + " x " + std::to_string(height) + ", expected pixels");
            camera.width = static_cast<int>(width), camera.height = static_cast<int>(height);
        }
        mat3<double> R;
        if (extrinsics.has("Rot_" + name)) {
            const std::vector<double> m = extrinsics.matrix("Rot_" + name, 9);
            R = mat3<double>(vec3<double>(m[0], m[3], m[6]), vec3<double>(m[1], m[4], m[7]),
                             vec3<double>(m[2], m[5], m[8]));
        } else {
            const std::vector<double> v = extrinsics.matrix("R_" + name, 3);
            R = rotation_from_axis_angle(vec3<double>(v[0], v[1], v[2]));
        }
        const std::vector<double> t = extrinsics.matrix("T_" + name, 3);
        // The size may be set later from the images; the check accepts any positive size.
        const int width = camera.width, height = camera.height;
        camera = camera_from_K<double>(K, R, vec3<double>(t[0], t[1], t[2]), width > 0 ? width : 1,
                                       height > 0 ? height : 1, folder.string() + ": " + name);
        camera.width = width, camera.height = height;
        std::vector<double> d;
        for (const char* prefix : {"dist_", "D_"})
            if (d.empty() && intrinsics.has(prefix + name)) d = intrinsics.matrix(prefix + name, 0);
        if (!d.empty() && d.size() != 4 && d.size() != 5)
            throw ShapeError(intrinsics.name_of("dist_" + name) + " has " + std::to_string(d.size()) +
                             " numbers, expected k1, k2, p1, p2, k3");
        d.resize(5, 0.0);
        if (std::any_of(d.begin(), d.end(), [](double value) { return value != 0; }))
            named.distortion = Distortion<double>{d[0], d[1], d[2], d[3], d[4]};
        list.cameras.push_back(std::move(named));
    }
    if (list.cameras.empty()) throw IoError(intrinsics.name_of("names") + " lists no camera");
    return list;
}

} // namespace gsh
