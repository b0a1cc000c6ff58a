// SPDX-License-Identifier: Apache-2.0
/// @file  A host executor that is not a backend: it runs chunks and owns no storage.
#pragma once

#include <gsh/backend/backend.hpp>

#include <algorithm>
#include <cstddef>

namespace gsh::test {

struct ChunksAlone {
    void for_chunks(std::size_t n, std::size_t grain, const auto& body) {
        for (std::size_t chunk = 0; chunk < chunk_count(n, grain); ++chunk)
            body(chunk, chunk * grain, std::min(n, (chunk + 1) * grain));
    }
};
static_assert(HostExecutor<ChunksAlone> && !Backend<ChunksAlone> && !CpuBackend<ChunksAlone>);

} // namespace gsh::test
