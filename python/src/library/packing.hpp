// SPDX-License-Identifier: Apache-2.0
/// @file  Packed arrays: rows of the Gaussians that are not culled.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int find_visible(const Sizes&, const std::int32_t* radii, std::int64_t* count, std::int64_t* ids,
                 std::int64_t* batch_ids, std::int64_t* camera_ids, std::int64_t* gaussian_ids);
int gather_rows(int threads, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count, const void* from,
                void* to);
int scatter_rows(int threads, std::int64_t row_bytes, const std::int64_t* ids, std::int64_t count, const void* from,
                 std::int64_t rows, void* to);

} // namespace gsh_python
