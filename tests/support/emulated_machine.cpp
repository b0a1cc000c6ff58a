// SPDX-License-Identifier: Apache-2.0
/// The emulated GPU of a program, as environment variables describe it. Tests run such programs as processes.
#include "support/cuda_emulation/runtime.hpp"

#include <cstdlib>
#include <string>

namespace gsh::test {

namespace {

/// GSH_EMULATED_MEMORY: bytes of the GPU. GSH_EMULATED_DRIVER=none: no driver. GSH_EMULATED_ORDER: that of blocks and
/// threads, "reverse" or "random". GSH_EMULATED_LIFE: the GPU fails at the wait of this number.
const bool described = [] {
    const auto value = [](const char* name) {
        const char* const text = std::getenv(name);
        return std::string(text ? text : "");
    };
    CudaEmulation& machine = CudaEmulation::instance();
    const std::string memory = value("GSH_EMULATED_MEMORY"), life = value("GSH_EMULATED_LIFE");
    if (!memory.empty()) machine.memory_limit = std::stoull(memory);
    if (!life.empty()) machine.life = std::stoull(life);
    machine.driver_is_missing = value("GSH_EMULATED_DRIVER") == "none";
    const std::string order = value("GSH_EMULATED_ORDER");
    machine.order = order == "reverse" ? Order::reverse : order == "random" ? Order::random : Order::forward;
    return true;
}();

} // namespace

} // namespace gsh::test
