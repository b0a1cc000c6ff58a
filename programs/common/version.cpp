// SPDX-License-Identifier: Apache-2.0
#include "common/version.hpp"

#include "common/gpu.hpp"

#include <gsh/core/config.hpp>

namespace gsh::programs {

std::string version_line(const std::string& program) {
    return program + " " GSH_VERSION_TEXT " (instructions: " GSH_TEXT(GSH_ISA) "; backends: threads" +
           (has_cuda() ? ", cuda" : "") + ")";
}

} // namespace gsh::programs
