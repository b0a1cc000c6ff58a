// SPDX-License-Identifier: Apache-2.0
#include "backend/other_backend.hpp"

#include "backend/use_components.hpp"
#include "loss/lpips_networks.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <string>

using namespace gsh;

/// tests/CMakeLists.txt checks that this file includes nothing of the CPU backends.
TEST_CASE("a backend beside the CPU's runs every component by its own overloads, with its own scratch") {
    other::Device device;
    test::use_rasterizer(device);
    test::use_hash_grid(device);
    test::use_field(device);
    test::use_photometric_loss(device);
    test::use_lpips(device, test::with_noise(lpips_alexnet()));
    test::use_adam(device);
    test::use_skinned_splats(device);
    test::use_static_gaussians(device);
    test::use_blend_shapes(device);
    test::use_occlusion_field(device);
    test::use_lit_splats(device);
    test::use_shadow_maps(device);
    for (const std::string name :
         {"composite_forward", "composite_backward", "hash_prepare", "hash_forward", "hash_backward", "mlp_forward",
          "mlp_backward", "photometric_forward", "photometric_backward", "lpips_forward", "lpips_distance", "adam_step",
          "adam_step_rows", "adam_step_columns", "skinned_splats_accumulate", "occlusion_forward", "occlusion_backward",
           "lit_vertices_accumulate", "blend_shapes_forward", "blend_shapes_backward", "shadow_draw", "add_sum"})
        CHECK_MESSAGE(std::ranges::count(device.calls, name) > 0, name);
}
