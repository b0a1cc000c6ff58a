// SPDX-License-Identifier: Apache-2.0
/// @file  The CPU backends, Serial and Threads, and their overloads of every component's work.
#pragma once

#include <gsh/backend/serial.hpp>
#include <gsh/math/wide.hpp>
#include <gsh/math/wide_bf16.hpp>
#include <gsh/math/wide_block.hpp>
#include <gsh/math/wide_register.hpp>
#include <gsh/math/wide_shuffle.hpp>
#include <gsh/backend/cpu/sum.hpp>
#include <gsh/backend/threads.hpp>
#include <gsh/body/cpu/blend_shapes.hpp>
#include <gsh/gaussian/cpu/gaussian_lanes.hpp>
#include <gsh/gaussian/cpu/static_gaussian.hpp>
#include <gsh/field/cpu/feature_rows.hpp>
#include <gsh/field/cpu/gemm.hpp>
#include <gsh/field/cpu/hash_grid.hpp>
#include <gsh/field/cpu/matrix_bf16.hpp>
#include <gsh/field/cpu/mlp.hpp>
#include <gsh/field/cpu/mlp_mixed.hpp>
#include <gsh/optim/cpu/adam.hpp>
#include <gsh/light/cpu/lit_splats.hpp>
#include <gsh/light/cpu/shadow_map.hpp>
#include <gsh/render/cpu/arithmetic.hpp>
#include <gsh/render/cpu/bin.hpp>
#include <gsh/render/cpu/composite.hpp>
#include <gsh/render/cpu/composite_backward.hpp>
#include <gsh/render/cpu/project.hpp>
#include <gsh/render/cpu/project_backward.hpp>
#include <gsh/render/cpu/radix_sort.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/cpu/rasterizer.hpp>
#include <gsh/render/cpu/tile.hpp>
#include <gsh/loss/cpu/lpips.hpp>
#include <gsh/loss/cpu/photometric.hpp>
#include <gsh/avatar/cpu/occlusion_field.hpp>
#include <gsh/avatar/cpu/skinned_gaussian.hpp>
