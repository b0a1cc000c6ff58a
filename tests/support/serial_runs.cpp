// SPDX-License-Identifier: Apache-2.0
/// @file  The runs of small_runs.hpp on cpu::Serial.
#include <gsh/cpu.hpp>

#include "support/serial_runs.hpp"

namespace gsh::test {

template Outcome train_avatar<cpu::Serial>(const SmallScene&, const ConfiguredAvatarParams&, int, const TrainParams&);
template Outcome train_paper_network<cpu::Serial>(const SmallScene&, Precision, int);
template Outcome train_lit<cpu::Serial>(const SmallScene&, int);
template Outcome train_people<cpu::Serial>(const SmallScene&, int, FirstView);
template Outcome train_static<cpu::Serial>(const SmallScene&, int, FirstView);
template Outcome train_refined<cpu::Serial>(const SmallScene&, int);
template Outcome train_paper<cpu::Serial>(const SmallScene&, int);
template Outcome fit_pose<cpu::Serial>(const PosedScene&);
template Outcome show<cpu::Serial>(const PosedScene&, const AvatarData&);

} // namespace gsh::test
