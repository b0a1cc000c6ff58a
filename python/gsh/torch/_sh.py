# SPDX-License-Identifier: Apache-2.0
"""Spherical harmonics, with gsplat's names and shapes."""

import torch
from torch.autograd.function import once_differentiable

from .. import _gsh
from ._checks import check_tensor


class SphericalHarmonics(torch.autograd.Function):
    """(dirs, coeffs) -> colors."""

    @staticmethod
    def forward(ctx, dirs, coeffs, masks, degree):
        flat_dirs = dirs.detach().reshape(-1, 3).contiguous()
        flat_coeffs = coeffs.detach().reshape(-1, coeffs.shape[-2], 3).contiguous()
        flat_masks = None if masks is None else masks.reshape(-1).contiguous().view(torch.uint8)
        ctx.save_for_backward(dirs, coeffs)
        ctx.flat, ctx.degree = (flat_dirs, flat_coeffs, flat_masks), degree
        colors = torch.empty_like(flat_dirs)
        _gsh.spherical_harmonics(degree, *ctx.flat, torch.get_num_threads(), colors)
        return colors.reshape(dirs.shape)

    @staticmethod
    @once_differentiable
    def backward(ctx, dL_dcolors):
        dirs, coeffs = ctx.saved_tensors
        dL_ddirs, dL_dcoeffs = (torch.zeros_like(t) if needed else None
                                for t, needed in zip(ctx.flat[:2], ctx.needs_input_grad))
        _gsh.spherical_harmonics_backward(ctx.degree, *ctx.flat, torch.get_num_threads(),
                                          dL_dcolors.reshape(-1, 3).contiguous(), dL_ddirs, dL_dcoeffs)
        return (None if dL_ddirs is None else dL_ddirs.reshape(dirs.shape),
                None if dL_dcoeffs is None else dL_dcoeffs.reshape(coeffs.shape), None, None)


def spherical_harmonics(degrees_to_use, dirs, coeffs, masks=None):
    """Evaluates real spherical harmonics, as ``gsplat.spherical_harmonics``.

    ``dirs`` [..., 3] of any length, ``coeffs`` [..., K, 3] with K >= (degrees_to_use + 1)^2, ``masks`` [...] of bool:
    where False, the result is 0. Degrees 0 to 4. Returns [..., 3], without an offset and without a clamp.
    """
    where = "spherical_harmonics"
    if not isinstance(dirs, torch.Tensor):
        raise TypeError(f"{where}: dirs is {type(dirs).__name__}, expected a torch.Tensor")
    check_tensor(where, "dirs", dirs, (None,) * max(dirs.dim() - 1, 0) + (3,))
    batch = tuple(dirs.shape[:-1])
    check_tensor(where, "coeffs", coeffs, batch + (None, 3), dirs.dtype)
    if masks is not None:
        check_tensor(where, "masks", masks, batch, torch.bool)
    if isinstance(degrees_to_use, bool) or not hasattr(degrees_to_use, "__index__"):
        raise TypeError(f"{where}: the degree is {type(degrees_to_use).__name__}, expected a whole number")
    degree = degrees_to_use.__index__()
    if not 0 <= degree <= 4:
        raise ValueError(f"{where}: the degree is {degree}, expected 0 to 4")
    if (degree + 1) ** 2 > coeffs.shape[-2]:
        raise ValueError(f"{where}: {coeffs.shape[-2]} coefficients are too few for degree {degree}, "
                         f"expected {(degree + 1) ** 2} or more")
    return SphericalHarmonics.apply(dirs, coeffs, masks, degree)
