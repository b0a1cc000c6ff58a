// SPDX-License-Identifier: Apache-2.0
/// @file  The CPU overloads of Rasterizer, for cpu::Serial and cpu::Threads.
#pragma once

#include <gsh/render/cpu/composite.hpp>
#include <gsh/render/cpu/composite_backward.hpp>
#include <gsh/render/cpu/raster_scratch.hpp>
#include <gsh/render/cpu/screen_backward.hpp>
