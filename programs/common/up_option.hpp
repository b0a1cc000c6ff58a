// SPDX-License-Identifier: Apache-2.0
/// @file  The option of programs that read scenes of Gaussians for which way is up in them.
#pragma once

#include <string>

namespace CLI {
class App;
}

namespace gsh::programs {

/// The option --input-up: x, -x, y, -y, z or -z; empty where it is not given. CLI11 must be included before it is
/// called.
template <class App = CLI::App>
void add_input_up(App& app, std::string& up) {
    app.add_option("--input-up", up,
                   "which way is up in the scene's numbers: x, -x, y, -y, z or -z; it goes before what the file states")
        ->check(CLI::IsMember({"x", "-x", "y", "-y", "z", "-z"}));
}

} // namespace gsh::programs
