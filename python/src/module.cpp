// SPDX-License-Identifier: Apache-2.0
/// @file  The extension module gsh._gsh.

#include "interface.hpp"

#include <nanobind/nanobind.h>

namespace nb = nanobind;

NB_MODULE(_gsh, m) {
    const gsh_python::Api& api = *gsh_python_api();
    if (api.refusal != nullptr) throw nb::import_error(api.refusal);
    m.attr("instruction_set") = api.instruction_set;
}
