# SPDX-License-Identifier: Apache-2.0
"""Animatable 3D Gaussian humans.

In memory: ``load_avatar``, ``Avatar.pose``, ``load_camera``, ``render``. Long jobs, with files: ``reconstruct``,
``evaluate``, ``check``, ``export``, ``retarget``. Gaussian splatting for PyTorch on CPUs is in ``gsh.torch``. The
programs are commands (``gsh-reconstruct``, ...), and ``python -m gsh demo`` makes an avatar from nothing.

``gsh.instruction_set`` is the instruction set that the library runs with on this processor.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._avatar import Avatar, Camera, Motion, Rendering, Splats, load_avatar, load_camera, render
    from ._jobs import check, evaluate, export, reconstruct, retarget

    __version__: str
    instruction_set: str

# Imported when first used: the commands need none of it, and start faster.
_HOMES = {
    "._gsh": ("instruction_set",),
    "._avatar": ("Avatar", "Camera", "Motion", "Rendering", "Splats", "load_avatar", "load_camera", "render"),
    "._jobs": ("check", "evaluate", "export", "reconstruct", "retarget"),
}

__all__ = [
    "Avatar",
    "Camera",
    "Motion",
    "Rendering",
    "Splats",
    "__version__",
    "check",
    "evaluate",
    "export",
    "instruction_set",
    "load_avatar",
    "load_camera",
    "reconstruct",
    "render",
    "retarget",
]


def _installed_version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("gsh-avatars")
    except PackageNotFoundError:  # imported from a build folder
        return "0"


def __getattr__(name: str) -> object:
    if name == "__version__":
        return _installed_version()
    for home, names in _HOMES.items():
        if name in names:
            value = getattr(_import_module(home, __name__), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list:
    return sorted({*globals(), *__all__})
