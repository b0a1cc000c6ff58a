// SPDX-License-Identifier: Apache-2.0
/// @file  Exceptions of gsh as a status and a message, which cross to the extension module.
#pragma once

#include "interface.hpp"

#include <gsh/core/error.hpp>

#include <exception>
#include <new>
#include <string>

namespace gsh_python {

inline std::string& error_text() {
    thread_local std::string text;
    return text;
}

inline const char* last_error() { return error_text().c_str(); }

/// Runs work(); an exception becomes a status.
template <class Work>
int guarded(const Work& work) {
    try {
        work();
        return done;
    } catch (const gsh::ShapeError& e) {
        error_text() = e.what();
        return bad_value;
    } catch (const gsh::ValueError& e) {
        error_text() = e.what();
        return bad_value;
    } catch (const std::bad_alloc&) {
        error_text() = "gsh: not enough memory";
        return out_of_memory;
    } catch (const std::exception& e) {
        error_text() = e.what();
        return failed;
    }
}

} // namespace gsh_python
