// SPDX-License-Identifier: Apache-2.0
/// @file  Reads motions from a folder of JSON files, one per frame: ExAvatar's fits and LHM's motions.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/motion/frame_rate.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/motion_table.hpp>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

/// Reads FOLDER/NUMBER.json in the order of the numbers. A file holds root_pose [3], body_pose [21, 3] and trans [3],
/// and optionally jaw_pose, leye_pose, reye_pose [3], lhand_pose, rhand_pose [15, 3], expr [E], betas [S]. All files
/// must have the same optional fields as the first one.
///
/// ExAvatar stores the shape in shape_param.json beside the folder, and its hands are relative to the mean hand. LHM
/// stores betas in every file, and its hands are complete. FOLDER may also be a parent folder: smplx_params_smoothed
/// and smplx_params are searched for in it and in smplx_optimized.
///
/// Frame   the camera's: x right, y down, z forward; options.world = upright makes y point up.
/// Units   timestamps are NUMBER / fps (30 without options.fps, with a warning).
/// Errors  IoError, ShapeError, ValueError naming file and field. ExAvatar's offsets of joints and face are not part of
///         a motion; if they are present, a warning is added.
[[nodiscard]] inline Motion load_smplx_json_motion(const std::filesystem::path& folder, const BodyModel& model,
                                                   const MotionFileOptions& options = {},
                                                   std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

namespace detail {

/// The folder that contains the frames' files, which may be a few levels below `folder`; empty if there is none.
inline std::filesystem::path smplx_json_folder(const std::filesystem::path& folder) {
    std::error_code ignored;
    for (const char* below : {".", "smplx_params_smoothed", "smplx_params", "smplx_optimized/smplx_params_smoothed",
                              "smplx_optimized/smplx_params"}) {
        const std::filesystem::path candidate = std::string_view(below) == "." ? folder : folder / below;
        if (!std::filesystem::is_directory(candidate, ignored)) continue;
        const auto files = list_numbered(candidate, ".json");
        if (!files.empty()) return candidate;
    }
    return {};
}

/// The rows of a field, collected from all files.
struct JsonColumn {
    const char* field;
    const char* key;   ///< its name in SMPL-X programs
    std::size_t width; ///< 0: that of the first file
    bool needed;
    std::vector<double> data = {};
};

} // namespace detail

inline Motion load_smplx_json_motion(const std::filesystem::path& folder, const BodyModel& model,
                                     const MotionFileOptions& options, std::vector<std::string>* warnings) {
    const std::filesystem::path place = detail::smplx_json_folder(folder);
    if (place.empty()) throw IoError(folder.string() + ": holds no files NUMBER.json, expected one per frame");
    const auto files = detail::list_numbered(place, ".json");
    std::vector<detail::JsonColumn> columns{{"root_pose", "global_orient", 3, true},
                                            {"body_pose", "body_pose", 63, true},
                                            {"trans", "transl", 3, true},
                                            {"jaw_pose", "jaw_pose", 3, false},
                                            {"leye_pose", "leye_pose", 3, false},
                                            {"reye_pose", "reye_pose", 3, false},
                                            {"lhand_pose", "left_hand_pose", 45, false},
                                            {"rhand_pose", "right_hand_pose", 45, false},
                                            {"expr", "expression", 0, false},
                                            {"betas", "betas", 0, false}};
    std::vector<double> numbers;
    for (const detail::NumberedFile& file : files) {
        const detail::OwnedJson owned(detail::read_json(file.path));
        const detail::Json& json = *owned;
        const detail::JsonObject object(json, file.path.string());
        for (detail::JsonColumn& column : columns) {
            if (numbers.empty() && !column.needed) {
                if (!object.has(column.field)) continue;
                column.needed = true;
            }
            if (!column.needed) continue;
            if (column.width == 0) column.width = object.numbers(column.field).size();
            const std::vector<double> row = object.numbers(column.field, column.width);
            column.data.insert(column.data.end(), row.begin(), row.end());
        }
        numbers.push_back(static_cast<double>(file.number));
    }

    MotionTable table(place);
    bool own_betas = false;
    for (detail::JsonColumn& column : columns) {
        if (!column.needed || column.width == 0) continue;
        own_betas = own_betas || std::string_view(column.key) == "betas";
        table.add(column.key, column.field, std::move(column.data), {files.size(), column.width});
    }
    table.add(detail::frame_numbers_key, "the numbers of its files", std::move(numbers), {files.size()});
    table.add("flat_hand", "flat_hand", std::vector<double>{own_betas ? 1.0 : 0.0},
              {}); // LHM's hands are complete, ExAvatar's are not
    if (!own_betas) {
        std::error_code ignored;
        const auto shape = std::filesystem::weakly_canonical(place, ignored).parent_path() / "shape_param.json";
        if (!std::filesystem::exists(shape, ignored))
            throw IoError(place.string() + ": betas are in no file, and " + shape.string() +
                          " is missing; one of them must give the shape");
        const detail::Json json = {{"shape_param", detail::read_json(shape)}};
        const std::vector<double> betas = detail::JsonObject(json, shape.string()).numbers("shape_param");
        table.add("betas", "shape_param.json", betas, {betas.size()});
        for (const char* offset : {"joint_offset.json", "face_offset.json"})
            if (warnings && std::filesystem::exists(shape.parent_path() / offset, ignored))
                warnings->push_back((shape.parent_path() / offset).string() +
                                    ": is not applied, the body model's own joints and face are taken; let training "
                                    "refine joints and poses");
    }
    return detail::MotionReader<MotionTable>(std::move(table), model, options, warnings).read();
}

} // namespace gsh
