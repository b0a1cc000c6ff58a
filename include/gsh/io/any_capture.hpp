// SPDX-License-Identifier: Apache-2.0
/// @file  Captures and motions in whatever layout they come: recognised by what lies in the folder or the file.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/amass_file.hpp>
#include <gsh/io/capture.hpp>
#include <gsh/io/easymocap_capture.hpp>
#include <gsh/io/easymocap_file.hpp>
#include <gsh/io/gala_basketball.hpp>
#include <gsh/io/motion_file.hpp>
#include <gsh/io/npz.hpp>
#include <gsh/io/people_snapshot.hpp>
#include <gsh/io/smplifyx_file.hpp>
#include <gsh/io/smplx_json_file.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

enum class CaptureLayout {
    gsh,             ///< cameras.json, poses.npz, images/: io/capture.hpp
    people_snapshot, ///< cameras.npz, images/, masks/: io/people_snapshot.hpp
    gala,            ///< camera/ID.txt, pose/NUMBER.txt: io/gala_basketball.hpp
    easymocap,       ///< intri.yml, extri.yml: io/easymocap_capture.hpp
};

/// What a folder holds, told by its files; nothing if they are of no layout that we read.
[[nodiscard]] inline std::optional<CaptureLayout> recognise_capture(const std::filesystem::path& folder);

struct AnyCapture {
    CaptureLayout layout = CaptureLayout::gsh;
    Capture capture;
    std::vector<Motion> people; ///< everybody in the scene, where the layout tells; else the capture's motion alone
    std::optional<GalaRig> rig; ///< the body, where the layout brings its own; else it is the caller's
};

/// Loads a capture in any layout. `body` may be null for layouts that bring their own.
/// Errors  IoError for a folder of no known layout, or a body that is missing; else as the layout's own function.
template <CpuBackend B>
[[nodiscard]] AnyCapture load_any_capture(B& backend, const std::filesystem::path& folder, const BodyModel* body,
                                          const CaptureOptions& options = {},
                                          std::vector<std::string>* warnings = nullptr);

enum class MotionLayout {
    gsh,        ///< .npz, split as SMPL-X programs have it, or poses: io/motion_file.hpp
    amass,      ///< .npz with trans and mocap_framerate, or root_orient and pose_body: io/amass_file.hpp
    smplifyx,   ///< .npz with camera_translation or camera_transform: io/smplifyx_file.hpp
    snapshot,   ///< .npz with thetas: io/people_snapshot.hpp
    smplx_json, ///< folder of NUMBER.json, objects: io/smplx_json_file.hpp
    easymocap,  ///< folder of NUMBER.json, lists: io/easymocap_file.hpp
    gala,       ///< folder of a GalaBasketball scene: io/gala_basketball.hpp
};

[[nodiscard]] inline std::optional<MotionLayout> recognise_motion(const std::filesystem::path& path);

/// Loads a motion in any layout, from a file or a folder; for a folder with poses.npz (a capture), from that.
/// Errors  IoError for what is of no known layout; else as the layout's own function.
[[nodiscard]] inline Motion load_any_motion(const std::filesystem::path& path, const BodyModel& body,
                                            const MotionFileOptions& options = {},
                                            std::vector<std::string>* warnings = nullptr);

// -------------------------------------------------------------------------------------------------------------

inline std::optional<CaptureLayout> recognise_capture(const std::filesystem::path& folder) {
    std::error_code ignored;
    const auto has = [&](const char* name) { return std::filesystem::exists(folder / name, ignored); };
    if (has("cameras.json")) return CaptureLayout::gsh;
    if (has("cameras.npz")) return CaptureLayout::people_snapshot;
    if (has("camera") && has("pose")) return CaptureLayout::gala;
    if (has("intri.yml")) return CaptureLayout::easymocap;
    return {};
}

template <CpuBackend B>
AnyCapture load_any_capture(B& backend, const std::filesystem::path& folder, const BodyModel* body,
                            const CaptureOptions& options, std::vector<std::string>* warnings) {
    if (std::error_code ignored; !std::filesystem::is_directory(folder, ignored))
        throw IoError(folder.string() +
                      ": is not a folder, expected one with cameras.json, poses.npz and images/, or a data set's");
    const auto layout = recognise_capture(folder);
    if (!layout)
        throw IoError((folder / "cameras.json").string() +
                      ": is missing, and the folder is of no other layout either (cameras.npz: "
                      "PeopleSnapshot; camera/ and pose/: GalaBasketball; intri.yml: EasyMocap)");
    AnyCapture result;
    result.layout = *layout;
    if (*layout == CaptureLayout::gala) {
        GalaScene scene = load_gala_scene(backend, folder, options, warnings);
        result.capture = std::move(scene.capture);
        result.people = std::move(scene.people);
        result.rig = std::move(scene.rig);
        return result;
    }
    if (!body) throw IoError(folder.string() + ": its poses need a body model, which this layout does not bring");
    result.capture =
        *layout == CaptureLayout::people_snapshot ? load_people_snapshot(backend, folder, *body, options, warnings)
        : *layout == CaptureLayout::easymocap     ? load_easymocap_capture(backend, folder, *body, options, warnings)
                                                  : load_capture(backend, folder, *body, options, warnings);
    result.people = {result.capture.motion};
    return result;
}

inline std::optional<MotionLayout> recognise_motion(const std::filesystem::path& path) {
    std::error_code ignored;
    if (std::filesystem::is_directory(path, ignored)) {
        if (std::filesystem::is_directory(path / "pose", ignored) &&
            !detail::list_numbered(path / "pose", ".txt").empty())
            return MotionLayout::gala;
        if (const auto place = detail::smplx_json_folder(path); !place.empty()) {
            const detail::Json first = detail::read_json(detail::list_numbered(place, ".json").front().path);
            return first.is_array() || first.contains("annots") ? MotionLayout::easymocap : MotionLayout::smplx_json;
        }
        if (std::filesystem::exists(path / "poses.npz", ignored)) return recognise_motion(path / "poses.npz");
        return {};
    }
    const NpzReader file(path);
    const auto has = [&](const char* key) { return file.has_array(key); };
    if (has("thetas")) return MotionLayout::snapshot;
    if (has("global_orient") && (has("camera_translation") || has("camera_transform") || has("camera_rotation")))
        return MotionLayout::smplifyx;
    if (has("root_orient") || (has("poses") && has("trans"))) return MotionLayout::amass;
    return MotionLayout::gsh;
}

inline Motion load_any_motion(const std::filesystem::path& path, const BodyModel& body,
                              const MotionFileOptions& options, std::vector<std::string>* warnings) {
    std::error_code ignored;
    const bool folder = std::filesystem::is_directory(path, ignored);
    const auto layout = recognise_motion(path);
    if (!layout)
        throw IoError(path.string() + ": holds no motion; expected poses.npz, files NUMBER.json (ExAvatar, LHM, "
                                      "EasyMocap), or a GalaBasketball scene");
    const auto file = folder && std::filesystem::exists(path / "poses.npz", ignored) ? path / "poses.npz" : path;
    switch (*layout) {
    case MotionLayout::amass:
        return load_amass_motion(file, body, options, warnings);
    case MotionLayout::smplifyx:
        return load_smplifyx_fits(file, body, options, warnings).motion;
    case MotionLayout::snapshot:
        return detail::load_snapshot_motion(file, body, options, warnings);
    case MotionLayout::smplx_json:
        return load_smplx_json_motion(path, body, options, warnings);
    case MotionLayout::easymocap:
        return load_easymocap_motion(path, body, options, warnings);
    case MotionLayout::gala: {
        const GalaRig rig = load_gala_rig(std::filesystem::weakly_canonical(path).parent_path() / "model", warnings);
        check_size(path.string(), "joints of a pose", rig.body.joint_count(), body.joint_count(),
                   "the motion is for GalaBasketball's own body");
        std::vector<int> frames;
        for (const auto& pose : detail::list_numbered(path / "pose", ".txt"))
            frames.push_back(static_cast<int>(pose.number));
        std::vector<Motion> people = load_gala_motions(path / "pose", rig, frames, options.fps);
        check_value(options.person >= 0 && static_cast<std::size_t>(options.person) < people.size(), path.string(),
                    "there is no person " + std::to_string(options.person) + ", the poses hold " +
                        std::to_string(people.size()));
        return std::move(people[static_cast<std::size_t>(options.person)]);
    }
    case MotionLayout::gsh:
        break;
    }
    return load_motion(file, body, options, warnings);
}

} // namespace gsh
