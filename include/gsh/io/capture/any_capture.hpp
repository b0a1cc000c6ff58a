// SPDX-License-Identifier: Apache-2.0
/// @file  Loads captures in any supported layout, which is detected from the files in the folder.
#pragma once

#include <gsh/backend/backend.hpp>
#include <gsh/body/body_model.hpp>
#include <gsh/body/motion.hpp>
#include <gsh/core/error.hpp>
#include <gsh/io/capture/capture.hpp>
#include <gsh/io/capture/easymocap_capture.hpp>
#include <gsh/io/capture/gala_basketball.hpp>
#include <gsh/io/capture/people_snapshot.hpp>
#include <gsh/io/file/foreign_file.hpp>

#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

namespace gsh {

enum class CaptureLayout {
    gsh,             ///< cameras.json, poses.npz, images/: io/capture/capture.hpp
    people_snapshot, ///< cameras.npz, images/, masks/: io/capture/people_snapshot.hpp
    gala,            ///< camera/ID.txt, pose/NUMBER.txt: io/capture/gala_basketball.hpp
    easymocap,       ///< intri.yml, extri.yml: io/capture/easymocap_capture.hpp
};

/// Detects the layout of a folder from its files; no value if it is not supported.
[[nodiscard]] inline std::optional<CaptureLayout> recognise_capture(const std::filesystem::path& folder);

struct AnyCapture {
    CaptureLayout layout = CaptureLayout::gsh;
    Capture capture;
    std::vector<Motion> people; ///< all people of the scene if the layout has them; else the capture's motion alone
    std::optional<GalaRig> rig; ///< the body, if the layout contains one; else the caller's body is used
};

/// Loads a capture in any layout. `body` may be null for layouts that contain their own.
///
/// Errors  IoError for a folder of unknown layout, or a missing body; those of the layout's own function.
template <HostExecutor E>
[[nodiscard]] AnyCapture load_any_capture(E& executor, const std::filesystem::path& folder, const BodyModel* body,
                                          const CaptureOptions& options = {},
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

template <HostExecutor E>
AnyCapture load_any_capture(E& executor, const std::filesystem::path& folder, const BodyModel* body,
                            const CaptureOptions& options, std::vector<std::string>* warnings) {
    if (std::error_code ignored; !std::filesystem::is_directory(folder, ignored))
        throw IoError(folder.string() + ": " +
                      not_the_kind(folder, "a folder with cameras.json, poses.npz and images/, or a data set's", "",
                                   "is not a folder, expected one with cameras.json, poses.npz and images/, or a data "
                                   "set's"));
    const auto layout = recognise_capture(folder);
    if (!layout)
        throw IoError((folder / "cameras.json").string() +
                      ": is missing, and the folder is of no other layout either (cameras.npz: "
                      "PeopleSnapshot; camera/ and pose/: GalaBasketball; intri.yml: EasyMocap)" +
                      folder_contents(folder));
    AnyCapture result;
    result.layout = *layout;
    if (*layout == CaptureLayout::gala) {
        GalaScene scene = load_gala_scene(executor, folder, options, warnings);
        result.capture = std::move(scene.capture);
        result.people = std::move(scene.people);
        result.rig = std::move(scene.rig);
        return result;
    }
    if (!body) throw IoError(folder.string() + ": its poses need a body model, which this layout does not contain");
    result.capture =
        *layout == CaptureLayout::people_snapshot ? load_people_snapshot(executor, folder, *body, options, warnings)
        : *layout == CaptureLayout::easymocap     ? load_easymocap_capture(executor, folder, *body, options, warnings)
                                                  : load_capture(executor, folder, *body, options, warnings);
    result.people = {result.capture.motion};
    return result;
}

} // namespace gsh
