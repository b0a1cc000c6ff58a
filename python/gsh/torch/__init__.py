# SPDX-License-Identifier: Apache-2.0
"""Differentiable Gaussian splatting for PyTorch on CPUs, with the names, shapes and conventions of gsplat 1.5.3."""

from .. import _gsh
from ._avatar import Avatar
from ._covariance import quat_scale_to_covar_preci
from ._projection import fully_fused_projection
from ._rasterization import rasterization
from ._sh import spherical_harmonics
from ._ssim import fused_ssim

__all__ = ["Avatar", "fully_fused_projection", "fused_ssim", "quat_scale_to_covar_preci", "rasterization",
           "release_memory", "spherical_harmonics"]


def release_memory():
    """Frees the memory that released passes hold for the next ones."""
    _gsh.release_memory()
