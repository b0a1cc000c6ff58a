# SPDX-License-Identifier: Apache-2.0
"""Animatable 3D Gaussian humans, and Gaussian splatting for PyTorch on CPUs (``gsh.torch``)."""

from importlib.metadata import PackageNotFoundError, version as _version

from ._gsh import instruction_set

try:
    __version__ = _version("gsh-avatars")
except PackageNotFoundError:  # imported from a build folder
    __version__ = "0"

__all__ = ["__version__", "instruction_set"]
