# SPDX-License-Identifier: Apache-2.0
"""The structural similarity of images, with the name and the arguments of the package fused-ssim."""

import torch
from torch.autograd.function import once_differentiable

from .. import _gsh
from ._checks import check_choice, check_finite, check_tensor, refuse


class Ssim(torch.autograd.Function):
    """(img1, img2) -> mean SSIM. The gradient with respect to img1 is computed with the value."""

    @staticmethod
    def forward(ctx, img1, img2, whole_windows):
        planes = (-1,) + img1.shape[-2:]
        a, b = (image.detach().reshape(planes).contiguous() for image in (img1, img2))
        gradient = torch.empty_like(a) if ctx.needs_input_grad[0] else None
        value = _gsh.ssim(a, b, whole_windows, torch.get_num_threads(), gradient)
        if gradient is not None:
            ctx.save_for_backward(gradient)
        ctx.shape = img1.shape
        return torch.tensor(value, dtype=img1.dtype)

    @staticmethod
    @once_differentiable
    def backward(ctx, dL_dvalue):
        gradient, = ctx.saved_tensors
        return (gradient * dL_dvalue).reshape(ctx.shape), None, None


def fused_ssim(img1, img2, padding="same", train=True):
    """The mean SSIM of two batches of images [B, channels, height, width] in [0, 1], as ``fused_ssim.fused_ssim``.

    The window is 11 x 11, Gaussian with sigma 1.5. With ``padding`` "same" images are continued by zeros; with "valid"
    only windows within the image count. Gradients flow to ``img1`` alone, with ``train``.
    """
    where = "fused_ssim"
    check_choice(where, "padding", padding, ("same", "valid"))
    check_tensor(where, "img1", img1, (None,) * 4)
    check_tensor(where, "img2", img2, tuple(img1.shape), img1.dtype)
    refuse(where, img2.requires_grad, "img2 requires a gradient, which is not available; exchange the images")
    if padding == "valid" and min(img1.shape[-2:]) < 11:
        raise ValueError(f"{where}: img1 has {img1.shape[-2]} x {img1.shape[-1]} pixels, expected 11 x 11 or more "
                         "for padding 'valid'")
    if img1.numel() == 0:
        raise ValueError(f"{where}: img1 has the shape {list(img1.shape)}, expected at least one pixel")
    value = Ssim.apply(img1 if train else img1.detach(), img2, padding == "valid")
    if not bool(torch.isfinite(value)):
        check_finite(where, img1=img1, img2=img2)
    return value
