// SPDX-License-Identifier: Apache-2.0
/// @file  The table of functions of libgsh-python.

#include "interface.hpp"
#include "library/avatar.hpp"
#include "library/errors.hpp"
#include "library/packing.hpp"
#include "library/projection.hpp"
#include "library/rasterization.hpp"
#include "library/shading.hpp"
#include "library/ssim.hpp"

#include <gsh/core/config.hpp>

extern "C" const gsh_python::Api* gsh_python_api() {
    static constexpr gsh_python::Api api{.refusal = nullptr,
                                         .instruction_set = GSH_TEXT(GSH_ISA),
                                         .last_error = &gsh_python::last_error,
                                         .project = &gsh_python::project,
                                         .project_backward = &gsh_python::project_backward,
                                         .rasterize = &gsh_python::rasterize,
                                         .rasterize_backward = &gsh_python::rasterize_backward,
                                         .release = &gsh_python::release,
                                         .spherical_harmonics = &gsh_python::spherical_harmonics,
                                         .spherical_harmonics_backward = &gsh_python::spherical_harmonics_backward,
                                         .find_visible = &gsh_python::find_visible,
                                         .gather_rows = &gsh_python::gather_rows,
                                         .scatter_rows = &gsh_python::scatter_rows,
                                         .ssim = &gsh_python::ssim,
                                         .open_avatar = &gsh_python::open_avatar,
                                         .betas_of_avatar = &gsh_python::betas_of_avatar,
                                         .pose_avatar = &gsh_python::pose_avatar,
                                         .pose_avatar_backward = &gsh_python::pose_avatar_backward,
                                         .release_posed = &gsh_python::release_posed,
                                         .close_avatar = &gsh_python::close_avatar,
                                         .release_memory = &gsh_python::release_memory};
    return &api;
}
