// SPDX-License-Identifier: Apache-2.0
/// @file  The CUDA backend, Device, and its overloads of every component's work. For nvcc.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/lane_sums.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/pack.cuh>
#include <gsh/backend/cuda/recorder.cuh>
#include <gsh/backend/cuda/reduce.cuh>
#include <gsh/backend/cuda/step_graph.cuh>
#include <gsh/backend/cuda/sum.cuh>
#include <gsh/backend/cuda/unroll.cuh>
#include <gsh/body/cuda/blend_shapes.cuh>
#include <gsh/body/cuda/bone_transforms.cuh>
#include <gsh/body/cuda/posed_surface.cuh>
#include <gsh/body/cuda/surface_interpolation.cuh>
#include <gsh/field/cuda/hash_grid.cuh>
#include <gsh/field/cuda/hash_lists.cuh>
#include <gsh/field/cuda/mlp.cuh>
#include <gsh/field/cuda/mlp_backward.cuh>
#include <gsh/field/cuda/mlp_forward.cuh>
#include <gsh/field/cuda/mlp_shape.cuh>
#include <gsh/field/cuda/mlp_tile.cuh>
#include <gsh/field/cuda/row.cuh>
#include <gsh/optim/cuda/adam.cuh>
#include <gsh/light/cuda/lit_splats.cuh>
#include <gsh/light/cuda/shadow_map.cuh>
#include <gsh/loss/cuda/lpips.cuh>
#include <gsh/loss/cuda/photometric.cuh>
#include <gsh/loss/cuda/photometric_tile.cuh>
#include <gsh/avatar/cuda/bone_sums.cuh>
#include <gsh/avatar/cuda/occlusion_field.cuh>
#include <gsh/avatar/cuda/pose_of_neurons.cuh>
#include <gsh/avatar/cuda/skinned_gaussian.cuh>
