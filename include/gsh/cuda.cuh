// SPDX-License-Identifier: Apache-2.0
/// @file  The CUDA backend, Device, and its overloads of every component's work. For nvcc.
#pragma once

#include <gsh/backend/cuda/device.cuh>
#include <gsh/backend/cuda/error.cuh>
#include <gsh/backend/cuda/kernel.cuh>
#include <gsh/backend/cuda/memory.cuh>
#include <gsh/backend/cuda/recorder.cuh>
