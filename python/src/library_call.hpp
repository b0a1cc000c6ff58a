// SPDX-License-Identifier: Apache-2.0
/// @file  Calls of libgsh-python from the extension module: without the GIL, and with its errors as Python's.
#pragma once

#include "interface.hpp"

#include <nanobind/nanobind.h>

#include <string>

namespace gsh_python {

[[noreturn]] inline void raise(PyObject* type, const std::string& message) {
    PyErr_SetString(type, message.c_str());
    throw nanobind::python_error();
}

/// Throws what a status stands for, with the library's words.
inline void check(int status) {
    if (status == done) return;
    raise(status == bad_value       ? PyExc_ValueError
          : status == file_failed   ? PyExc_OSError
          : status == out_of_memory ? PyExc_MemoryError
                                    : PyExc_RuntimeError,
          gsh_python_api()->last_error());
}

/// Runs call() without the GIL, and checks its status.
template <class Call>
void run(const Call& call) {
    int status;
    {
        const nanobind::gil_scoped_release release;
        status = call();
    }
    check(status);
}

} // namespace gsh_python
