// SPDX-License-Identifier: Apache-2.0
/// @file  Exports an avatar or a scene as one HTML file: the page of gsh-view with its data inside.
#pragma once

#include "export/export_avatar.hpp"

namespace gsh::programs {

/// Writes the page of gsh-view with the client engine, the avatar or scene (ScenePacking::compact) and its motions. It
/// needs neither a server nor a network. The page computes light and shadows for each pose, so nothing is baked.
///
/// Without --poses the motions are those that gsh-view shows. --frame and --frames keep that part of the motion.
/// Errors  those of load_view_scene and of the file; ValueError for a frame that the motion does not have.
ExportResult export_page(const ExportOptions& options);

} // namespace gsh::programs
