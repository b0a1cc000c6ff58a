# SPDX-License-Identifier: Apache-2.0
"""Differentiable Gaussian splatting for PyTorch on CPUs, with the names, shapes and conventions of gsplat 1.5.3."""

from .._gsh import release_memory
from ._projection import fully_fused_projection
from ._rasterization import rasterization
from ._sh import spherical_harmonics

__all__ = ["fully_fused_projection", "rasterization", "release_memory", "spherical_harmonics"]
