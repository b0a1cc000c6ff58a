// SPDX-License-Identifier: Apache-2.0
/// @file  Uses components without the headers of their overloads. It must fail to compile, with a clear message.
#include <gsh/backend/serial.hpp>

#include "backend/use_components.hpp"

void use(gsh::cpu::Serial& backend) {
    gsh::test::use_rasterizer(backend);
    gsh::test::use_hash_grid(backend);
    gsh::test::use_field(backend);
    gsh::test::use_photometric_loss(backend);
    gsh::test::use_lpips(backend, {});
    gsh::test::use_adam(backend);
    gsh::test::use_skinned_splats(backend);
    gsh::test::use_static_gaussians(backend);
    gsh::test::use_blend_shapes(backend);
    gsh::test::use_occlusion_field(backend);
    gsh::test::use_lit_splats(backend);
    gsh::test::use_shadow_maps(backend);
}
