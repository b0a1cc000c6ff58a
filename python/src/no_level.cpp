// SPDX-License-Identifier: Apache-2.0
/// @file  What is loaded in place of libgsh-python on a machine for which the package was not built.

#include "interface.hpp"

extern "C" const gsh_python::Api* gsh_python_api() {
    static const gsh_python::Api api = [] {
        gsh_python::Api none{};
        none.refusal = "gsh: this processor has none of the instruction sets that the package was built for "
                       "(" GSH_PYTHON_LEVELS "), or glibc is older than 2.33";
        return none;
    }();
    return &api;
}
