// SPDX-License-Identifier: Apache-2.0
/// @file  The functions of gsh._gsh for avatars.
#pragma once

#include <nanobind/nanobind.h>

namespace gsh_python {

/// Adds them to the module; gsh/_avatar.py makes the classes that users see of them.
void add_avatar_functions(nanobind::module_& module);

} // namespace gsh_python
