// SPDX-License-Identifier: Apache-2.0
/// @file  The arithmetic of render/arithmetic.hpp by the names that the CPU passes use.
#pragma once

#include <gsh/core/config.hpp>
#include <gsh/render/arithmetic.hpp>


namespace gsh::cpu::inline GSH_ISA {

using gsh::detail::exp2_minus;
using gsh::detail::max_positive;
using gsh::detail::min_positive;
using gsh::detail::rough_sqrt;

} // namespace gsh::cpu
