// SPDX-License-Identifier: Apache-2.0
/// @file  Loads motions in any supported layout, detected from a file's members or a folder's files.
#pragma once

#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/body/moved_motion.hpp>
#include <gsh/body/retarget.hpp>
#include <gsh/body/rig_motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/file/folder_list.hpp>
#include <gsh/io/file/foreign_file.hpp>
#include <gsh/io/file/full_path.hpp>
#include <gsh/io/file/input_file.hpp>
#include <gsh/io/file/json_file.hpp>
#include <gsh/io/file/npz.hpp>
#include <gsh/io/file/text_lines.hpp>
#include <gsh/io/motion/amass_file.hpp>
#include <gsh/io/motion/bvh_file.hpp>
#include <gsh/io/motion/easymocap_file.hpp>
#include <gsh/io/motion/gala_rig.hpp>
#include <gsh/io/motion/gltf_motion.hpp>
#include <gsh/io/motion/motion_file.hpp>
#include <gsh/io/motion/npz_frames.hpp>
#include <gsh/io/motion/people_snapshot_poses.hpp>
#include <gsh/io/motion/sam3d_motion.hpp>
#include <gsh/io/motion/smplifyx_file.hpp>
#include <gsh/io/motion/smplx_json_file.hpp>
#include <gsh/io/motion/up_warning.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

enum class MotionLayout {
    gsh,        ///< .npz, split as in SMPL-X programs, or poses: io/motion/motion_file.hpp
    amass,      ///< .npz with poses and trans, or root_orient and pose_body: io/motion/amass_file.hpp
    smplifyx,   ///< .npz with camera_translation or camera_transform: io/motion/smplifyx_file.hpp
    snapshot,   ///< .npz with thetas: io/motion/people_snapshot_poses.hpp
    smplx_json, ///< folder of NUMBER.json, objects: io/motion/smplx_json_file.hpp
    easymocap,  ///< folder of NUMBER.json, lists: io/motion/easymocap_file.hpp
    npz_frames, ///< folder of NUMBER.npz or NUMBER_PERSON.npz, one frame each: io/motion/npz_frames.hpp
    gala,       ///< folder of a GalaBasketball scene: io/motion/gala_rig.hpp
    bvh,        ///< text that begins with HIERARCHY: io/motion/bvh_file.hpp
    gltf,       ///< glTF, GLB, VRM and VRMA: io/motion/gltf_motion.hpp
    sam3d,      ///< .npz with pred_global_rots: io/motion/sam3d_motion.hpp
};

/// Detects the layout of a file or a folder; no value if it is not supported.
///
/// Errors  IoError for a path that is neither a folder nor an archive; kinds of files that are known but not read are
///         named, with the way to convert them.
[[nodiscard]] inline std::optional<MotionLayout> recognise_motion(const InputFile& input);

/// Loads a motion in any layout from a file or a folder. For a folder with poses.npz (a capture), that file is read.
///
/// Motions of other rigs (BVH, glTF, SAM 3D Body) are retargeted (body/retarget.hpp), with options.joint_map and
/// options.betas.
///
/// Frame   that of the file, or options.world. BVH and glTF are y up; SAM 3D Body is stored in the camera's axes.
/// Errors  IoError for an unknown layout; those of the layout's own function, and of retarget.
[[nodiscard]] inline Motion load_any_motion(const InputFile& input, const BodyModel& body,
                                            const MotionFileOptions& options = {},
                                            std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

/// Loads the motion of another rig, not retargeted. No value for all other layouts.
[[nodiscard]] inline std::optional<RigMotion> load_rig_motion(const InputFile& input, MotionLayout layout,
                                                              const MotionFileOptions& options = {},
                                                              std::vector<std::string>* warnings = nullptr);

namespace detail {

/// Recognises texts and containers other than .npz by their first bytes, or by the ending of the name.
inline std::optional<MotionLayout> recognise_rig_file(const InputFile& input) {
    check_no_pipe(input);
    char bytes[64] = {};
    std::string_view head(bytes, InputStream(input).read(bytes, sizeof bytes));
    if (head.starts_with("\xef\xbb\xbf")) head.remove_prefix(3);
    head = trimmed(head);
    const auto ends = [&](std::string_view ending) { return is_word(input.ending(), ending); };
    if (is_word(head.substr(0, 9), "HIERARCHY") || ends(".bvh")) return MotionLayout::bvh;
    if (ends(".json"))
        throw IoError(input.name() + ": is a single file of JSON; give the folder that holds one for each frame");
    if (head.starts_with("glTF") || head.starts_with("{") || ends(".glb") || ends(".gltf") || ends(".vrm") ||
        ends(".vrma"))
        return MotionLayout::gltf;
    if (const std::string foreign = not_the_kind(input, "a motion: .npz, BVH, glTF or a folder", "npz", "");
        !foreign.empty())
        throw IoError(input.name() + ": " + foreign);
    return std::nullopt;
}

/// The folder of NUMBER.json in a folder of ExAvatar, LHM or EasyMocap; empty if there is none.
inline std::filesystem::path json_frames_folder(const std::filesystem::path& folder) {
    const auto place = smplx_json_folder(folder);
    return place.empty() ? easymocap_pose_folder(folder) : place;
}

/// The file that holds the motion: poses.npz in a folder if it exists, else the input itself.
inline InputFile motion_file_of(const InputFile& input) {
    if (!input.is_folder()) return input;
    std::error_code ignored;
    const auto inside = input.path() / "poses.npz";
    return std::filesystem::exists(inside, ignored) ? InputFile(inside) : input;
}

} // namespace detail

inline std::optional<MotionLayout> recognise_motion(const InputFile& input) {
    if (input.is_folder()) {
        const std::filesystem::path& folder = input.path();
        std::error_code ignored;
        if (std::filesystem::is_directory(folder / "pose", ignored) &&
            !detail::list_numbered(folder / "pose", ".txt").empty())
            return MotionLayout::gala;
        const InputFile file = detail::motion_file_of(input);
        if (detail::smplx_json_folder(folder).empty() && !file.is_folder()) return recognise_motion(file);
        if (const auto place = detail::json_frames_folder(folder); !place.empty()) {
            const detail::OwnedJson owned(detail::read_json(detail::list_numbered(place, ".json").front().path));
            const detail::Json& first = *owned;
            return first.is_array() || first.contains("annots") ? MotionLayout::easymocap : MotionLayout::smplx_json;
        }
        return npz_frames(folder).empty() ? std::nullopt : std::optional(MotionLayout::npz_frames);
    }
    if (const auto layout = detail::recognise_rig_file(input)) return layout;
    const NpzReader file(input);
    detail::check_first_version(file, "motion");
    const auto has = [&](const char* key) { return file.has_array(key); };
    if (file.has("pred_global_rots")) return MotionLayout::sam3d;
    if (has("thetas")) return MotionLayout::snapshot;
    if (has("global_orient") && (has("camera_translation") || has("camera_transform") || has("camera_rotation")))
        return MotionLayout::smplifyx;
    if (has("global_orient")) return MotionLayout::gsh; // the pose is split, regardless of other members
    if (has("root_orient") || (has("poses") && has("trans"))) return MotionLayout::amass;
    return MotionLayout::gsh;
}

inline std::optional<RigMotion> load_rig_motion(const InputFile& input, MotionLayout layout,
                                                const MotionFileOptions& options, std::vector<std::string>* warnings) {
    switch (layout) {
    case MotionLayout::bvh:
        return load_bvh(input, options.joint_map, warnings, options.rates());
    case MotionLayout::gltf:
        return load_gltf_motion(input, options.joint_map, warnings, options.animation, options.rates());
    case MotionLayout::sam3d:
        return load_sam3d_motion(input, options.joint_map, warnings, options.rates());
    default:
        return std::nullopt;
    }
}

inline Motion load_any_motion(const InputFile& input, const BodyModel& body, const MotionFileOptions& options,
                              std::vector<std::string>* warnings) {
    const auto layout = recognise_motion(input);
    if (!layout)
        throw IoError(input.name() +
                      ": holds no motion; expected poses.npz, files NUMBER.json (ExAvatar, LHM, "
                      "EasyMocap) or NUMBER.npz, or a GalaBasketball scene" +
                      folder_contents(input.path()));
    const InputFile file = detail::motion_file_of(input);
    if (const auto rig = load_rig_motion(file, *layout, options, warnings)) {
        Motion motion = retarget(*rig, body, options.joint_map, {options.betas, input.name(), warnings});
        if (*layout == MotionLayout::sam3d && options.world == MotionFileOptions::World::as_stored)
            for (std::size_t t = 0; t < motion.frame_count(); ++t)
                move_frame(body, motion, t, {half_turn_about_x(), vec3<double>(0)});
        validate(motion, body, input.name());
        return motion;
    }
    switch (*layout) {
    case MotionLayout::amass:
        return load_amass_motion(file, body, options, warnings);
    case MotionLayout::smplifyx:
        return load_smplifyx_fits(file, body, options, warnings).motion;
    case MotionLayout::snapshot:
        return detail::load_snapshot_motion(file, body, options, warnings);
    case MotionLayout::smplx_json:
        return load_smplx_json_motion(detail::json_frames_folder(input.path()), body, options, warnings);
    case MotionLayout::easymocap:
        return load_easymocap_motion(detail::json_frames_folder(input.path()), body, options, warnings);
    case MotionLayout::npz_frames:
        return load_npz_frames(input.path(), body, options, warnings);
    case MotionLayout::gala: {
        const GalaRig rig = load_gala_rig(full_path(input.path()).parent_path() / "model", warnings);
        check_size(input.name(), "joints of a pose", rig.body.joint_count(), body.joint_count(),
                   "the motion is for GalaBasketball's own body");
        std::vector<int> frames;
        for (const auto& pose : detail::list_numbered(input.path() / "pose", ".txt"))
            frames.push_back(static_cast<int>(pose.number));
        StatedTime stated;
        stated.numbers.assign(frames.begin(), frames.end());
        const auto times = frame_times(frames.size(), stated, options.rates(), input.name(), warnings);
        std::vector<Motion> people = load_gala_motions(input.path() / "pose", rig, frames);
        for (Motion& motion : people) motion.timestamps = times;
        check_value(options.person >= 0 && static_cast<std::size_t>(options.person) < people.size(), input.name(),
                    "there is no person " + std::to_string(options.person) + ", the poses hold " +
                        std::to_string(people.size()));
        Motion& motion = people[static_cast<std::size_t>(options.person)];
        detail::turn_upright(body, motion, options, input.name(), warnings);
        return std::move(motion);
    }
    default:
        break;
    }
    return load_motion(file, body, options, warnings);
}

} // namespace gsh
