// SPDX-License-Identifier: Apache-2.0
/// @file  Avatars of files, posed as arrays of splats, and the adjoint with respect to the pose.
#pragma once

#include "interface.hpp"

namespace gsh_python {

int open_avatar(const char* path, int threads, void** avatar, AvatarSizes* sizes);
int betas_of_avatar(void* avatar, double* betas);
int pose_avatar(void* avatar, const PoseArrays&, const SplatOutputs&, void** pass);
int pose_avatar_backward(void* pass, const SplatInputs& dL, const PoseGradients&);
void release_posed(void* pass);
void close_avatar(void* avatar);

} // namespace gsh_python
