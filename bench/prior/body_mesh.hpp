// SPDX-License-Identifier: Apache-2.0
/// @file  The body of the prior benches: the file in the environment variable GSH_BODY, or the built-in actor.
#pragma once

#include <gsh/io/body/body_file.hpp>
#include <gsh/synthetic/actor.hpp>

#include <cstdlib>

namespace gsh::bench {

inline const BodyModel& body() {
    static const BodyModel model = [] {
        const char* path = std::getenv("GSH_BODY");
        return path ? load_body_model(path) : make_actor();
    }();
    return model;
}

} // namespace gsh::bench
