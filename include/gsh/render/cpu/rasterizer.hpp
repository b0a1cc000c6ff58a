// SPDX-License-Identifier: Apache-2.0
/// @file  The rasterizer on the CPU: what Rasterizer needs of the backends cpu::Serial and cpu::Threads.
#pragma once

#include <gsh/render/cpu/composite.hpp>
#include <gsh/render/cpu/composite_backward.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
