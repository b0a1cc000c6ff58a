// SPDX-License-Identifier: Apache-2.0
/// @file  Registration of a capture's people before a reconstruction with --refine.
#pragma once

#include "support/reconstruct_options.hpp"
#include "support/source.hpp"

#include <gsh/backend/threads.hpp>

namespace gsh::examples {

/// Replaces the motions of the people by registered ones (register_motions), on the training photographs, and sets
/// source.registration. Skipped, with a warning, if a body has no triangles. With options.refine_cameras, the focal length
/// of a single training camera learns, too, and replaces that of the capture.
void register_source(cpu::Threads& backend, Source& source, const ReconstructOptions& options);

} // namespace gsh::examples
