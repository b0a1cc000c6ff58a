// SPDX-License-Identifier: Apache-2.0
/// @file  The table of functions of libgsh-python.

#include "interface.hpp"
#include "library/errors.hpp"

#include <gsh/core/config.hpp>

extern "C" const gsh_python::Api* gsh_python_api() {
    static constexpr gsh_python::Api api{
        .refusal = nullptr, .instruction_set = GSH_TEXT(GSH_ISA), .last_error = &gsh_python::last_error};
    return &api;
}
