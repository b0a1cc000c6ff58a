// SPDX-License-Identifier: Apache-2.0
/// @file  The module gsh._gsh.posing: avatars in memory.
#pragma once

#include <nanobind/nanobind.h>

namespace gsh_python {

/// Adds it to gsh._gsh; gsh/_avatar.py makes of its functions the classes that users see.
void add_posing_functions(nanobind::module_& module);

} // namespace gsh_python
