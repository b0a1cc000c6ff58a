// SPDX-License-Identifier: Apache-2.0
/// @file  What the extension module calls in libgsh-python: a table of functions over C types.
///
/// The module and the library are compiled for different instruction sets. They share no class and no template: memory
/// belongs to whoever made it, and no exception crosses the border.
#pragma once

namespace gsh_python {

/// A function that can fail returns one of these.
enum Status : int {
    done = 0,
    bad_value = 1,     ///< an argument is wrong
    failed = 2,        ///< anything else
    out_of_memory = 3,
};

struct Api {
    const char* refusal;                ///< why the library cannot run here, or null: then the functions are set
    const char* instruction_set;
    const char* (*last_error)();        ///< of the calling thread's last call that failed
};

} // namespace gsh_python

extern "C" const gsh_python::Api* gsh_python_api();
