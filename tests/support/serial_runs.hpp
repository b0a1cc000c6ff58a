// SPDX-License-Identifier: Apache-2.0
/// @file  The runs of small_runs.hpp on cpu::Serial, which serial_runs.cpp compiles.
///
/// nvcc does not compile the vectors of the CPU's kernels. A file that it compiles includes this header, and the program
/// links serial_runs.cpp, which the C++ compiler has compiled for the same instruction set.
#pragma once

#include <gsh/backend/serial.hpp>

#include "support/small_runs.hpp"

namespace gsh::test {

extern template Outcome train_avatar<cpu::Serial>(const SmallScene&, const ConfiguredAvatarParams&, int,
                                                  const TrainParams&);
extern template Outcome train_paper_network<cpu::Serial>(const SmallScene&, Precision, int);
extern template Outcome train_lit<cpu::Serial>(const SmallScene&, int);
extern template Outcome train_people<cpu::Serial>(const SmallScene&, int, FirstView);
extern template Outcome train_static<cpu::Serial>(const SmallScene&, int, FirstView);
extern template Outcome train_refined<cpu::Serial>(const SmallScene&, int);
extern template Outcome train_paper<cpu::Serial>(const SmallScene&, int);
extern template Outcome fit_pose<cpu::Serial>(const PosedScene&);
extern template Outcome show<cpu::Serial>(const PosedScene&, const AvatarData&);

} // namespace gsh::test
